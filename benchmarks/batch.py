"""A set as it is made overnight and released: all clips of a folder, robots, object sizes, by one specification.

`hoi-retarget batch`, then `report` (verdicts, page) and `export --to dataset` (tables, a card). Measured from outside:
the time on the clock, the processor time and the memory of all processes together. What others do on the machine
counts on the clock, so its load is shown beside it.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import paper_figures
import tyro
from common import show, write_json

from hoi_retarget.batch.manifest import read_manifest

CORPUS_SECONDS = paper_figures.RELEASED_HOURS * 3600  # Of motion: the set that the paper's authors released.
CORPUS_FPS = 30.0
CORES = (2, 16)
SAMPLE_SECONDS = 0.5


@dataclass(frozen=True)
class Arguments:
    """Which clips, and on how many processes."""

    clips: Path
    """Folder with recorded clips."""
    objects: Path
    """Folder with the geometry of their objects."""
    robots: tuple[str, ...] = ("unitree_g1", "unitree_h2")
    object_scales: tuple[float | Literal["auto"], ...] = ("auto", 1.0)
    workers: int = 2
    out: Path | None = None
    """Keep what is made in this folder."""
    json: Path | None = None


def specification(arguments: Arguments) -> str:
    lists = {"clips": [str(arguments.clips.absolute())], "robots": list(arguments.robots)}
    lines = [f"{key} = {json.dumps(value)}" for key, value in lists.items()]
    lines += [f"objects = {json.dumps(str(arguments.objects.absolute()))}"]
    lines += [f"object_scales = {json.dumps(arguments.object_scales)}"]
    return "\n".join(lines) + "\n"


def memory(process: int) -> float:
    """Return what a process and those it started use together [MB]; what they share counts once."""
    total = 0.0
    try:
        rollup = Path(f"/proc/{process}/smaps_rollup").read_text()
        total += next(int(line.split()[1]) for line in rollup.splitlines() if line.startswith("Pss:")) / 1024
        children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    except (OSError, StopIteration):
        return total
    return total + sum(memory(int(child)) for child in children)


def measure(arguments: Arguments, folder: Path) -> dict[str, Any]:
    (folder / "set.toml").write_text(specification(arguments))
    words = ["batch", str(folder / "set.toml"), "--out", str(folder / "out"), "--workers", str(arguments.workers)]
    before, start, peak = os.getloadavg()[0], time.monotonic(), 0.0
    process = subprocess.Popen([sys.executable, "-m", "hoi_retarget", *words])
    while process.poll() is None:
        peak = max(peak, memory(process.pid))
        time.sleep(SAMPLE_SECONDS)
    seconds = time.monotonic() - start
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    entries = read_manifest(folder / "out").values()
    return {
        "jobs": len(entries),
        "solved": sum(entry.succeeded for entry in entries),
        "verdicts": {level: sum(entry.verdict == level for entry in entries) for level in ("pass", "warn", "fail")},
        "frames": sum(entry.frames * len(entry.results) for entry in entries),
        "seconds": seconds,
        "cpu_seconds": used.ru_utime + used.ru_stime,
        "peak_megabytes": peak,
        "load": (before, os.getloadavg()[0]),
        "workers": arguments.workers,
        "released": released(folder, [folder / "out" / result.path for entry in entries for result in entry.results]),
    }


def released(folder: Path, results: list[Path]) -> dict[str, Any]:
    """Return processor time [s] and size [MB] of the report and of the data set that is made of results."""
    made = {
        "report": ["report", str(folder / "out"), "--out", str(folder / "report")],
        "dataset": ["export", *map(str, results), "--to", "dataset", "--out", str(folder / "dataset")],
    }
    found = {}
    for name, words in made.items():
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-m", "hoi_retarget", *words], check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        size = sum(file.stat().st_size for file in (folder / name).rglob("*") if file.is_file())
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        found[name] = {"cpu_seconds": seconds, "megabytes": size / 1e6}
    return found


def report(result: dict[str, Any]) -> None:
    frames, seconds = result["frames"], result["seconds"]
    rows = [
        ("jobs, of them with results", f"{result['jobs']}, {result['solved']}"),
        ("verdicts", ", ".join(f"{count} {level}" for level, count in result["verdicts"].items())),
        ("frames", f"{frames}"),
        ("time [s]", f"{seconds:.0f}"),
        ("clips/h", f"{3600 * result['jobs'] / seconds:.0f}"),
        ("frames/s", f"{frames / seconds:.0f}"),
        ("processor time [ms/frame]", f"{1e3 * result['cpu_seconds'] / frames:.2f}"),
        ("peak memory of all processes [MB]", f"{result['peak_megabytes']:.0f}"),
        *(
            (f"{name}: processor time [s], size [MB]", f"{made['cpu_seconds']:.1f}, {made['megabytes']:.1f}")
            for name, made in result["released"].items()
        ),
        ("load of the machine before, after", "{:.1f}, {:.1f}".format(*result["load"])),
    ]
    show(f"Batch with {result['workers']} workers", ("", "value"), rows)
    corpus = CORPUS_SECONDS * CORPUS_FPS
    rows = [
        (
            f"{cores} cores",
            f"{corpus * seconds / frames * result['workers'] / cores / 3600:.2f}",
            f"{corpus * result['cpu_seconds'] / frames / cores / 3600:.2f}",
            f"{corpus * paper_figures.SECONDS_A_FRAME / cores / 3600:.1f}",
        )
        for cores in CORES
    ]
    header = ("", "at this pace [h]", "by processor time [h]", "released program [h]")
    show(f"{CORPUS_SECONDS / 3600:.1f} h of motion at {CORPUS_FPS:g} Hz, one robot", header, rows)


def main(arguments: Arguments) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        result = measure(arguments, folder)
    report(result)
    write_json(arguments.json, result)


if __name__ == "__main__":
    main(tyro.cli(Arguments, description=__doc__))
