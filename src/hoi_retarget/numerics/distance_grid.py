"""Signed distances from a solid on a dense regular grid."""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from jaxtyping import Float

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
        corners, fraction, beyond = self._cells(points)
        weights = np.where(_CORNERS, fraction[:, None], 1.0 - fraction[:, None]).prod(axis=2)
        return (self._flat[corners] * weights).sum(axis=1) + _norms(beyond)

    def distances_and_normals(
        self, points: Float[np.ndarray, "K 3"]
    ) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
        """Return `distances`, and their gradients at unit length, which point out of the solid."""
        corners, fraction, beyond = self._cells(points)
        values = self._flat[corners]
        sides = np.where(_CORNERS, fraction[:, None], 1.0 - fraction[:, None])
        away = _norms(beyond)
        signs = 2.0 * _CORNERS - 1.0
        x, y, z = np.moveaxis(sides, 2, 0)
        slopes = np.stack(
            [(values * signs[:, 0] * y * z), (values * signs[:, 1] * x * z), (values * signs[:, 2] * x * y)]
        )
        gradient = slopes.sum(axis=2).T / self.step
        # Beyond the grid the field rises along the way from it.
        gradient = np.where(beyond != 0.0, beyond / np.maximum(away, 1e-12)[:, None], gradient)
        lengths = _norms(gradient)
        up = np.array([0.0, 0.0, 1.0])
        normals = np.where(lengths[:, None] > 1e-9, gradient / np.maximum(lengths, 1e-9)[:, None], up)
        return (values * x * y * z).sum(axis=1) + away, normals

    def nearest_distances(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K"]:
        """Return the distance [m] of the nearest node: off by no more than the way to it."""
        last = np.array(self.values.shape) - 1
        at = np.clip(np.rint((points - self.origin) / self.step), 0, last)
        nodes = at.astype(np.int64) @ self._strides
        return self._flat[nodes] + _norms(np.asarray(points) - (self.origin + self.step * at)) * (
            (points < self.origin) | (points > self.origin + self.step * last)
        ).any(axis=1)

    def _cells(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the corners of the cells of points, places within them from 0 to 1, and the way to the grid [m]."""
        last = np.array(self.values.shape) - 1
        at = (np.asarray(points, dtype=float) - self.origin) / self.step
        inside = np.clip(at, 0.0, last)
        first = np.minimum(inside.astype(np.int64), last - 1)
        corners = (first @ self._strides)[:, None] + _CORNERS @ self._strides
        return corners, inside - first, (at - inside) * self.step

    @cached_property
    def _flat(self) -> np.ndarray:
        return np.ascontiguousarray(self.values).reshape(-1)

    @cached_property
    def _strides(self) -> np.ndarray:
        _, y, z = self.values.shape
        return np.array([y * z, z, 1])


def _norms(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("ki,ki->k", vectors, vectors))
