"""Velocities and accelerations of a motion: those of cubics that are fitted to a few frames around each.

Configurations are those of the cubics, too, so that all three belong together.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3

_ORDER = 3


@dataclass(frozen=True, eq=False)
class Movement:
    """A free body with n joints over T frames, in MuJoCo's coordinates: angular ones are along the body's axes."""

    qpos: Float[np.ndarray, "T nq"]
    """Position [m], rotation wxyz, joints [rad]."""
    qvel: Float[np.ndarray, "T nv"]
    qacc: Float[np.ndarray, "T nv"]


def movement_of(qpos: Float[np.ndarray, "T nq"], fps: float, seconds: float) -> Movement:
    """Return the movement along configurations, smoothed over a time; motions of two frames and fewer are at rest."""
    quats = se3.quat_continuous(qpos[:, 3:7])
    path = np.concatenate([qpos[:, :3], quats, qpos[:, 7:]], axis=1)
    value, first, second = (_fitted(path, fps, seconds, order) for order in range(3))
    square = np.sum(value[:, 3:7] ** 2, axis=1, keepdims=True)
    # Fitted quaternions are no unit ones: what turns is their direction.
    back = se3.quat_conjugate(value[:, 3:7]) / square
    turning = 2.0 * se3.quat_multiply(back, first[:, 3:7])[:, 1:]
    growth = 2.0 * np.sum(value[:, 3:7] * first[:, 3:7], axis=1, keepdims=True) / square
    turning_faster = 2.0 * se3.quat_multiply(back, second[:, 3:7])[:, 1:] - growth * turning
    value[:, 3:7] /= np.sqrt(square)
    return Movement(
        value,
        np.concatenate([first[:, :3], turning, first[:, 7:]], axis=1),
        np.concatenate([second[:, :3], turning_faster, second[:, 7:]], axis=1),
    )


def _fitted(path: np.ndarray, fps: float, seconds: float, derivative: int) -> np.ndarray:
    """Return a derivative of the cubics."""
    from scipy.signal import savgol_filter  # noqa: PLC0415  # as in numerics/filters.py

    frames = len(path)
    window = min(2 * round(0.5 * (seconds * fps - 1.0)) + 1, frames - 1 + frames % 2)
    window = max(window, min(_ORDER + 2, frames - 1 + frames % 2))
    if window < 3:
        return path.copy() if derivative == 0 else np.zeros_like(path)
    order = min(_ORDER, window - 1)
    return np.asarray(savgol_filter(path, window, order, deriv=derivative, delta=1.0 / fps, axis=0))
