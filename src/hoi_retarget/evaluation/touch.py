"""Does the robot's skin touch the object's surface, neither off it nor sunk into it, and at the human's place?"""

import numpy as np
from jaxtyping import Float

from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.evaluation.statistics import mean_or_none
from hoi_retarget.evaluation.surface_curves import TouchCurve, surface_curves
from hoi_retarget.evaluation.view import FOOT_SITES, HAND_SITES, Comparison

TOUCHING = 2e-3
"""A gap up to this [m], off the surface or sunk into it, is touch."""


def touch_share(view: Comparison) -> float | None:
    """Return in which share of the labelled frames of hands the gap is at most `TOUCHING`, sunk and off alike."""
    return _touching(_gaps(view, HAND_SITES))


def touch_gap_p95_m(view: Comparison) -> float | None:
    """Return the 95th percentile of the gap's size [m] over the labelled frames of hands, sunk and off alike."""
    gaps = _gaps(view, HAND_SITES)
    return float(np.percentile(np.abs(gaps), 95)) if gaps.size else None


def touch_place_m(view: Comparison) -> float | None:
    """Return the mean distance on the object [m] from where hands touch to where the human's palms do."""
    return mean_or_none(_pooled([curve.place[curve.active] for curve in _curves(view, HAND_SITES)]))


def foot_touch_share(view: Comparison) -> float | None:
    """Return `touch_share` of feet that are labelled to touch an object."""
    return _touching(_gaps(view, FOOT_SITES))


def foot_touch_gap_p95_m(view: Comparison) -> float | None:
    """Return `touch_gap_p95_m` of feet that are labelled to touch an object."""
    gaps = _gaps(view, FOOT_SITES)
    return float(np.percentile(np.abs(gaps), 95)) if gaps.size else None


def _curves(view: Comparison, parts: dict[str, str]) -> list[TouchCurve]:
    return [curve for curve in view.once(surface_curves).touches if curve.part in parts]


def _gaps(view: Comparison, parts: dict[str, str]) -> Float[np.ndarray, "K"]:
    return _pooled([curve.gap[curve.active] for curve in _curves(view, parts)])


def _pooled(arrays: list[np.ndarray]) -> Float[np.ndarray, "K"]:
    return np.concatenate([np.zeros(0), *arrays])


def _touching(gaps: Float[np.ndarray, "K"]) -> float | None:
    return mean_or_none((np.abs(gaps) <= TOUCHING).astype(float))


TOUCH_SHARE = Figure("touch_share", "touch", "%", 1e2, 1, "higher", touch_share)
TOUCH_GAP_P95 = Figure("touch_gap_p95_m", "touch gap p95", "mm", 1e3, 1, "lower", touch_gap_p95_m)
TOUCH_PLACE = Figure("touch_place_m", "touch place", "mm", 1e3, 1, "lower", touch_place_m)
FOOT_TOUCH_SHARE = Figure("foot_touch_share", "foot touch", "%", 1e2, 1, "higher", foot_touch_share)
FOOT_TOUCH_GAP_P95 = Figure("foot_touch_gap_p95_m", "foot touch gap p95", "mm", 1e3, 1, "lower", foot_touch_gap_p95_m)
