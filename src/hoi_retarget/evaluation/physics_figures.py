"""Figures of the forces that a motion needs, and of a simulated motion's deviations from its reference."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from hoi_retarget.dynamics.contact_forces import Forces
from hoi_retarget.dynamics.feasibility import forces_on_clip, over_torque, physics_of_motion, unheld_by_one
from hoi_retarget.dynamics.grip_margin import GripMargin, grip_margins
from hoi_retarget.errors import RobotError
from hoi_retarget.evaluation.comparison import Comparison, Figure, mean_or_none
from hoi_retarget.motion.motion import SIMULATED, Motion
from hoi_retarget.numerics import se3

_PERCENTILE = 95


def forces_figures(forces: Forces, motion: Motion) -> dict[str, float | None]:
    """Return the figures of the forces that a motion needs, by names that end in their units; None where undefined."""
    largest = forces.torque_shares.max(axis=1)
    at_objects = forces.missing_share_at_objects
    judged = at_objects[np.isfinite(at_objects)]
    return {
        "missing_wrench_p95_share": float(np.percentile(forces.missing_share, _PERCENTILE)),
        "object_missing_wrench_p95_share": float(np.percentile(judged, _PERCENTILE)) if judged.size else None,
        "torque_p95_share": float(np.percentile(largest, _PERCENTILE)),
        "torque_over_limit_share": float(over_torque(forces).any(axis=1).mean()),
        "one_hand_unheld_s": float(unheld_by_one(forces, motion).sum() / motion.fps) if judged.size else None,
    }


def grip_figures(margins: Sequence[GripMargin]) -> dict[str, float | None]:
    """Return the figures of grips, by names that end in their units; None where hands hold nothing, or not alone."""
    sides = {
        "grip_margin_g": [item.robot for item in margins],
        "person_grip_margin_g": [item.human for item in margins],
        "closure_epsilon_share": [item.robot_closure for item in margins],
        "person_closure_epsilon_share": [item.human_closure for item in margins],
    }
    values = {name: np.concatenate([np.zeros(0), *own]) for name, own in sides.items()}
    found = {name: own[np.isfinite(own)] for name, own in values.items()}
    shares = {
        f"{name}_share": (found[f"{name}_epsilon_share"] > 0.0).astype(float) for name in ("closure", "person_closure")
    }
    return {name: mean_or_none(own) for name, own in (found | shares).items()}


def _feasibility(view: Comparison) -> dict[str, float | None]:
    try:
        forces = forces_on_clip(view.motion, view.clip, view.kinematics.model)
    except RobotError:  # A base carries the robot, or a joint's torque has no limit.
        return {}
    margins = grip_margins(view.motion, view.clip, view.kinematics, physics_of_motion(view.motion))
    return {**forces_figures(forces, view.motion), **grip_figures(margins)}


def _figure(  # noqa: PLR0913, PLR0917 - the fields of a figure
    name: str, title: str, unit: str, meaning: str, digits: int = 1, better: Literal["lower", "higher"] = "lower"
) -> Figure:
    def measure(view: Comparison) -> float | None:
        return view.cached(_feasibility).get(name)

    return Figure(name, title, unit, meaning, measure, digits, better, slow=True, needs_floor=True)


FEASIBILITY = (
    _figure(
        "missing_wrench_p95_share", "missing wrench p95", "%", "Force and moment that nothing gives, over its weight"
    ),
    _figure("object_missing_wrench_p95_share", "object missing wrench p95", "%", "The same, over the object's weight"),
    _figure("torque_p95_share", "torque p95", "%", "Torque of the joint that needs most, over its limit", 0),
    _figure("torque_over_limit_share", "frames over torque", "%", "Share of the frames beyond the limits of torques"),
    _figure("one_hand_unheld_s", "one hand cannot hold", "s", "Time in which one hand alone holds what it cannot", 2),
)

_PERSONS = "The same of the person's own hands"
GRIP = (
    _figure("grip_margin_g", "grip margin", "g", "Acceleration of held objects that hands bear", 2, "higher"),
    _figure("person_grip_margin_g", "person's margin", "g", _PERSONS, 2, "higher"),
    _figure("closure_share", "force closure", "%", "Time in which hands resist any small wrench on it", 0, "higher"),
    _figure("person_closure_share", "person's closure", "%", _PERSONS, 0, "higher"),
    _figure("closure_epsilon_share", "closure epsilon", "%", "Least wrench that their unit force resists", 0, "higher"),
    _figure("person_closure_epsilon_share", "person's epsilon", "%", _PERSONS, 0, "higher"),
)


def performed_figures(motion: Motion) -> dict[str, float | None]:
    """Return a simulated motion's deviations [m, deg] from the stage before, over all frames up to a fall, by name.

    There are none of other motions, and none of objects where there are no objects.
    """
    if motion.stages[-1].name != SIMULATED or len(motion.stages) == 1:
        return {}
    reference = motion.at_stage(motion.stages[-2].name)
    target, found = reference.qpos, motion.qpos
    figures: dict[str, float | None] = {
        "reference_root_m": float(np.linalg.norm(found[:, :3] - target[:, :3], axis=1).mean()),
        "reference_root_deg": float(np.degrees(se3.angle_between(found[:, 3:7], target[:, 3:7])).mean()),
        "reference_joint_rad": float(np.abs(found[:, 7:] - target[:, 7:]).mean()),
    }
    if motion.report.performance is not None:
        figures["stood_s"] = motion.report.performance.seconds
    if motion.object_names:
        apart = np.linalg.norm(motion.object_pos - reference.object_pos, axis=2)
        turned = se3.angle_between(motion.object_quat, reference.object_quat)
        figures |= {"reference_object_m": float(apart.mean()), "reference_object_max_m": float(apart.max())}
        figures["reference_object_deg"] = float(np.degrees(turned).mean())
    return figures


PERFORMED = (
    Figure(
        "reference_object_m", "object off reference", "cm", "Mean distance of the simulated object off its reference"
    ),
    Figure("reference_object_max_m", "object off reference max", "cm", "The same at its largest"),
    Figure("reference_object_deg", "object turned off reference", "deg", "Mean angle of the object off its reference"),
    Figure("reference_root_m", "root off reference", "cm", "Mean distance of the simulated root off its reference"),
    Figure("reference_root_deg", "root turned off reference", "deg", "Mean angle of the root off its reference"),
    Figure("reference_joint_rad", "joints off reference", "rad", "Mean angle of joints off their reference", digits=3),
    Figure("stood_s", "time to fall or end", "s", "Time until the simulated robot fell, or the end", better="higher"),
)
"""Figures that only a performed motion has."""
