"""Could a robot perform it? Figures of the forces that a motion needs (`physics/forces.py`), over all frames."""

from collections.abc import Callable

import numpy as np

from hoi_retarget.errors import RobotError
from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.evaluation.view import Comparison
from hoi_retarget.motion.motion import Motion
from hoi_retarget.physics.feasibility import forces_on_clip, over_torque, unheld_by_one
from hoi_retarget.physics.forces import Forces

_PERCENTILE = 95


def forces_figures(forces: Forces, motion: Motion) -> dict[str, float | None]:
    """Return the figures of the forces that a motion needs, by name; None where undefined."""
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


def _of_view(view: Comparison) -> dict[str, float | None]:
    try:
        forces = forces_on_clip(view.motion, view.clip, view.kinematics.model)
    except RobotError:  # A base carries the robot, or a joint's torque has no limit.
        return {}
    return forces_figures(forces, view.motion)


def _named(name: str) -> Callable[[Comparison], float | None]:
    return lambda view: view.once(_of_view).get(name)


def _figure(name: str, title: str, unit: str, scale: float, digits: int) -> Figure:
    return Figure(name, title, unit, scale, digits, "lower", _named(name))


FEASIBILITY = (
    _figure("missing_wrench_p95_share", "missing wrench p95", "%", 1e2, 1),
    _figure("object_missing_wrench_p95_share", "object missing wrench p95", "%", 1e2, 1),
    _figure("torque_p95_share", "torque p95", "%", 1e2, 0),
    _figure("torque_over_limit_share", "frames over torque", "%", 1e2, 1),
    _figure("one_hand_unheld_s", "one hand cannot hold", "s", 1.0, 2),
)
