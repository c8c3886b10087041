"""Trilinear interpolation between the eight corners of cells, for many places at once."""

import numpy as np
from jaxtyping import Float


def interpolate(corners: Float[np.ndarray, "8 K"], place: Float[np.ndarray, "3 K"]) -> Float[np.ndarray, "K"]:
    """Return the values at places within cells.

    Args:
        corners: Values at the corners; the z coordinate runs fastest.
        place: From 0 to 1 along each axis.
    """
    x, y, z = place
    along_z = corners[0::2] + z * (corners[1::2] - corners[0::2])
    along_y = along_z[0::2] + y * (along_z[1::2] - along_z[0::2])
    return along_y[0] + x * (along_y[1] - along_y[0])


def with_slopes(
    corners: Float[np.ndarray, "8 K"], place: Float[np.ndarray, "3 K"]
) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "3 K"]]:
    """Return the values at places within cells, and their derivatives by the place."""
    x, y, z = place
    by_z = corners[1::2] - corners[0::2]
    along_z = corners[0::2] + z * by_z
    by_y = along_z[1::2] - along_z[0::2]
    along_y = along_z[0::2] + y * by_y
    by_x = along_y[1] - along_y[0]
    by_z = by_z[0::2] + y * (by_z[1::2] - by_z[0::2])
    slopes = np.stack([by_x, by_y[0] + x * (by_y[1] - by_y[0]), by_z[0] + x * (by_z[1] - by_z[0])])
    return along_y[0] + x * by_x, slopes


def directions(slopes: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K 3"]:
    """Return slopes at unit length; upwards where there is none."""
    lengths = np.sqrt((slopes**2).sum(axis=1, keepdims=True))
    return np.where(lengths > 1e-9, slopes / np.maximum(lengths, 1e-9), [0.0, 0.0, 1.0])
