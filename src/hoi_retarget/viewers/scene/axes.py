"""Axes of frames: x red, y green, z blue."""

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.viewers.scene.drawing import Colour, Kind, Shapes

COLOURS: tuple[Colour, ...] = ((205, 60, 55), (70, 160, 75), (60, 100, 200))


def axes(
    positions: Float[np.ndarray, "T K 3"], quats: Float[np.ndarray, "T K 4"], length: float, radius: float
) -> Shapes:
    """Return the axes of K frames over time, as cylinders of a length and a radius [m]."""
    frames, count = positions.shape[:2]
    half = 0.5 * length
    turns = se3.exp(0.5 * np.pi * np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    places = positions[:, :, None] + se3.rotate(quats[:, :, None], half * np.eye(3))
    return Shapes(
        kind=Kind.CYLINDER,
        sizes=np.tile(np.array([radius, radius, half], dtype=np.float32), (3 * count, 1)),
        colours=np.tile(np.array(COLOURS, dtype=np.uint8), (count, 1)),
        positions=places.reshape(frames, 3 * count, 3).astype(np.float32),
        quats=se3.quat_multiply(quats[:, :, None], turns).reshape(frames, 3 * count, 4).astype(np.float32),
    )
