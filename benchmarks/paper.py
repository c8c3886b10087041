r"""The paper, table by table: runs what is missing, and writes docs/paper.md from the files with the figures.

    python benchmarks/paper.py                                     # the page again, from the figures that are kept
    python benchmarks/paper.py --data ../shared/data/omomo --objects ../shared/data/objects \
        --gmr gmr/bin/python --omniretarget omni/bin/python --drawn 6 --again peers

Figures are kept in benchmarks/measured, a file for each step. A step runs where its file is missing, or where it is
named by `--again`, if what it needs is given; else the page says what was left out and why.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import paper_page
import tyro

from hoi_retarget.errors import EXTRAS, install_hint

HERE = Path(__file__).parent
MARKS = ("<!-- benchmarks/paper.py: begin -->", "<!-- benchmarks/paper.py: end -->")


@dataclass(frozen=True)
class Arguments:
    """Measure what is missing, and write the page."""

    data: Path | None = None
    """Folder with OMOMO's clips in InterMimic's layout."""
    objects: Path | None = None
    """Folder with the geometry of their objects."""
    drawn: int | None = None
    """OmniRetarget runs on so many clips alone, drawn by lot: it takes minutes for each."""
    gmr: Path | None = None
    """Python of GMR's environment, see peers.py."""
    gmr_script: Path = Path("../shared/peers/run_gmr.py")
    omniretarget: Path | None = None
    """Python of OmniRetarget's environment, see peers.py."""
    again: tuple[str, ...] = ()
    """Steps to run although their figures are kept."""
    measured: Path = HERE / "measured"
    motions: Path = Path("paper_motions")
    """Folder of the programs' motions, which the steps of other references perform."""
    held: Path = Path("held_motions")
    """Folder of motions with `--holds simulated --object-scale 1`, which the physics step performs."""
    page: Path = HERE.parent / "docs" / "paper.md"
    readme: Path = HERE.parent / "README.md"
    """Its table of figures is between two marks."""
    pictures: Path = HERE.parent / "docs" / "images"


@dataclass(frozen=True)
class Step:
    """One script, and what it cannot do without."""

    needs: tuple[str, ...]
    """Arguments that name what is there."""
    words: Callable[[Arguments], Sequence[str | Path]]
    module: str = ""
    """That must be installed."""


def recorded(arguments: Arguments) -> list[str | Path]:
    return ["--data", arguments.data or "", "--objects", arguments.objects or ""]


def peers(arguments: Arguments) -> list[str | Path]:
    words = ["peers.py", *recorded(arguments), "--out", arguments.motions, "--gmr-script", arguments.gmr_script]
    words += [] if arguments.drawn is None else ["--drawn", str(arguments.drawn)]
    return [*words, "--gmr", arguments.gmr or "", "--omniretarget", arguments.omniretarget or ""]


def horizon(arguments: Arguments) -> list[str | Path]:
    words = ["horizon.py", *recorded(arguments), "--limit", "11", "--object-scale", "1.0", "--clearance", "1000"]
    return [*words, "--horizons", "per-frame", "windowed:60:3", "windowed:60:15", "whole"]


def memory(_: Arguments) -> list[str | Path]:
    sizes = ("2000", "10000", "20000")
    return ["scaling.py", "--horizons", "whole", "windowed:60:15", "--sizes", *sizes, "--memory-limit", "2"]


def augmentation(arguments: Arguments) -> list[str | Path]:
    return ["augmentation.py", *recorded(arguments), "--picture", arguments.pictures / "sizes.png"]


def pairs(arguments: Arguments) -> list[str | Path]:
    return ["pairs.py", *recorded(arguments)]


def two_hands(arguments: Arguments) -> list[str | Path]:
    motions = sorted(arguments.held.glob("*.npz"))
    return ["refine.py", "--results", *motions, "--objects", arguments.objects or "", "--object-mass", "1"]


def refinement(arguments: Arguments, program: str) -> list[str | Path]:
    files = [arguments.motions / program / f"{name}.npz" for name in paper_page.PERFORMED]
    motions = [file for file in files if file.exists()]
    return ["refine.py", "--results", *motions, "--objects", arguments.objects or "", "--object-mass", "1"]


def dataset(arguments: Arguments) -> list[str | Path]:
    words = ["batch.py", "--clips", arguments.data or "", "--objects", arguments.objects or ""]
    return [*words, "--object-scales", "auto"]


STEPS = {
    "peers": Step(("data", "objects", "gmr", "omniretarget"), peers),
    "horizon": Step(("data", "objects"), horizon),
    "memory": Step((), memory),
    "augmentation": Step(("data", "objects"), augmentation),
    "video": Step((), lambda _: ["video.py"]),
    "pairs": Step(("data", "objects"), pairs),
    # Without CoACD objects are their hulls, and other motions are performed.
    "two_hands": Step(("objects", "held"), two_hands, "coacd"),
    "refinement": Step(("objects", "motions"), lambda arguments: refinement(arguments, "surface"), "coacd"),
    "refinement_of_omniretarget": Step(
        ("objects", "motions"), lambda arguments: refinement(arguments, "OmniRetarget labelled"), "coacd"
    ),
    "dataset": Step(("data", "objects"), dataset, "pyarrow"),
}


def left_out(name: str, arguments: Arguments) -> str:
    """Return why a step cannot run; empty where it can."""
    step = STEPS[name]
    missing = [f"--{need}" for need in step.needs if not present(getattr(arguments, need))]
    if step.module and install_hint(step.module):
        missing.append(f'`pip install "{EXTRAS[step.module][0]}"`')
    return f"needs {' and '.join(missing)}" if missing else ""


def present(path: Path | None) -> bool:
    return path is not None and path.exists()


def main(arguments: Arguments) -> None:
    """Run what is missing, and write the page."""
    arguments.measured.mkdir(parents=True, exist_ok=True)
    reasons: dict[str, str] = {}
    for name, step in STEPS.items():
        kept = arguments.measured / f"{name}.json"
        if kept.exists() and name not in arguments.again:
            continue
        if reason := left_out(name, arguments):
            reasons[name] = reason
            print(f"{name} is left out: {reason}", file=sys.stderr)
            continue
        script, *words = map(str, step.words(arguments))
        print(f"{name}: {script}", file=sys.stderr)
        done = subprocess.run([sys.executable, HERE / script, *words, "--json", kept], check=False)
        if done.returncode:
            reasons[name] = f"{script} ended with exit code {done.returncode}"
    files = sorted(arguments.measured.glob("*.json"))
    measured = {file.stem: json.loads(file.read_text()) for file in files}
    arguments.page.write_text(paper_page.page(measured, reasons))
    print(f"written: {arguments.page}")
    if "peers" in measured:
        put_in(arguments.readme, paper_page.readme_table(measured["peers"]))


def put_in(file: Path, table: str) -> None:
    """Write the table between its marks in a file."""
    before, begin, rest = file.read_text().partition(MARKS[0])
    _, end, after = rest.partition(MARKS[1])
    if not (begin and end):
        raise SystemExit(f"{file} has no {MARKS[0]} with a {MARKS[1]} after it; nothing is written.")
    file.write_text(f"{before}{MARKS[0]}\n\n{table}\n{MARKS[1]}{after}")
    print(f"written: {file}")


if __name__ == "__main__":
    main(tyro.cli(Arguments, description=__doc__))
