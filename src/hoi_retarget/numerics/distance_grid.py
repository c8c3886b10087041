"""Signed distances from a solid on a dense regular grid."""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics.trilinear import directions, interpolate, with_slopes

_CORNERS = np.array(list(product((0, 1), repeat=3)))


@dataclass(frozen=True, eq=False)
class DistanceGrid:
    """Distances [m] from one solid, negative inside, at the nodes of a grid that encloses it."""

    origin: Float[np.ndarray, "3"]
    """First node [m]."""
    step: float
    """[m]"""
    values: Float[np.ndarray, "X Y Z"]
    """[m]"""

    def distances(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K"]:
        """Return signed distances [m], trilinear; beyond the grid, the way to it is added."""
        corners, place, beyond = self._cells(points)
        return interpolate(corners, place) + _norms(beyond)

    def distances_and_slopes(
        self, points: Float[np.ndarray, "K 3"]
    ) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
        """Return `distances`, and their derivatives by the points."""
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
    def _flat(self) -> np.ndarray:
        return np.ascontiguousarray(self.values).reshape(-1)

    @cached_property
    def _strides(self) -> np.ndarray:
        _, y, z = self.values.shape
        return np.array([y * z, z, 1])


def _norms(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths of vectors along the first axis."""
    return np.sqrt(np.einsum("ik,ik->k", vectors, vectors))
