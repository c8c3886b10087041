"""Figures by which programs are compared, their means and their paired tests."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import wilcoxon

SCORES = (  # Name, title, factor, digits. All are better the lower, but for touch.
    ("contact_gap_m", "contact-point gap [mm]", 1e3, 1),
    ("body_pose_deviation_deg", "body pose deviation [deg]", 1.0, 1),
    ("link_velocity_direction_deg", "link velocity direction [deg]", 1.0, 1),
    ("relative_hand_rotation_deg", "relative hand orientation change [deg]", 1.0, 1),
    ("body_jerk_mps3", "body jerk [m/s³]", 1.0, 1),
    ("cpu_seconds", "compute time [CPU s/clip]", 1.0, 2),
    ("touch_share", "labelled hands that touch within 2 mm [%]", 1e2, 1),
    ("touch_place_m", "place on the object's surface, off the human's [mm]", 1e3, 0),
    ("penetration_mean_m", "penetration in contact frames, mean [mm]", 1e3, 1),
    ("penetration_max_m", "penetration, deepest of a clip [mm]", 1e3, 1),
    ("self_penetration_max_m", "robot in itself, deepest of a clip [mm]", 1e3, 1),
    ("link_below_floor_m", "any link below the floor, deepest of a clip [mm]", 1e3, 1),
    ("stance_slide_mps", "foot slide in stance [cm/s]", 1e2, 1),
    ("stance_float_m", "soles off the floor in stance [mm]", 1e3, 1),
    ("body_jerk_max_mps3", "largest body jerk of a clip [m/s³]", 1.0, 0),
)
HIGHER_IS_BETTER = {"touch_share"}


def mean(values: Sequence[float | None]) -> float | None:
    """Return the mean of the values that are there."""
    there = [value for value in values if value is not None]
    return float(np.mean(there)) if there else None


def p_value(first: Sequence[float | None], second: Sequence[float | None]) -> float | None:
    """Return the p-value of a paired Wilcoxon test; None where no pair is whole and differs."""
    pairs = [(a, b) for a, b in zip(first, second, strict=True) if a is not None and b is not None and a != b]
    return float(wilcoxon(*np.array(pairs).T).pvalue) if pairs else None
