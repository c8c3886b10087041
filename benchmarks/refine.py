"""Which references a simulated robot performs after refinement, how near it stays, and what that costs.

python benchmarks/refine.py --results results/*.npz --objects ../shared/data/objects --object-mass 1
"""

import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import pin_threads, show, write_json

from hoi_retarget.evaluation import evaluate
from hoi_retarget.motion.result_file import load
from hoi_retarget.numerics import se3
from hoi_retarget.physics.feasibility import forces_on_clip, physics_of_motion, shortcomings
from hoi_retarget.physics.performed import performed_motion, why_it_fell
from hoi_retarget.physics.reference import Reference, reference_of
from hoi_retarget.physics.refine import refine
from hoi_retarget.physics.rollout import Rollout, base_errors_deg, object_errors
from hoi_retarget.physics.scene import Scene, scene_of
from hoi_retarget.physics.settings import Refinement
from hoi_retarget.readers.open import clip_of
from hoi_retarget.robots import load_robot

COLUMNS = {
    "performed_s": "performed [s]",
    "seconds": "of [s]",
    "object_cm": "object [cm]",
    "object_max_cm": "max [cm]",
    "object_deg": "object [deg]",
    "base_cm": "base [cm]",
    "base_deg": "base [deg]",
    "joint_rad": "joint [rad]",
    "gap_cm": "contact gap [cm]",
    "pose_deg": "pose [deg]",
    "direction_deg": "velocity direction [deg]",
    "hand_deg": "hand rotation [deg]",
    "jerk": "jerk [m/s^3]",
    "cpu_per_s": "CPU [s/s]",
}


@dataclass(frozen=True)
class Arguments:
    """Measure results."""

    results: tuple[Path, ...]
    objects: Path | None = None
    """Folder with the geometry of the recorded clips' objects."""
    object_mass: float | None = None
    """[kg]; by default as the results say."""
    seed: int = 0
    refinement: Refinement = Refinement()
    jobs: int = 1
    json: Path | None = None


def measured(file: Path, arguments: Arguments) -> dict[str, Any]:
    """Return the figures of one result; those that need a whole motion are None for one that falls."""
    motion = load(file)
    model, clip = load_robot(motion.robot), clip_of(motion, objects=arguments.objects)
    physics = physics_of_motion(motion)
    if arguments.object_mass is not None:
        physics = replace(physics, object_mass=arguments.object_mass)
    start = time.process_time()
    forces = forces_on_clip(motion, clip, model, physics)
    scene = scene_of(motion, model, [track.geometry for track in clip.objects], physics)
    reference = reference_of(scene, motion, forces)
    rollout = refine(scene, reference, arguments.refinement, seed=arguments.seed).rollout
    cpu = time.process_time() - start
    performed = {} if rollout.fell_after else evaluate(performed_motion(motion, scene, rollout), clip, model)
    gap = performed.get("contact_gap_m")
    return {
        "clip": file.stem,
        "robot": motion.robot,
        "whole": rollout.fell_after is None,
        "performed_s": rollout.seconds,
        "seconds": reference.seconds,
        **deviations_of(scene, reference, rollout),
        "gap_cm": None if gap is None else 100 * gap,
        "pose_deg": performed.get("body_pose_deviation_deg"),
        "direction_deg": performed.get("link_velocity_direction_deg"),
        "hand_deg": performed.get("relative_hand_rotation_deg"),
        "jerk": performed.get("body_jerk_mps3"),
        "cpu_per_s": cpu / rollout.seconds,
        "cause": why_it_fell(scene, reference, rollout, motion.fps, shortcomings(forces, motion))
        if rollout.fell_after
        else "",
    }


def deviations_of(scene: Scene, reference: Reference, rollout: Rollout) -> dict[str, float | None]:
    """Return how far a performed motion is from its reference."""
    n, frames = scene.model.n, len(rollout.qpos)
    wanted, found = reference.qpos[:frames], rollout.qpos
    errors = object_errors(rollout, reference, n)
    first = 7 + n
    turns = [
        se3.angle_between(found[:, at : at + 4], wanted[:, at : at + 4]) for at in range(first + 3, found.shape[1], 7)
    ]
    return {
        "object_cm": float(100 * errors.mean()) if errors.size else None,
        "object_max_cm": float(100 * errors.max()) if errors.size else None,
        "object_deg": float(np.degrees(np.mean(turns))) if turns else None,
        "base_cm": float(100 * np.linalg.norm(found[:, :3] - wanted[:, :3], axis=1).mean()),
        "base_deg": float(base_errors_deg(rollout, reference).mean()),
        "joint_rad": float(np.abs(found[:, 7:first] - wanted[:, 7:first]).mean()),
    }


def main(arguments: Arguments) -> None:
    """Measure every result, and print each, and the means of those that are performed whole."""
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(measured, file, arguments) for file in arguments.results]
        results = [future.result() for future in futures]
    whole = [result for result in results if result["whole"]]
    rows = [[result["clip"], result["robot"], "yes" if result["whole"] else "no", *cells(result)] for result in results]
    if whole:
        means: dict[str, float | None] = {}
        for name in COLUMNS:
            values = [result[name] for result in whole if result[name] is not None]
            means[name] = float(np.mean(values)) if values else None
        rows.append([f"mean of {len(whole)} whole", "", f"{len(whole)} of {len(results)}", *cells(means)])
    show("refinement", ["clip", "robot", "whole", *COLUMNS.values()], rows)
    for result in results:
        if result["cause"]:
            print(f"{result['clip']}: {result['cause']}")
    write_json(arguments.json, {"clips": results})


def cells(values: dict[str, Any]) -> list[str]:
    """Return the numbers of a row as text."""
    return ["-" if values[name] is None else f"{values[name]:.{2 if name == 'joint_rad' else 1}f}" for name in COLUMNS]


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments))
