"""Points of surfaces in cells, those of them that are near solids, and skin that is near surfaces."""

import ctypes
from collections.abc import Sequence
from math import prod
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.kernels.library import REAL, WHOLE, at, function, real, whole
from hoi_retarget.kernels.shape import Shape

_CELL, _MOST_CELLS = 0.03, 200  # [m] of a cell of points; along an edge.
_NEAREST_SAMPLES = function("nearest_samples", "pppppiddidpp", allocates=True)
_DEEPEST_SAMPLES = function("deepest_samples", "pppppidp")
_INSIDE_SUMS = function("inside_sums", "ppppppidpp")
_WAYS_OUT = function("ways_out", "ppppppidpdddpp", allocates=True)
_NEAREST_SKIN = function("nearest_skin", "ppippppippiddidppp", allocates=True)


class Samples(ctypes.Structure):
    """`Samples` of `kernels.h`."""

    _fields_ = (
        ("origin", 3 * REAL),
        ("edge", REAL),
        ("counts", 3 * WHOLE),
        ("total", WHOLE),
        ("starts", ctypes.c_void_p),
        ("indices", ctypes.c_void_p),
        ("points", ctypes.c_void_p),
    )


class Placed(NamedTuple):
    """A solid in N poses, and a ball around it, in the frame of the points."""

    solid: Shape
    rotations: Float[np.ndarray, "N 3 3"]
    origins: Float[np.ndarray, "N 3"]  # [m]
    centres: Float[np.ndarray, "N 3"]  # [m]
    radius: float  # [m]


class PointCells:
    """Points of a surface sorted by cubic cells, as the library sees them."""

    def __init__(self, structure: Samples, arrays: Sequence[np.ndarray]) -> None:
        self._structure, self._arrays = structure, tuple(arrays)
        self._address = ctypes.addressof(structure)

    @classmethod
    def of(cls, points: Float[np.ndarray, "K 3"]) -> "PointCells":
        """Return the points [m] in cells."""
        lowest = points.min(axis=0) if len(points) else np.zeros(3)
        size = np.ptp(points, axis=0) if len(points) else np.zeros(3)
        edge = max(_CELL, float(size.max()) / _MOST_CELLS)
        counts = [int(length / edge) + 1 for length in size]
        cell = np.asarray(np.ravel_multi_index(tuple(((points - lowest) / edge).astype(np.int64).T), counts))
        order = np.argsort(cell, kind="stable")
        starts = np.searchsorted(cell[order], np.arange(prod(counts) + 1))
        arrays = starts.astype(np.int64), order.astype(np.int64), real(points[order])
        place = (3 * REAL)(*lowest), edge, (3 * WHOLE)(*counts), len(points)
        return cls(Samples(*place, *map(at, arrays)), arrays)

    def nearest(
        self, placed: Placed, near: float, count: int, apart: float
    ) -> tuple[Int[np.ndarray, "N K"], Int[np.ndarray, "N"]]:
        """Return the points nearest to a solid in each pose, and their number.

        There are `count` at most, none further than `near` [m], and any two are `apart` or more [m].
        """
        poses = len(placed.origins)
        chosen, number = np.zeros((poses, count), dtype=np.int64), np.zeros(poses, dtype=np.int64)
        own = [real(part) for part in placed[1:4]]
        found = at(chosen), at(number)
        _NEAREST_SAMPLES(*self._both(placed), *map(at, own), poses, placed.radius, near, count, apart, *found)
        return chosen, number

    def deepest(self, placed: Placed) -> Float[np.ndarray, "N"]:
        """Return the least of the distances from a solid in each pose [m]."""
        own, least = [real(part) for part in placed[1:4]], np.empty(len(placed.origins))
        _DEEPEST_SAMPLES(*self._both(placed), *map(at, own), len(least), placed.radius, at(least))
        return least

    def inside(
        self, placed: Placed, pivots: Float[np.ndarray, "N 3"]
    ) -> tuple[Float[np.ndarray, "N 6 6"], Float[np.ndarray, "N 6"]]:
        """Return squares and products of the distances of points inside a solid, by its twist about pivots [m]."""
        own, poses = [real(part) for part in (*placed[1:4], pivots)], len(pivots)
        squares, products = np.zeros((poses, 6, 6)), np.zeros((poses, 6))
        _INSIDE_SUMS(*self._both(placed), *map(at, own), poses, placed.radius, at(squares), at(products))
        return squares, products

    def ways_out(
        self,
        placed: Placed,
        middle: Float[np.ndarray, "3"],
        directions: Float[np.ndarray, "N 3"],
        limits: tuple[float, float, float],
    ) -> tuple[Float[np.ndarray, "N"], Float[np.ndarray, "N 3"]]:
        """Return the lengths [m] of a solid's ways along directions until no point is in it, and its nearest points.

        `limits`: longest way and least step [m], and the factor by which the solid may overrate distances. `middle` is
        that of the ball, in the solid's frame [m].
        """
        own, along = [real(part) for part in (*placed[1:4], middle)], real(directions)
        ways, nearest = np.empty(len(along)), np.empty((len(along), 3))
        found = at(ways), at(nearest)
        _WAYS_OUT(*self._both(placed), *map(at, own), len(along), placed.radius, at(along), *limits, *found)
        return ways, nearest

    def _both(self, placed: Placed) -> tuple[int, int]:
        return self._address, placed.solid.address


def nearest_skin(  # noqa: PLR0913  # the parts of a skin, and what is asked of it
    surface: Shape,
    points: Float[np.ndarray, "P 3"],
    patches: tuple[Int[np.ndarray, "P"], Int[np.ndarray, "C"], Int[np.ndarray, "C"], Float[np.ndarray, "C"]],
    poses: tuple[Float[np.ndarray, "F 3 3"], Float[np.ndarray, "F 3"]],
    *,
    near: float,
    spread: float,
    count: int,
    apart: float,
) -> tuple[Int[np.ndarray, "F K"], Float[np.ndarray, "F"], Float[np.ndarray, "F"]]:
    """Return the points of a skin that are nearest to a surface, spread; their least distance [m], and a lower bound.

    Args: `surface`: in its own frame; `points`: of the skin, in the link's frame [m]; `patches`: order of the points by
    patches; first and number of points of each, and its radius [m]; `poses`: rotations and origins of the link on the
    surface [m]; `near`: patches that are further away are not looked at [m],; `spread`: and neither are those that are
    so much further than the nearest one [m]; `count`: points in each pose; `apart`: least distance between two of them
    [m].
    """
    points, order, firsts, counts = real(points), *(whole(part) for part in patches[:3])
    own, radii = [real(part) for part in poses], real(patches[3])
    chosen, found = np.empty((len(own[1]), count), dtype=np.int64), np.empty((2, len(own[1])))
    _NEAREST_SKIN(
        surface.address, at(points), len(points), *map(at, (order, firsts, counts, radii)), len(counts),
        *map(at, own), len(own[1]), near, spread, count, apart, at(chosen), at(found[0]), at(found[1]),
    )  # fmt: skip
    return chosen, found[0], found[1]
