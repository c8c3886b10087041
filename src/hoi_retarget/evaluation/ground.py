"""Do feet stand still on the floor, and does nothing sink into it?"""

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.resting import floor_rests
from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.evaluation.statistics import mean_or_none, norms
from hoi_retarget.evaluation.view import Comparison
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import SIDES, SOLE_CORNERS


def stance_slide_mps(view: Comparison) -> float | None:
    """Return the mean horizontal ankle speed [m/s] over pairs of neighbouring stance frames of each foot."""
    speeds = foot_speeds(view.kinematics, view.clip.fps)[view.first :]
    return mean_or_none(speeds[view.stance[1:] & view.stance[:-1]])


def foot_speeds(kinematics: Kinematics, fps: float) -> Float[np.ndarray, "steps 2"]:
    """Return the horizontal speed of each ankle [m/s] from each frame to the next."""
    ankles = np.stack([kinematics.site_position(f"{side}_foot")[:, :2] for side in SIDES], axis=1)
    return norms(np.diff(ankles, axis=0)) * fps


def sole_heights(kinematics: Kinematics) -> Float[np.ndarray, "T 2"]:
    """Return the height of the lowest sole corner of each foot above the floor [m]."""
    corners = [[kinematics.site_position(f"{side}_sole_{corner}")[:, 2] for corner in SOLE_CORNERS] for side in SIDES]
    return np.array(corners).min(axis=1).T


def stance_sole_height_abs_m(view: Comparison) -> float | None:
    """Return the mean distance [m] of the lowest sole corner from the floor, above or below, in stance."""
    return mean_or_none(np.abs(view.once(_counted_heights)[view.stance]))


def stance_float_m(view: Comparison) -> float | None:
    """Return the mean height [m] of the lowest sole corner in stance, a sunken sole counting as zero."""
    return mean_or_none(np.maximum(view.once(_counted_heights)[view.stance], 0.0))


def floor_penetration_max_m(view: Comparison) -> float | None:
    """Return the depth [m] of the deepest sole corner of the clip, in stance or not; zero if none is below."""
    return deepest(view.once(_counted_heights))


def deepest(heights: Float[np.ndarray, "F 2"]) -> float | None:
    """Return the depth [m] of the deepest sole corner; zero if none is below the floor."""
    return float(np.maximum(-heights, 0.0).max()) if heights.size else None


def _counted_heights(view: Comparison) -> Float[np.ndarray, "F 2"]:
    return sole_heights(view.kinematics)[view.first :]


def object_below_floor_m(view: Comparison) -> float | None:
    """Return the depth [m] of the deepest object point of the clip; zero if none is below, None without objects."""
    if view.object_count == 0:
        return None
    return max(0.0, -float(view.once(_object_heights).min()))


def object_float_m(view: Comparison) -> float | None:
    """Return an object's mean height above the floor [m] while the human's rests on it; that of the worst object."""
    rests = floor_rests(view.clip)[:, view.first :]
    if not rests.any():
        return None
    heights = np.maximum(view.once(_object_heights), 0.0)
    return max(float(own[resting].mean()) for own, resting in zip(heights, rests, strict=True) if resting.any())


def _object_heights(view: Comparison) -> Float[np.ndarray, "O F"]:
    """Return the height of each object's lowest point above the floor [m]."""
    return np.array(
        [
            pose.positions[:, 2] + scale * track.geometry.lowest_along(pose.rotations[:, 2])
            for track, pose, scale in zip(view.clip.objects, view.robot_objects, view.motion.object_scale, strict=True)
        ]
    )


STANCE_SLIDE = Figure("stance_slide_mps", "foot slide", "cm/s", 1e2, 1, "lower", stance_slide_mps)
STANCE_SOLE_HEIGHT_ABS = Figure(
    "stance_sole_height_abs_m", "sole height", "mm", 1e3, 1, "lower", stance_sole_height_abs_m
)
STANCE_FLOAT = Figure("stance_float_m", "foot float", "mm", 1e3, 1, "lower", stance_float_m)
FLOOR_PENETRATION_MAX = Figure(
    "floor_penetration_max_m", "floor penetration", "mm", 1e3, 1, "lower", floor_penetration_max_m
)
OBJECT_FLOAT = Figure("object_float_m", "object float", "mm", 1e3, 1, "lower", object_float_m)
OBJECT_BELOW_FLOOR = Figure("object_below_floor_m", "object below floor", "mm", 1e3, 1, "lower", object_below_floor_m)
