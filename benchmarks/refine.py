"""Which references a simulated robot performs after refinement, how near it stays, and what that costs.

python benchmarks/refine.py --results results/*.npz --objects ../shared/data/objects --object-mass 1
"""

import resource
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import pin_threads, show, write_json
from scipy.stats import spearmanr

from hoi_retarget.dynamics.feasibility import forces_on_clip, physics_of_motion
from hoi_retarget.dynamics.physics_scene import PhysicsScene
from hoi_retarget.dynamics.physics_settings import Refinement
from hoi_retarget.evaluation.physics_figures import FEASIBILITY, forces_figures
from hoi_retarget.motion.motion import SIMULATED, Motion
from hoi_retarget.motion.result_file import load
from hoi_retarget.numerics import se3
from hoi_retarget.readers.open import clip_of
from hoi_retarget.robots import load_robot
from hoi_retarget.simulation.balance_transition import with_lead_in_and_out
from hoi_retarget.simulation.physics_stage import add_physics_stage
from hoi_retarget.simulation.rollout import Reference, Rollout, base_errors_deg, object_errors

MOVING, RAISED = 0.1, 0.03
"""An object is moved that is faster [m/s], or higher over its lowest place [m]."""
BOTH, ALONE = 0.7, 0.5
"""Both palms are labelled in this share of the frames in which it is moved, and one alone for less time [s]."""
COLUMNS = {
    "performed_s": "performed [s]",
    "seconds": "of [s]",
    "object_cm": "object [cm]",
    "object_max_cm": "max [cm]",
    "object_deg": "object [deg]",
    "near_share": "near its path",
    "base_cm": "base [cm]",
    "base_deg": "base [deg]",
    "joint_rad": "joint [rad]",
    "gap_cm": "contact gap [cm]",
    "pose_deg": "pose [deg]",
    "direction_deg": "velocity direction [deg]",
    "hand_deg": "hand rotation [deg]",
    "jerk": "jerk [m/s^3]",
    "cpu_per_s": "CPU [s/s]",
    "memory_mb": "memory [MB]",
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


def one_handed(motion: Motion) -> str:
    """Return why a motion is none of two hands; empty where it is one."""
    moved = np.zeros(motion.frames, dtype=bool)
    for place in np.moveaxis(motion.object_pos, 1, 0):
        speed = np.linalg.norm(np.gradient(place, axis=0), axis=1) * motion.fps
        moved |= (speed > MOVING) | (place[:, 2] > place[:, 2].min() + RAISED)
    left, right = (motion.contact_flags[:, motion.contact_links.index(f"{side}_palm")] for side in ("left", "right"))
    both = float((moved & left & right).sum() / max(1, moved.sum()))
    longest = current = 0
    for alone in moved & (left ^ right):
        current = current + 1 if alone else 0
        longest = max(longest, current)
    reasons = []
    if both < BOTH:
        reasons.append(f"both palms in {100 * both:.0f} % of the frames in which the object is moved")
    if longest / motion.fps >= ALONE:
        reasons.append(f"one alone for {longest / motion.fps:.1f} s")
    return ", ".join(reasons)


def measured(file: Path, arguments: Arguments) -> dict[str, Any]:
    """Return the figures of one result; those that need a whole motion are None for one that falls."""
    motion = load(file)
    model, clip = load_robot(motion.robot), clip_of(motion, objects=arguments.objects)
    physics = physics_of_motion(motion)
    if arguments.object_mass is not None:
        physics = replace(physics, object_mass=arguments.object_mass)
    verdict = forces_figures(forces_on_clip(motion, clip, model, physics), motion)
    found = add_physics_stage(motion, clip, physics, arguments.refinement, seed=arguments.seed)
    rollout, figures = found.rollout, found.motion.report.figures
    gap = figures.get("contact_gap_m")
    _, before, after = with_lead_in_and_out(found.scene, found.reference)
    return {
        "clip": file.stem,
        "robot": motion.robot,
        "outcome": found.performance.outcome,
        "whole": found.performance.whole,
        "near_share": found.performance.kept_share,
        "starts_standing": before == 0,
        "ends_standing": after == 0,
        "performed_s": rollout.seconds,
        "seconds": found.reference.seconds,
        **deviations_of(found.scene, found.reference, rollout),
        "gap_cm": None if gap is None else 100 * gap,
        "pose_deg": figures.get("body_pose_deviation_deg"),
        "direction_deg": figures.get("link_velocity_direction_deg"),
        "hand_deg": figures.get("relative_hand_rotation_deg"),
        "jerk": figures.get("body_jerk_mps3"),
        "cpu_per_s": found.motion.report.cpu_seconds[SIMULATED] / rollout.seconds,
        "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "certificate": found.performance.robustness,
        "cause": found.performance.cause,
        **verdict,
    }


def deviations_of(scene: PhysicsScene, reference: Reference, rollout: Rollout) -> dict[str, float | None]:
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
    """Measure every motion of two hands; print each, and means of those that are performed whole with their objects."""
    reasons = {file: one_handed(load(file)) for file in arguments.results}
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(measured, file, arguments) for file, reason in reasons.items() if not reason]
        results = [future.result() for future in futures]
    show_rows(results)
    for file, reason in reasons.items():
        if reason:
            print(f"{file.stem} is left out: {reason}")
    write_json(arguments.json, {"clips": results})


def show_rows(results: list[dict[str, Any]]) -> None:
    """Print the tables of measured motions."""
    whole = [result for result in results if result["whole"]]
    rows = [[result["clip"], result["robot"], result["outcome"], *cells(result)] for result in results]
    if whole:
        means: dict[str, float | None] = {}
        for name in COLUMNS:
            values = [result[name] for result in whole if result[name] is not None]
            means[name] = float(np.mean(values)) if values else None
        rows.append([f"mean of {len(whole)} whole", "", f"{len(whole)} of {len(results)}", *cells(means)])
    show("refinement", ["clip", "robot", "outcome", *COLUMNS.values()], rows)
    strict = sum(result["outcome"] == "held strictly" for result in results)
    fell = sum(result["outcome"].startswith("fell") for result in results)
    print(f"of {len(results)}: {len(whole)} performed whole, {strict} of them with objects held strictly, {fell} fell")
    for result in results:
        print(f"{result['clip']}: {result['cause'] or result['certificate']}")
    if len(results) > 2:
        shares = [result["performed_s"] / result["seconds"] for result in results]
        for figure in FEASIBILITY:
            pairs = [(result[figure.name], share) for result, share in zip(results, shares, strict=True)]
            known = np.array([pair for pair in pairs if pair[0] is not None])
            if not len(known) or (known == known[0]).all(axis=0).any():
                continue
            print(f"rank correlation of {figure.title} with the share performed: {spearmanr(*known.T)[0]:+.2f}")


def cells(values: dict[str, Any]) -> list[str]:
    """Return the numbers of a row as text."""
    digits = dict.fromkeys(("joint_rad", "near_share"), 2)
    return ["-" if values[name] is None else f"{values[name]:.{digits.get(name, 1)}f}" for name in COLUMNS]


if __name__ == "__main__":
    pin_threads()
    main(tyro.cli(Arguments))
