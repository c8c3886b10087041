"""Sizes of contact forces in one frame: non-negative least squares, with limits on torques."""

import numpy as np
from jaxtyping import Float

_EFFORT, _SIZE = 1e-3, 1e-4
"""What a torque at its limit, and a force of the robot's weight, weigh against a missing weight."""
_LIMIT = 10.0
"""What a torque of twice its limit weighs against a missing weight."""
_AT_LIMIT = 1.0 - 1e-3
_MOST_ROUNDS = 6  # In which joints at their limits are found.


def least_sizes(
    hard: Float[np.ndarray, "H N"],
    wanted: Float[np.ndarray, "H"],
    effort: Float[np.ndarray, "n N"],
    held: Float[np.ndarray, "n"],
) -> tuple[Float[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Return the sizes of forces, none negative.

    They come nearest to `hard x = wanted`, with `held - effort x` between -1 and 1 where that can be had; of all such
    sizes they are those of least effort. The second ones are without that limit.
    """
    rows, targets = hard, wanted
    unlimited = sizes = _of_least_effort(rows, targets, effort, held)
    for _ in range(_MOST_ROUNDS):
        share = held - effort @ sizes
        over = np.abs(share) > _AT_LIMIT
        signs = np.sign(share[over])
        changed = np.concatenate([hard, _LIMIT * effort[over]])
        if changed.shape == rows.shape and (changed == rows).all():
            break
        rows, targets = changed, np.concatenate([wanted, _LIMIT * (held[over] - signs)])
        sizes = _of_least_effort(rows, targets, effort, held)
    return sizes, unlimited


def _of_least_effort(
    rows: Float[np.ndarray, "H N"],
    targets: Float[np.ndarray, "H"],
    effort: Float[np.ndarray, "n N"],
    held: Float[np.ndarray, "n"],
) -> Float[np.ndarray, "N"]:
    from scipy.optimize import nnls  # noqa: PLC0415  # takes a quarter of a second

    columns = rows.shape[1]
    weak = np.concatenate([rows, _EFFORT * effort, _SIZE * np.eye(columns)])
    sizes, _ = nnls(weak, np.concatenate([targets, _EFFORT * held, np.zeros(columns)]), maxiter=30 * columns)
    # The targets gave way a little to effort. What can be had of them is put right, in proportion to each force.
    used = sizes > 0.0
    change = np.linalg.lstsq(rows[:, used] * sizes[used], targets - rows @ sizes, rcond=1e-9)[0]
    if (np.abs(change) < 1.0).all():
        sizes[used] *= 1.0 + change
    return sizes
