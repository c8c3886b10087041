"""Does nothing go through anything: robot and objects, the robot and itself, any link and the floor?"""

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.evaluation.link_heights import link_heights
from hoi_retarget.evaluation.self_penetration import self_depths
from hoi_retarget.evaluation.statistics import max_or_none, mean_or_none
from hoi_retarget.evaluation.surface_curves import surface_curves
from hoi_retarget.evaluation.view import Comparison
from hoi_retarget.robots.skin import skin_of


def penetration_mean_m(view: Comparison) -> float | None:
    """Return the mean over contact frames of the deepest penetration of any link and any object [m], both ways."""
    depths = _penetration(view)
    return mean_or_none(depths[contact_frames(view)]) if depths is not None else None


def penetration_p95_m(view: Comparison) -> float | None:
    """Return the 95th percentile of that depth over all frames, in contact or not [m]; None without objects."""
    depths = _penetration(view)
    return float(np.percentile(depths, 95)) if depths is not None and depths.size else None


def penetration_max_m(view: Comparison) -> float | None:
    """Return the largest such depth of the clip [m]; None without objects."""
    depths = _penetration(view)
    return max_or_none(depths) if depths is not None else None


def self_penetration_max_m(view: Comparison) -> float | None:
    """Return how deep any link is in another one, at most over the clip [m]."""
    depths, _, _ = view.once(_self_depths)
    return max_or_none(depths) if skin_of(view.kinematics.model).links else None


def robot_penetration_max_m(view: Comparison) -> float | None:
    """Return how deep the robot is in another person's robot [m], as its report tells; the other is not in view."""
    return view.motion.report.figures.get("robot_penetration_max_m")


def link_below_floor_m(view: Comparison) -> float | None:
    """Return the depth [m] of the lowest skin point of any link, soles included; zero if none is below the floor."""
    return max_or_none(np.maximum(-view.once(_heights), 0.0))


def contact_frames(view: Comparison) -> Bool[np.ndarray, "F"]:
    """Return in which frames the recording says that the person touches an object."""
    touching = np.zeros(view.clip.frames - view.first, dtype=bool)
    for track in view.clip.contacts:
        if track.person == view.person:
            touching |= track.active[view.first :]
    return touching


def _penetration(view: Comparison) -> Float[np.ndarray, "F"] | None:
    curves = view.once(surface_curves)
    return curves.penetration if curves.depth.size else None


def _self_depths(view: Comparison) -> tuple[np.ndarray, np.ndarray, tuple[tuple[str, str], ...]]:
    return self_depths(view.kinematics, view.first)


def _heights(view: Comparison) -> Float[np.ndarray, "L F"]:
    return link_heights(view.kinematics, view.first)


PENETRATION_MEAN = Figure("penetration_mean_m", "penetration", "mm", 1e3, 1, "lower", penetration_mean_m)
PENETRATION_P95 = Figure("penetration_p95_m", "penetration p95", "mm", 1e3, 1, "lower", penetration_p95_m)
PENETRATION_MAX = Figure("penetration_max_m", "penetration max", "mm", 1e3, 1, "lower", penetration_max_m)
SELF_PENETRATION_MAX = Figure(
    "self_penetration_max_m", "self-penetration", "mm", 1e3, 1, "lower", self_penetration_max_m
)
ROBOT_PENETRATION_MAX = Figure(
    "robot_penetration_max_m", "in another robot", "mm", 1e3, 1, "lower", robot_penetration_max_m
)
LINK_BELOW_FLOOR = Figure("link_below_floor_m", "link below floor", "mm", 1e3, 1, "lower", link_below_floor_m)
