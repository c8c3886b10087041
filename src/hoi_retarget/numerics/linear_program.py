"""Many small linear programs at once, by an interior-point method (Mehrotra, SIAM Journal on Optimization, 1992)."""

import numpy as np
from jaxtyping import Float

ITERATIONS = 25
TO_BOUNDARY = 0.995  # Share of the way to the nearest bound that a step may take.
LEAST = 1e-6  # Of an unknown, and of a reduced cost, at the start.
TOLERANCE = 1e-6  # Of the mean product of unknowns and their reduced costs, and of the equations.
SCALES, RIDGE, SMALLEST = (1e-12, 1e12), 1e-12, 1e-30
"""Limits of unknowns over reduced costs; what is added to matrices that are scaled to ones on the diagonal, and the
least number there before."""


def least_costs(
    costs: Float[np.ndarray, "N"], matrices: Float[np.ndarray, "B M N"], targets: Float[np.ndarray, "B M"]
) -> Float[np.ndarray, "B N"]:
    """Return the x of least `costs x` with `matrices x = targets` and no x negative.

    Every program must have a solution, and a bounded one. A program that is not solved after `ITERATIONS` ends as near
    as it got.
    """
    x, slack, prices = _start(costs, matrices, targets)
    left, best, least = np.arange(len(targets)), x.copy(), np.full(len(targets), np.inf)
    for _ in range(1 + ITERATIONS):
        lacking = targets - _times(matrices, x)
        reduced = costs - _times(matrices.transpose(0, 2, 1), prices) - slack
        mean = (x * slack).mean(axis=1)
        error = np.maximum(mean, np.maximum(np.abs(lacking).max(axis=1), np.abs(reduced).max(axis=1)))
        nearer = error < least[left]
        best[left[nearer]], least[left[nearer]] = x[nearer], error[nearer]
        open_ = error > TOLERANCE
        if not open_.any():
            break
        left = left[open_]
        x, slack, prices, matrices, targets, lacking, reduced, mean = (
            values[open_] for values in (x, slack, prices, matrices, targets, lacking, reduced, mean)
        )
        scale = np.clip(x / slack, *SCALES)
        inverse = _inverse((matrices * scale[:, None]) @ matrices.transpose(0, 2, 1))
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
    return best


def _start(costs: np.ndarray, matrices: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return unknowns, reduced costs and prices that nearly meet the equations, all the former well above zero.

    Least squares, shifted (Mehrotra, section 7): from ones, targets of hundreds are never reached.
    """
    across = matrices.transpose(0, 2, 1)
    inverse = _inverse(matrices @ across)
    prices = _times(inverse, matrices @ costs)
    x, slack = _times(across, _times(inverse, targets)), costs - _times(across, prices)
    x, slack = (values + np.maximum(-1.5 * values.min(axis=1, keepdims=True), 0.0) for values in (x, slack))
    product = 0.5 * (x * slack).sum(axis=1, keepdims=True)
    moved = (product / np.maximum(other.sum(axis=1, keepdims=True), 1e-12) for other in (slack, x))
    x, slack = (np.maximum(values + way, LEAST) for values, way in zip((x, slack), moved, strict=True))
    return x, slack, prices


def _inverse(matrices: Float[np.ndarray, "B M M"]) -> Float[np.ndarray, "B M M"]:
    """Return the inverses of symmetric matrices, with rows of any sizes."""
    size = np.sqrt(np.maximum(np.einsum("bmm->bm", matrices), SMALLEST))
    sizes = size[:, :, None] * size[:, None]
    return np.linalg.inv(matrices / sizes + RIDGE * np.eye(size.shape[1])) / sizes


def _times(matrices: Float[np.ndarray, "B R C"], vectors: Float[np.ndarray, "B C"]) -> Float[np.ndarray, "B R"]:
    return (matrices @ vectors[:, :, None])[:, :, 0]


def _share_to_bound(values: Float[np.ndarray, "B N"], way: Float[np.ndarray, "B N"]) -> Float[np.ndarray, "B"]:
    """Return the share of a way, at most all of it, at which the first value is zero."""
    return np.minimum(1.0, np.where(way < 0.0, values / np.maximum(-way, 1e-30), np.inf).min(axis=1))
