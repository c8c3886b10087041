"""Means and extremes that are None where nothing was counted, and angles that are exact near zero."""

import numpy as np
from jaxtyping import Float


def mean_or_none(values: Float[np.ndarray, "..."]) -> float | None:
    """Return the mean of all values; None if there is none."""
    return float(values.mean()) if values.size else None


def max_or_none(values: Float[np.ndarray, "..."]) -> float | None:
    """Return the largest of all values; None if there is none."""
    return float(values.max()) if values.size else None


def finite_min_or_none(values: Float[np.ndarray, "..."]) -> float | None:
    """Return the smallest of all values; None if there is none or all are infinite (no limit)."""
    smallest = values.min() if values.size else np.inf
    return float(smallest) if np.isfinite(smallest) else None


def direction_angles_deg(
    a: Float[np.ndarray, "*batch 3"], b: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch"]:
    """Return the angles [deg] between vectors of any length.

    Kahan's form: unlike the arc cosine of the scalar product it loses no digits near 0 and 180 degrees.
    """
    length_a, length_b = norms(a)[..., None], norms(b)[..., None]
    scaled_a, scaled_b = a * length_b, b * length_a
    return np.degrees(2.0 * np.arctan2(norms(scaled_a - scaled_b), norms(scaled_a + scaled_b)))


def norms(vectors: Float[np.ndarray, "*batch K"]) -> Float[np.ndarray, "*batch"]:
    """Return the lengths of vectors along the last axis."""
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
