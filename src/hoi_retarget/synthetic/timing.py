"""Smooth functions of time: everything that moves in a synthetic clip is a sum of these.

All are twice continuously differentiable, so velocities and accelerations have no jumps,
and they are functions of continuous time, so any frame rate samples the same motion.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

Times = Float[np.ndarray, "T"]


def minimum_jerk(times: Times, start: float, end: float) -> Times:
    """Return a rise from 0 at `start` [s] to 1 at `end` [s] that begins and ends at rest."""
    phase = np.clip((times - start) / (end - start), 0.0, 1.0)
    return phase**3 * (10.0 + phase * (6.0 * phase - 15.0))


def bump(times: Times, start: float, end: float) -> Times:
    """Return a hump between `start` [s] and `end` [s], 1 in the middle and 0 outside."""
    phase = np.clip((times - start) / (end - start), 0.0, 1.0)
    return (4.0 * phase * (1.0 - phase)) ** 3


def keyed(times: Times, keys: Sequence[tuple[float, float]]) -> Times:
    """Return values that pass through `(time [s], value)` keys in order of time, resting at each."""
    values = np.full(times.shape, keys[0][1])
    for (start, before), (end, after) in pairwise(keys):
        if after != before:
            values += (after - before) * minimum_jerk(times, start, end)
    return values


def soft_excess(values: np.ndarray, width: float) -> np.ndarray:
    """Return a smooth version of `max(values, 0)` that rounds the corner over about `width`."""
    return width * np.logaddexp(0.0, values / width)
