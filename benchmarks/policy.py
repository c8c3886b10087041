"""Policies trained with mjlab on references of one clip, with the same budget, and what they do.

Needs mjlab 1.6 in an environment of its own (docs/training.md), and an accelerator for more than first steps:

    python benchmarks/policy.py --references carry_box.npz refined/carry_box.npz --python mjlab-env/bin/python
"""

import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tyro
from common import show, write_json

from hoi_retarget.cli import main as hoi_retarget

COLUMNS = {
    "iterations": (1.0, "updates"),
    "steps": (1e-6, "steps [10^6]"),
    "seconds": (1.0, "training [s]"),
    "whole": (100.0, "whole [%]"),
    "lasted_share": (100.0, "lasts [%]"),
    "object_m": (100.0, "object [cm]"),
    "object_rad": (float(np.degrees(1.0)), "object [deg]"),
    "gap_m": (100.0, "contact gap [cm]"),
}
"""Factor and heading of each figure."""


@dataclass(frozen=True)
class Arguments:
    """Train one policy on each reference, and play it."""

    references: tuple[Path, ...]
    """Results: retargeted or refined ones, or other programs' motions as results."""
    python: Path
    """Of an environment with mjlab."""
    object_mass: float = 1.0
    """[kg]"""
    objects: Path | None = None
    """Folder with the geometry of the recorded clips' objects."""
    iterations: int = 500
    """Updates of PPO, of 24 steps in each environment."""
    environments: int = 4096
    episodes: int = 64
    """Of the trained policy, with different masses and frictions."""
    out: Path = Path("policies")
    """Folder of checkpoints and curves, by reference."""
    json: Path | None = None


def trained(reference: Path, arguments: Arguments) -> dict[str, Any]:
    """Return the figures of a policy; raises `SystemExit` where a program fails."""
    with TemporaryDirectory() as folder:
        tasks = Path(folder) / "tasks"
        words = [str(reference), "--to", "mjlab-task", "--out", str(tasks), "--object-mass", str(arguments.object_mass)]
        words += [] if arguments.objects is None else ["--objects", str(arguments.objects)]
        if hoi_retarget(["export", *words]) != 0:
            raise SystemExit(f"{reference}: it is not written as a task.")
        (told,) = tasks.glob("*/tasks/*/task.json")
        task = json.loads(told.read_text(encoding="utf-8"))["id"]
        program = Path(__file__).parent / "programs" / "mjlab_policy.py"
        numbers = (arguments.iterations, arguments.environments, arguments.episodes)
        done = subprocess.run(
            [str(arguments.python), str(program), task, str(_folder(reference, arguments.out)), *map(str, numbers)],
            env={**os.environ, "PYTHONPATH": str(tasks), "MUJOCO_GL": "disabled"},
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode != 0:
        raise SystemExit(f"{reference}: mjlab ends with\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return {"reference": str(reference), **json.loads(done.stdout.splitlines()[-1])}


def _folder(reference: Path, out: Path) -> Path:
    """Return a folder for a reference: those of one clip differ in their folders alone."""
    found = out.resolve() / "_".join(reference.resolve().with_suffix("").parts[-2:])
    found.mkdir(parents=True, exist_ok=True)
    return found


def main(arguments: Arguments) -> None:
    """Train on every reference, and print a table."""
    found = [trained(reference, arguments) for reference in arguments.references]
    rows = [
        [item["reference"], *(f"{factor * item[name]:.1f}" for name, (factor, _) in COLUMNS.items())] for item in found
    ]
    show("policies", ["reference", *(title for _, title in COLUMNS.values())], rows)
    write_json(arguments.json, found)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
