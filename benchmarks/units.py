r"""CPU time of whole runs, from file to file, in units of one differential IK solve by mink with daqp on the G1.

A unit is a solve for 14 frames of the body without joint limits, measured in the same run; so is GMR's IK alone, where
its Python is given:

    python3.11 -m venv ik && ik/bin/pip install mink==1.3.0 daqp==0.11.0
    python3.11 -m venv gmr && gmr/bin/pip install mink daqp mujoco scipy rich torch
    python benchmarks/units.py --data CLIPS --objects OBJECTS --mink ik/bin/python --gmr gmr/bin/python

Start-up is not counted: every process first runs a short clip.
"""

import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import clip_files, pin_threads, run_fresh, show, write_json
from peers import by_gmr
from rich.progress import track

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.motion.result_file import save
from hoi_retarget.numerics import se3
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config, Scaling
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.retargeting.solve import solve
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel
from short_clips import taken

STAGES = ("read", "targets", "ik", "holds", "trajectory", "metrics", "write")
UNIT_SITES = (
    "pelvis", "head", *(f"{side}_{site}" for side in ("left", "right") for site in
    ("hip", "knee", "foot", "shoulder", "elbow", "palm")),
)  # fmt: skip
"""Sites whose links are the 14 of a unit."""


@dataclass(frozen=True)
class Arguments:
    """Measure whole runs in units."""

    data: Path = Path("../shared/data/omomo")
    objects: Path = Path("../shared/data/objects")
    mink: Path = Path("ik/bin/python")
    """Python of an environment with mink and daqp."""
    gmr: Path | None = None
    """Python of GMR's environment."""
    gmr_script: Path = Path("../shared/peers/run_gmr.py")
    robots: tuple[str, ...] = ("unitree_g1", "unitree_h2")
    modes: tuple[str, ...] = ("surface:all", "surface:fast", "landmark:all", "landmark:none")
    """Contact and figures."""
    limit: int | None = 20
    """Only so many recorded clips, spread evenly over their names."""
    repeats: int = 5
    """Runs, of which the median counts."""
    json: Path | None = None


def unit(python: Path, file: Path, arguments: Arguments) -> float:
    """Return seconds of one solve of differential inverse kinematics along a clip's motion."""
    model = load_robot("unitree_g1")
    clip = open_clip(file, ReadOptions(objects=arguments.objects))
    qpos = solve(clip, model, Config(contact="landmark")).motion.qpos
    kinematics = model.forward(qpos)
    names = [model.body_of(site) for site in UNIT_SITES]
    frames = [model.body_frames.frames[name] for name in names]
    turns = np.moveaxis([kinematics.orientation(frame) for frame in frames], 3, 0)
    with tempfile.TemporaryDirectory() as folder:
        poses = Path(folder) / "poses.npz"
        np.savez(
            poses,
            names=np.array(names),
            positions=np.moveaxis([kinematics.point(frame) for frame in frames], 2, 0),
            quats=se3.matrix_to_quat(turns.reshape(-1, 3, 3)).reshape(*turns.shape[:2], 4),
            qpos=qpos[0],
        )
        program = Path(__file__).parent / "programs" / "differential_ik.py"
        command = [str(python.absolute()), str(program), str(model.spec.mjcf), str(poses)]
        return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def run(file: Path, objects: Path, model: RobotModel, config: Config) -> tuple[int, dict[str, float]]:
    """Return the number of frames of a clip and the CPU seconds of each stage of a run, from file to file."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        clip = open_clip(file, ReadOptions(objects=objects))
        seconds = {"read": time.process_time() - start}
        motion = retarget(clip, model, config)
        start = time.process_time()
        save(motion, Path(folder) / "motion.npz")
        seconds |= motion.report.cpu_seconds | {"write": time.process_time() - start}
    return clip.frames, seconds


def measured(robot: str, mode: str, files: list[Path], objects: Path) -> dict[str, Any]:
    """Return milliseconds a frame by stage over some clips, in one process."""
    model, (contact, figures) = load_robot(robot), mode.split(":")
    config = Config(contact=contact, figures=figures, scaling=Scaling(object_scale=1.0))
    first = open_clip(files[0], ReadOptions(objects=objects))
    retarget(taken(first, np.arange(min(60, first.frames))), model, config)  # Imports and caches are not counted.
    runs = [run(file, objects, model, config) for file in files]
    frames = sum(count for count, _ in runs)
    return {stage: 1e3 * sum(seconds.get(stage, 0.0) for _, seconds in runs) / frames for stage in STAGES}


def main(arguments: Arguments) -> None:
    files = clip_files(arguments.data, arguments.limit)
    units, others = [], []
    found: dict[str, list[dict[str, float]]] = {}
    for _ in track(range(arguments.repeats), "runs"):
        units.append(1e3 * unit(arguments.mink, files[0], arguments))
        if arguments.gmr is not None:
            with tempfile.TemporaryDirectory() as folder:
                given = arguments.gmr.absolute(), arguments.gmr_script.resolve()
                outs = [Path(folder) / f"{file.stem}.npz" for file in files[:5]]
                pairs = zip(files, outs, strict=False)
                seconds = sum(by_gmr(*given, file, arguments.objects, out) for file, out in pairs)
                others.append(1e3 * seconds / sum(len(np.load(out)["qpos"]) for out in outs))
        for robot in arguments.robots:
            for mode in arguments.modes:
                row = run_fresh(measured, robot, mode, files, arguments.objects)
                found.setdefault(f"{robot}, {mode.replace(':', ', figures ')}", []).append(row)
    each_unit = float(np.median(units))
    rows = []
    for name, runs in found.items():
        stages = [float(np.median([run[stage] for run in runs])) for stage in STAGES]
        total = float(np.median([sum(run.values()) / one for run, one in zip(runs, units, strict=True)]))
        rows.append((name, *(f"{value / each_unit:.2f}" for value in stages), f"{total:.1f}"))
    if others:
        gmr = float(np.median([other / one for other, one in zip(others, units, strict=True)]))
        rows.append(("GMR, its inverse kinematics alone", *[""] * len(STAGES), f"{gmr:.1f}"))
    show("CPU [units/frame]", ("run", *STAGES, "all"), rows, f"A unit: {each_unit:.3f} ms.")
    write_json(arguments.json, {"units_ms": units, "gmr_ms": others, "runs": found})


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments, description=__doc__))
