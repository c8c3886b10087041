"""Many small linear programs at once, by an interior-point method (Mehrotra, SIAM Journal on Optimization, 1992)."""

import numpy as np
from jaxtyping import Float

ITERATIONS = 25
TO_BOUNDARY = 0.995  # Share of the way to the nearest bound that a step may take.
TOLERANCE = 1e-6  # Of the mean product of unknowns and their reduced costs, and of the equations.
SCALES, RIDGE = (1e-12, 1e12), 1e-13
"""Limits of unknowns over reduced costs, and the least curvature, over the sum of all, that is taken for one."""


def least_costs(
    costs: Float[np.ndarray, "N"], matrices: Float[np.ndarray, "B M N"], targets: Float[np.ndarray, "B M"]
) -> Float[np.ndarray, "B N"]:
    """Return the x of least `costs x` with `matrices x = targets` and no x negative.

    Every program must have a solution, and a bounded one. Numbers should be of the order of one. A program that is not
    solved after `ITERATIONS` ends as near as it got.
    """
    x, slack, prices = np.ones_like(matrices[:, 0]), np.ones_like(matrices[:, 0]), np.zeros_like(targets)
    left, best = np.arange(len(targets)), np.ones_like(matrices[:, 0])
    for _ in range(ITERATIONS):
        lacking = targets - _times(matrices, x)
        reduced = costs - _times(matrices.transpose(0, 2, 1), prices) - slack
        mean = (x * slack).mean(axis=1)
        open_ = np.maximum(mean, np.maximum(np.abs(lacking).max(axis=1), np.abs(reduced).max(axis=1))) > TOLERANCE
        if not open_.any():
            break
        left = left[open_]
        x, slack, prices, matrices, targets, lacking, reduced, mean = (
            values[open_] for values in (x, slack, prices, matrices, targets, lacking, reduced, mean)
        )
        scale = np.clip(x / slack, *SCALES)
        normal = (matrices * scale[:, None]) @ matrices.transpose(0, 2, 1)
        normal += RIDGE * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(targets.shape[1])
        inverse = np.linalg.inv(normal)
        aim, step = -x * slack, (x, slack)
        for last in (False, True):
            change = aim / slack
            rows = lacking + _times(matrices, scale * reduced - change)
            moved = _times(inverse, rows)
            back = _times(matrices.transpose(0, 2, 1), moved)
            step = scale * (back - reduced) + change, reduced - back
            shares = [_share_to_bound(values, way)[:, None] for values, way in zip((x, slack), step, strict=True)]
            if not last:
                after = ((x + shares[0] * step[0]) * (slack + shares[1] * step[1])).mean(axis=1)
                centre = (after / mean) ** 3 * mean
                aim = centre[:, None] - x * slack - step[0] * step[1]
        x = x + TO_BOUNDARY * shares[0] * step[0]
        slack = slack + TO_BOUNDARY * shares[1] * step[1]
        prices = prices + TO_BOUNDARY * shares[1] * moved
        best[left] = x
    return best


def _times(matrices: Float[np.ndarray, "B R C"], vectors: Float[np.ndarray, "B C"]) -> Float[np.ndarray, "B R"]:
    return (matrices @ vectors[:, :, None])[:, :, 0]


def _share_to_bound(values: Float[np.ndarray, "B N"], way: Float[np.ndarray, "B N"]) -> Float[np.ndarray, "B"]:
    """Return the share of a way, at most all of it, at which the first value is zero."""
    return np.minimum(1.0, np.where(way < 0.0, values / np.maximum(-way, 1e-30), np.inf).min(axis=1))
