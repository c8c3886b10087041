"""Signed distances from a solid on a dense regular grid, interpolated trilinearly between the corners of its cells."""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from jaxtyping import Float

from hoi_retarget.kernels.library import COMPILED
from hoi_retarget.kernels.shape import Shape


def interpolate(corners: Float[np.ndarray, "8 K"], place: Float[np.ndarray, "3 K"]) -> Float[np.ndarray, "K"]:
    """Return the values, in the unit of the corners, at places within cells.

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
    """Return the values, in the corners' unit, at places within cells, and their derivatives by the place."""
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


_CORNERS = np.array(list(product((0, 1), repeat=3)))


@dataclass(frozen=True, eq=False)
class DistanceGrid:
    """Distances [m] from one solid, negative inside, at the nodes of a grid that encloses it."""

    origin: Float[np.ndarray, "3"]
    """First node [m]."""
    step: float
    """[m]"""
    values: Float[np.ndarray, "X Y Z"]
    """[m], in single precision."""

    def distances(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K"]:
        """Return signed distances [m], trilinear; beyond the grid, the way to it is added."""
        if COMPILED:
            return self.compiled.distances(points)
        corners, place, beyond = self._cells(points)
        return interpolate(corners, place) + _norms(beyond)

    def distances_and_slopes(
        self, points: Float[np.ndarray, "K 3"]
    ) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
        """Return `distances` [m], and their derivatives by the points [unitless]."""
        if COMPILED:
            return self.compiled.distances_and_slopes(points)
        corners, place, beyond = self._cells(points)
        distances, slopes = with_slopes(corners, place)
        away = _norms(beyond)
        # Beyond the grid, along an axis, only the way to it grows.
        slopes = np.where(beyond != 0.0, 0.0, slopes / self.step) + beyond / np.maximum(away, 1e-12)
        return distances + away, slopes.T

    def distances_and_normals(
        self, points: Float[np.ndarray, "K 3"]
    ) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
        """Return `distances`, and the directions in which they grow: unit vectors, which point out of the solid."""
        distances, slopes = self.distances_and_slopes(points)
        return distances, directions(slopes)

    def nearest_distances(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K"]:
        """Return the distance [m] of the nearest node: off by no more than the way to it."""
        last = np.array(self.values.shape) - 1
        at = np.clip(np.rint((points - self.origin) / self.step), 0, last)
        nodes = at.astype(np.int64) @ self._strides
        return self._flat[nodes] + _norms((np.asarray(points) - (self.origin + self.step * at)).T) * (
            (points < self.origin) | (points > self.origin + self.step * last)
        ).any(axis=1)

    def _cells(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return values around points, places between them from 0 to 1, and the way to the grid [m], by axes."""
        last = np.array(self.values.shape)[:, None] - 1
        at = (np.asarray(points, dtype=float).T - self.origin[:, None]) / self.step
        inside = np.clip(at, 0.0, last)
        first = np.minimum(inside.astype(np.int64), last - 1)
        corners = self._strides @ first + (_CORNERS @ self._strides)[:, None]
        return self._flat[corners], inside - first, (at - inside) * self.step

    @cached_property
    def compiled(self) -> Shape:
        """The grid for the compiled library."""
        return Shape.of_grid(self.origin, self.step, self.values)

    @cached_property
    def _flat(self) -> np.ndarray:
        return np.ascontiguousarray(self.values).reshape(-1)

    @cached_property
    def _strides(self) -> np.ndarray:
        _, y, z = self.values.shape
        return np.array([y * z, z, 1])


def _norms(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths of vectors along the first axis."""
    return np.sqrt(np.einsum("ik,ik->k", vectors, vectors))
