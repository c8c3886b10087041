r"""The paper's benchmark: this project beside GMR and OmniRetarget, on the same clips in one run, by one evaluator.

Other programs run by the Pythons of their own environments:

    python3.11 -m venv gmr && gmr/bin/pip install mink daqp mujoco scipy rich torch
    python3.11 -m venv omni && omni/bin/pip install holosoma-retargeting==0.1.0 mujoco==3.11.0
    python benchmarks/peers.py --data CLIPS --objects OBJECTS --out OUT \
        --gmr gmr/bin/python --omniretarget omni/bin/python

Clip after clip, all programs one after the other, so that their CPU seconds compare. What OUT holds is not run again.
Objects keep their captured size; hands are the same sites of the same robot for all. GMR knows no object: objects move
as in the clip, scaled with its robot's path. OmniRetarget takes minutes a clip: `--drawn` clips are
drawn for it by lot.
"""

import json
import os
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import clip_files, pin_threads, show, write_json
from rich.progress import track
from scores import SCORES, mean, p_value

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.evaluation import Comparison, figures_of
from hoi_retarget.motion.motion import Stage
from hoi_retarget.motion.result_file import load, save
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config, Scaling
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.robots import load_robot
from hoi_retarget.studio.report.open_motion import ReferenceClip, open_motion, with_recording

HERE = Path(__file__).parent
LABELLED = "OmniRetarget labelled"
SEED = 0
GMR_ROOT_SCALE = 0.9 * 1.66 / 1.8
"""Of its robot's path, for a person of the height that its script states."""


@dataclass(frozen=True)
class Arguments:
    """Run programs on the same clips, and compare them."""

    data: Path = Path("../shared/data/omomo")
    objects: Path = Path("../shared/data/objects")
    out: Path = Path("peers")
    """Folder of the motions, one folder a program."""
    gmr: Path | None = None
    """Python of GMR's environment."""
    gmr_script: Path = Path("../shared/peers/run_gmr.py")
    omniretarget: Path | None = None
    """Python of OmniRetarget's environment."""
    drawn: int | None = None
    """OmniRetarget runs on so many clips alone, drawn by lot with the seed `SEED`."""
    minutes: float | None = None
    """Begin no further clip after so long."""
    json: Path | None = None


def ours(contact: str, file: Path, objects: Path, out: Path) -> float:
    """Retarget a clip; return CPU seconds without start-up and figures, as others' are counted."""
    clip = open_clip(file, ReadOptions(objects=objects))
    config = Config(scaling=Scaling(object_scale=1.0), contact=contact)  # pyright: ignore[reportArgumentType]
    motion = retarget(clip, load_robot("unitree_g1"), config)
    save(motion, out)
    return sum(seconds for stage, seconds in motion.report.cpu_seconds.items() if stage != "metrics")


def by_gmr(python: Path, script: Path, file: Path, objects: Path, out: Path) -> float:
    del objects  # It knows none.
    called([python, script, out.parent, file])
    with np.load(out) as arrays:
        qpos, fps, milliseconds = arrays["qpos"], arrays["fps"], float(arrays["cpu_ms_per_frame"])
    # Its script leaves out the clip's first frame, which no figure looks at.
    np.savez(out, qpos=np.concatenate([qpos[:1], qpos]), fps=fps)
    return 1e-3 * milliseconds * len(qpos)


def by_omniretarget(python: Path, file: Path, objects: Path, out: Path) -> float:
    said = called([python, HERE / "programs" / "omniretarget.py", file, objects, out])
    return json.loads(said.splitlines()[-1])["cpu_seconds"]


def called(command: list[Path]) -> str:
    """Return what a program prints; raises `RuntimeError` with its last line where it fails."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode:
        raise RuntimeError((done.stderr.strip() or "failed without a word").splitlines()[-1])
    return done.stdout


def figures(name: str, motion: Path, file: Path, objects: Path) -> dict[str, float | None]:
    """Return a motion's figures beside its clip."""
    model = load_robot("unitree_g1")
    opened = open_motion(motion, model)
    if opened.motion.report.is_foreign:
        recording = ReferenceClip(file, objects, GMR_ROOT_SCALE if name == "GMR" else 1.0)
        return dict(with_recording(opened, motion, model, recording).motion.report.figures)
    clip = open_clip(file, ReadOptions(objects=objects))
    return dict(figures_of(Comparison(opened.motion, clip, 0, model.forward(opened.motion.qpos))))


def result(name: str, program: Callable[[Path, Path, Path], float], file: Path, arguments: Arguments) -> dict[str, Any]:
    """Return what a program makes of a clip, from its file where it has run before."""
    folder = arguments.out.resolve() / name
    folder.mkdir(parents=True, exist_ok=True)
    kept, motion = folder / f"{file.stem}.json", folder / f"{file.stem}.npz"
    if kept.exists():
        return json.loads(kept.read_text())
    found: dict[str, Any] = {"clip": file.stem}
    try:
        found["cpu_seconds"] = program(file.resolve(), arguments.objects.resolve(), motion)
        found |= figures(name, motion, file, arguments.objects)
        with np.load(motion) as arrays:
            found["frames"] = len(arrays["qpos"])
    except (RuntimeError, ValueError) as error:
        found["failed"] = str(error)
    kept.write_text(json.dumps(found, indent=1))
    return found


def write_labelled(out: Path) -> None:
    """Write OmniRetarget's motions as results with the recording's labels, so that physics can perform them."""
    for file in sorted((out / "OmniRetarget").glob("*.npz")):
        path = out / LABELLED / file.name
        if path.exists():
            continue
        own, theirs = load(out / "surface" / file.name), open_motion(file, load_robot("unitree_g1")).motion
        path.parent.mkdir(exist_ok=True)
        stages = (Stage("omniretarget", theirs.qpos),)
        save(replace(own, stages=stages, object_pos=theirs.object_pos, object_quat=theirs.object_quat), path)


def summary(results: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Return means over the clips of each program, failures, and paired tests against our default.

    Clips are those that all programs did, except for a program that was not to run on all.
    """
    most = max(map(len, results.values()))
    sets = [
        {found["clip"] for found in rows if "failed" not in found} for rows in results.values() if len(rows) == most
    ]
    common = sorted(set.intersection(*sets))
    rows = {name: {found["clip"]: found for found in found_ones} for name, found_ones in results.items()}
    values = {
        key: {name: [rows[name].get(clip, {}).get(key) for clip in common] for name in rows} for key, *_ in SCORES
    }
    base = next(iter(rows))
    return {
        "clips": common,
        "tried": sorted({found["clip"] for found_ones in results.values() for found in found_ones}),
        "failed": {
            name: {found["clip"]: found["failed"] for found in found_ones if "failed" in found}
            for name, found_ones in results.items()
        },
        "frames": sum(rows[base][clip]["frames"] for clip in common),
        "mean": {key: {name: mean(column) for name, column in columns.items()} for key, columns in values.items()},
        "figures": values,
        "p": {
            key: {name: p_value(columns[base], column) for name, column in columns.items() if name != base}
            for key, columns in values.items()
        },
    }


def report(found: dict[str, Any]) -> None:
    """Print the table, and the failures."""
    names = list(next(iter(found["mean"].values())))
    rows = [
        (title, *(text(found["mean"][key][name], scale, found["p"][key].get(name)) for name in names))
        for key, title, scale, _ in SCORES
    ]
    clips, tried = len(found["clips"]), len(found["tried"])
    note = f"Means over {clips} clips of {tried} tried, {found['frames']} frames; p: paired Wilcoxon."
    show("Unitree G1, objects at captured size", ("figure", *names), rows, note)
    failures = [(name, clip, reason) for name, clips in found["failed"].items() for clip, reason in clips.items()]
    if failures:
        show("Failures", ("program", "clip", "reason"), failures)


def text(value: float | None, scale: float, p: float | None) -> str:
    if value is None:
        return "-"
    return f"{value * scale:.3g}" + ("" if p is None else f" (p {p:.1g})")


def main(arguments: Arguments) -> None:
    """Run every program on every clip, and compare."""
    programs: dict[str, Callable[[Path, Path, Path], float]] = {
        "surface": lambda *files: ours("surface", *files),
        "landmark": lambda *files: ours("landmark", *files),
    }
    gmr, omniretarget = arguments.gmr, arguments.omniretarget
    if gmr is not None:
        programs["GMR"] = lambda *files: by_gmr(gmr.absolute(), arguments.gmr_script.resolve(), *files)
    if omniretarget is not None:
        programs["OmniRetarget"] = lambda *files: by_omniretarget(omniretarget.absolute(), *files)
    files = clip_files(arguments.data, None)
    order = np.random.default_rng(SEED).permutation(len(files))
    drawn = {files[index].stem for index in order[: arguments.drawn]}
    start = time.monotonic()
    results: dict[str, list[dict[str, Any]]] = {name: [] for name in programs}
    for file in track(files, "clips"):
        if arguments.minutes is not None and time.monotonic() - start > 60 * arguments.minutes:
            break
        for name, program in programs.items():
            if name != "OmniRetarget" or file.stem in drawn:
                results[name].append(result(name, program, file, arguments))
    write_labelled(arguments.out)
    found = summary(results)
    report(found)
    write_json(arguments.json, found)


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments, description=__doc__))
