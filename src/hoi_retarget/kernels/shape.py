"""Solids and surfaces as the compiled library sees them, and the distances of points from them."""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.kernels.library import REAL, WHOLE, at, function, real, whole


class Grid(ctypes.Structure):
    """`Grid` of `kernels.h`."""

    _fields_ = (("origin", 3 * REAL), ("step", REAL), ("shape", 3 * WHOLE), ("values", ctypes.c_void_p))


class Field(ctypes.Structure):
    """`Field` of `kernels.h`."""

    _fields_ = (
        ("origin", 3 * REAL),
        ("edge", REAL),
        ("counts", 3 * WHOLE),
        ("levels", ctypes.c_void_p),
        ("starts", ctypes.c_void_p),
        ("samples", ctypes.c_void_p),
    )


_GRID_QUERY, _FIELD_QUERY = (function(name, "ppiiipp") for name in ("grid_query", "field_query"))


class Shape:
    """A solid or a surface with its samples, as the library sees it; the arrays stay alive with it."""

    def __init__(self, structure: Grid | Field, arrays: Sequence[np.ndarray]) -> None:
        self.structure, self._arrays = structure, tuple(arrays)
        self.address = ctypes.addressof(structure)

    @classmethod
    def of_grid(cls, origin: Float[np.ndarray, "3"], step: float, values: Float[np.ndarray, "X Y Z"]) -> "Shape":
        """Return a solid on a regular grid [m]."""
        values = np.ascontiguousarray(values, dtype=np.float32)
        structure = Grid((3 * REAL)(*origin), step, (3 * WHOLE)(*values.shape), at(values))
        return cls(structure, [values])

    @classmethod
    def of_cells(
        cls,
        origin: Float[np.ndarray, "3"],
        edge: float,
        levels: Int[np.ndarray, "X Y Z"],
        starts: Int[np.ndarray, "C"],
        samples: Float[np.ndarray, "S"],
    ) -> "Shape":
        """Return a surface in cells.

        Args: `origin`: lowest corner of the first cell [m]; `edge`: of a cell [m]; `levels`: of the cells, as `Cells`
        has them; `starts`: first sample of each cell; `samples`: distances [m].
        """
        own = (
            np.ascontiguousarray(levels, dtype=np.int8),
            whole(starts),
            np.ascontiguousarray(samples, dtype=np.float32),
        )
        structure = Field((3 * REAL)(*origin), edge, (3 * WHOLE)(*levels.shape), *map(at, own))
        return cls(structure, own)

    def distances(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K"]:
        """Return the distances of points [m]."""
        return self._query(points, None)

    def distances_and_slopes(
        self, points: Float[np.ndarray, "K 3"]
    ) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
        """Return the distances of points [m], and their derivatives by the points."""
        slopes = np.empty((3, len(points)))
        return self._query(points, slopes), slopes.T

    def _query(self, points: Float[np.ndarray, "K 3"], slopes: np.ndarray | None) -> Float[np.ndarray, "K"]:
        points = np.asarray(points, dtype=np.float64)
        if any(stride % points.itemsize for stride in points.strides):
            points = real(points)
        distances = np.empty(len(points))
        along, across = (stride // points.itemsize for stride in points.strides)
        query = _GRID_QUERY if isinstance(self.structure, Grid) else _FIELD_QUERY
        query(self.address, at(points), along, across, len(points), at(distances), at(slopes))
        return distances


def directions(slopes: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K 3"]:
    """Return slopes at unit length; upwards where there is none."""
    lengths = np.sqrt((slopes**2).sum(axis=1, keepdims=True))
    return np.where(lengths > 1e-9, slopes / np.maximum(lengths, 1e-9), [0.0, 0.0, 1.0])


class SampledDistances:
    """Signed distances [m] that the compiled library interpolates between samples."""

    @cached_property
    def compiled(self) -> Shape:
        """The samples as the library sees them: each kind says its own."""
        raise NotImplementedError

    def distances(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K"]:
        """Return the distances of points [m], negative inside."""
        return self.compiled.distances(points)

    def distances_and_slopes(
        self, points: Float[np.ndarray, "K 3"]
    ) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
        """Return the distances of points [m], and their derivatives by the points."""
        return self.compiled.distances_and_slopes(points)

    def distances_and_normals(
        self, points: Float[np.ndarray, "K 3"]
    ) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
        """Return the distances of points [m], and the directions in which they grow: unit vectors, outwards."""
        distances, slopes = self.distances_and_slopes(points)
        return distances, directions(slopes)


OVERRATED = 1.5  # Beyond its grid, a solid may seem further away than it is by a factor of up to the root of 2.


@dataclass(frozen=True, eq=False)
class DistanceGrid(SampledDistances):
    """Distances [m] from one solid at the nodes of a grid around it; beyond the grid, the way to it is added."""

    origin: Float[np.ndarray, "3"]  # First node [m].
    step: float  # [m]
    values: Float[np.ndarray, "X Y Z"]  # [m], in single precision.

    @cached_property
    def compiled(self) -> Shape:
        """The grid for the compiled library."""
        return Shape.of_grid(self.origin, self.step, self.values)
