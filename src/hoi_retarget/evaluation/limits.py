"""How far the motion stays inside the joints' ranges and speeds.

These two look at every frame, the first one too: a limit is a promise, not a comparison.
"""

import numpy as np
from jaxtyping import Float

from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.evaluation.statistics import finite_min_or_none
from hoi_retarget.evaluation.view import Comparison
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots.model import RobotModel


def joint_range_margin_rad(view: Comparison) -> float | None:
    """Return the smallest distance [rad] of any joint to the end of its range; negative where it is violated."""
    return finite_min_or_none(joint_range_margins(view.motion, view.kinematics.model))


def joint_speed_margin_radps(view: Comparison) -> float | None:
    """Return the smallest limit minus speed [rad/s] of any joint; negative where it is violated."""
    return finite_min_or_none(joint_speed_margins(view.motion, view.kinematics.model))


def joint_range_margins(motion: Motion, model: RobotModel) -> Float[np.ndarray, "T n"]:
    """Return the distance [rad] of every joint to the nearer end of its range, in every frame."""
    angles = motion.qpos[:, 7:]
    return np.minimum(angles - model.lower, model.upper - angles)


def joint_speed_margins(motion: Motion, model: RobotModel) -> Float[np.ndarray, "steps n"]:
    """Return the limit minus speed [rad/s] of every joint, from each frame to the next."""
    return model.speed_limits - np.abs(np.diff(motion.qpos[:, 7:], axis=0)) * motion.fps


JOINT_RANGE_MARGIN = Figure("joint_range_margin_rad", "range margin", "rad", 1.0, 3, "higher", joint_range_margin_rad)
JOINT_SPEED_MARGIN = Figure(
    "joint_speed_margin_radps", "speed margin", "rad/s", 1.0, 2, "higher", joint_speed_margin_radps
)
