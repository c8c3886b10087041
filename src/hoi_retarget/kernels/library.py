"""The compiled library, and calls of it with arrays."""

import ctypes
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import ArgumentError

NAME = {"win32": "kernels.dll", "darwin": "kernels.dylib"}.get(sys.platform, "kernels.so")
_WHOLE, _REAL = ctypes.c_int64, ctypes.c_double
_ARGUMENTS = {"p": ctypes.c_void_p, "i": _WHOLE, "d": _REAL}
_CELL, _MOST_CELLS = 0.03, 200  # [m] of a cell of points; along an edge.
_MOST_COORDINATES = 256  # Of a robot: the size of an array in `tree.c`.


class Grid(ctypes.Structure):
    """`Grid` of `kernels.h`."""

    _fields_ = (("origin", 3 * _REAL), ("step", _REAL), ("shape", 3 * _WHOLE), ("values", ctypes.c_void_p))


class Field(ctypes.Structure):
    """`Field` of `kernels.h`."""

    _fields_ = (
        ("origin", 3 * _REAL),
        ("edge", _REAL),
        ("counts", 3 * _WHOLE),
        ("levels", ctypes.c_void_p),
        ("starts", ctypes.c_void_p),
        ("samples", ctypes.c_void_p),
    )


class Samples(ctypes.Structure):
    """`Samples` of `kernels.h`."""

    _fields_ = (
        ("origin", 3 * _REAL),
        ("edge", _REAL),
        ("counts", 3 * _WHOLE),
        ("total", _WHOLE),
        ("starts", ctypes.c_void_p),
        ("indices", ctypes.c_void_p),
        ("points", ctypes.c_void_p),
    )


def _library() -> ctypes.CDLL | None:
    path = Path(__file__).with_name(NAME)
    return ctypes.CDLL(str(path)) if path.exists() else None


_LIBRARY = _library()
COMPILED = _LIBRARY is not None
"""Whether this installation has the library."""


def _function(name: str, arguments: str, *, allocates: bool = False, counts: bool = False) -> Callable[..., Any]:
    function = getattr(_LIBRARY, name, None)
    if function is None:
        return _missing
    function.argtypes = [_ARGUMENTS[kind] for kind in arguments]
    function.restype = _WHOLE if counts else None
    if allocates:
        function.restype, function.errcheck = ctypes.c_int, _checked
    return function


def _checked(short_of_memory: int, function: object, arguments: object) -> None:  # noqa: ARG001  # as ctypes calls it
    if short_of_memory:
        raise MemoryError


def _missing(*_: Any) -> None:
    raise NotImplementedError("this installation has no compiled kernels")


_GRID_QUERY, _FIELD_QUERY = (_function(name, "ppiiipp") for name in ("grid_query", "field_query"))
_SKIN_POINTS = _function("skin_points", "pppppipipippp")
_SOLID_POINTS = _function("solid_points", "pppipipippp")
_MEETING = _function("meeting", "ppiippdppppipiddpppp", counts=True)
_HINGE = _function("hinge", "ppppddiippp")
_FORWARD = _function("forward", "pppppiipp")
_ADD_ROWS = _function("add_rows", "ppiippppippdii")
_ADD_TREE = _function("add_tree", "pppippppiiipp")


_NEAREST_SAMPLES = _function("nearest_samples", "pppppiddidpp", allocates=True)
_DEEPEST_SAMPLES = _function("deepest_samples", "pppppidp")
_INSIDE_SUMS = _function("inside_sums", "ppppppidpp")
_WAYS_OUT = _function("ways_out", "ppppppidpdddpp", allocates=True)
_NEAREST_SKIN = _function("nearest_skin", "ppippppippiddidppp", allocates=True)


def _at(array: np.ndarray | None) -> int | None:
    return None if array is None else array.__array_interface__["data"][0]


def _real(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, dtype=np.float64)


class Shape:
    """A solid or a surface with its samples, as the library sees it; the arrays stay alive with it."""

    def __init__(self, structure: Grid | Field, arrays: Sequence[np.ndarray]) -> None:
        self.structure, self._arrays = structure, tuple(arrays)
        self.address = ctypes.addressof(structure)

    @classmethod
    def of_grid(cls, origin: Float[np.ndarray, "3"], step: float, values: Float[np.ndarray, "X Y Z"]) -> "Shape":
        """Return a solid on a regular grid [m]."""
        values = np.ascontiguousarray(values, dtype=np.float32)
        structure = Grid((3 * _REAL)(*origin), step, (3 * _WHOLE)(*values.shape), _at(values))
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
        """Return a surface in cells [m]."""
        own = (
            np.ascontiguousarray(levels, dtype=np.int8),
            np.ascontiguousarray(starts, dtype=np.int64),
            np.ascontiguousarray(samples, dtype=np.float32),
        )
        structure = Field((3 * _REAL)(*origin), edge, (3 * _WHOLE)(*levels.shape), *map(_at, own))
        return cls(structure, own)

    def query(
        self, points: Float[np.ndarray, "K 3"], *, slopes: bool
    ) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"] | None]:
        """Return the distances of points [m], and their derivatives by the points where they are asked for."""
        points = np.asarray(points, dtype=np.float64)
        if any(stride % 8 for stride in points.strides):
            points = _real(points)
        distances = np.empty(len(points))
        found = np.empty((3, len(points))) if slopes else None
        function = _GRID_QUERY if isinstance(self.structure, Grid) else _FIELD_QUERY
        along, across = (stride // 8 for stride in points.strides)
        function(self.address, _at(points), along, across, len(points), _at(distances), _at(found))
        return distances, None if found is None else found.T


Moving = tuple[Float[np.ndarray, "3 3 T"], Float[np.ndarray, "3 T"]]
"""Rotation and position [m] over T frames."""
AtPoints = tuple[Float[np.ndarray, "3 K F"], Float[np.ndarray, "K F"], Float[np.ndarray, "3 K F"]]
"""Levers [m], distances [m], normals in world axes."""


def skin_points(
    surface: Shape, link: Moving, moving_object: Moving, frames: Int[np.ndarray, "F"], points: Float[np.ndarray, "3 K F"]
) -> AtPoints:
    """Return where points of a link's skin, in its frame [m], are on a moving surface."""
    own, other = [_real(part) for part in link], [_real(part) for part in moving_object]
    frames, points = np.ascontiguousarray(frames, dtype=np.int64), _real(points)
    _, each, count = points.shape
    levers, distances, normals = np.empty(points.shape), np.empty((each, count)), np.empty(points.shape)
    _SKIN_POINTS(
        surface.address, *map(_at, (*own, *other)), own[1].shape[1], _at(frames), count, _at(points), each,
        _at(levers), _at(distances), _at(normals),
    )  # fmt: skip
    return levers, distances, normals


def solid_points(
    solid: Shape, link: Moving, frames: Int[np.ndarray, "F"], points: Float[np.ndarray, "3 K F"]
) -> AtPoints:
    """Return where world points [m] are on a link's solid; normals are against the way in which the link moves."""
    own, frames, points = [_real(part) for part in link], np.ascontiguousarray(frames, dtype=np.int64), _real(points)
    _, each, count = points.shape
    levers, distances, away = np.empty(points.shape), np.empty((each, count)), np.empty(points.shape)
    _SOLID_POINTS(
        solid.address, *map(_at, own), own[1].shape[1], _at(frames), count, _at(points), each,
        _at(levers), _at(distances), _at(away),
    )  # fmt: skip
    return levers, distances, away


def meeting(  # noqa: PLR0913  # two links and what is asked of them
    solid: Shape,
    points: Float[np.ndarray, "K 3"],
    neighbours: tuple[int, Int[np.ndarray, "K"], Float[np.ndarray, "K"], float],
    link: Moving,
    other: Moving,
    frames: Int[np.ndarray, "F"],
    *,
    margin: float,
    overrated: float,
) -> tuple[Int[np.ndarray, "N"], Float[np.ndarray, "N 3"], Float[np.ndarray, "N"], Float[np.ndarray, "N 3"]]:
    """Return the points of a link in another's solid: indices of frames, places, depths [m], slopes of distances.

    Args:
        solid: Of the other link.
        points: Of the link, in its frame [m].
        neighbours: Number of coarse points; for each point the nearest of these and how far that is, at most how far [m].
        link: Pose of the link.
        other: Pose of the other link.
        frames: Frames that are looked at.
        margin: Distance that counts as inside [m].
        overrated: Factor by which the solid may overrate distances.
    """
    coarse, nearest, away, farthest = neighbours
    points, own, others = _real(points), [_real(part) for part in link], [_real(part) for part in other]
    chosen, nearest = (np.ascontiguousarray(part, dtype=np.int64) for part in (frames, nearest))
    most = max(len(points) * len(frames), 1)
    times, places, slopes = np.empty(most, dtype=np.int64), np.empty((most + 1, 3)), np.empty((most + 1, 3))
    depths = np.empty(most + coarse)
    found = _MEETING(
        solid.address, _at(points), len(points), coarse, _at(nearest), _at(_real(away)), farthest,
        *map(_at, (*own, *others)), own[1].shape[1], _at(chosen), len(frames), margin, overrated,
        *map(_at, (times, places, depths, slopes)),
    )  # fmt: skip
    return times[:found].copy(), places[:found].copy(), depths[:found].copy(), slopes[:found].copy()


def hinge(
    levers: Float[np.ndarray, "3 K F"],
    distances: Float[np.ndarray, "K F"],
    normals: Float[np.ndarray, "3 K F"],
    margin: float | Float[np.ndarray, "K F"],
    knee: float,
) -> tuple[Float[np.ndarray, "K F"], Float[np.ndarray, "K 3 F"], Float[np.ndarray, "K 3 F"]]:
    """Return residuals of hinges [m], and their derivatives by a link's linear and angular velocity."""
    levers, distances, normals = _real(levers), _real(distances), _real(normals)
    each, count = distances.shape
    residual, by_linear, by_angular = np.empty((each, count)), np.empty((each, 3, count)), np.empty((each, 3, count))
    margins = _real(margin) if isinstance(margin, np.ndarray) else None
    _HINGE(
        _at(levers), _at(distances), _at(normals), _at(margins), 0.0 if margins is not None else margin, knee, each,
        count, _at(residual), _at(by_linear), _at(by_angular),
    )  # fmt: skip
    return residual, by_linear, by_angular


def forward(
    parents: Int[np.ndarray, "n"],
    offsets: Float[np.ndarray, "3 n"],
    hinge_rotations: Float[np.ndarray, "3 3 3 n"],
    theta: Float[np.ndarray, "n T"],
    rotation: Float[np.ndarray, "3 3 N T"],
    position: Float[np.ndarray, "3 N T"],
) -> None:
    """Fill in the poses of all nodes but the root's [m, rad]."""
    cosine, sine = np.cos(theta), np.sin(theta)
    own = np.ascontiguousarray(parents, dtype=np.int64), _real(offsets), _real(hinge_rotations), cosine, sine
    _FORWARD(*map(_at, own), *theta.shape, _at(rotation), _at(position))


class Rows:
    """Sums of rows of T frames that depend on the poses of nodes: matrices and forces by frame and node."""

    def __init__(self, frames: int, nodes: int) -> None:
        self.matrices, self.forces = np.zeros((frames, nodes, 6, 6)), np.zeros((frames, nodes, 6))

    def add(  # noqa: PLR0913, PLR0917  # the parts of rows
        self,
        node: int,
        residual: Float[np.ndarray, "m F"],
        by_linear: Float[np.ndarray, "m 3 F"] | None,
        by_angular: Float[np.ndarray, "m 3 F"] | None,
        levers: Float[np.ndarray, "3 T"] | None,
        weight: float | Float[np.ndarray, "F"],
        frames: Int[np.ndarray, "F"] | None,
    ) -> None:
        """Add the rows of one frame fixed to a node; its levers [m] are from the root."""
        parts = [None if part is None else _real(part) for part in (residual, by_linear, by_angular, levers)]
        chosen = None if frames is None else np.ascontiguousarray(frames, dtype=np.int64)
        weights = _real(weight) if isinstance(weight, np.ndarray) else None
        _ADD_ROWS(
            _at(self.matrices), _at(self.forces), self.matrices.shape[1], node, *map(_at, parts), len(self.matrices),
            _at(chosen), _at(weights), 0.0 if weights is not None else weight, *residual.shape,
        )  # fmt: skip

    def to_band(  # noqa: PLR0913, PLR0917  # the parts of a tree
        self,
        parents: Int[np.ndarray, "n"],
        axes: Float[np.ndarray, "6 nv T"],
        column_nodes: Int[np.ndarray, "nv"],
        coupled: tuple[Int[np.ndarray, "nv nv"], Int[np.ndarray, "nv"]],
        band: Float[np.ndarray, "T nv width"],
        gradient: Float[np.ndarray, "T nv"],
    ) -> None:
        """Add the normal equations of the rows, in place; these sums are used up."""
        if len(column_nodes) > _MOST_COORDINATES:
            raise ArgumentError(f"a robot of {len(column_nodes)} coordinates; kernels know {_MOST_COORDINATES} at most.")
        axes = _real(axes)
        numbers = [np.ascontiguousarray(part, dtype=np.int64) for part in (parents, column_nodes, *coupled)]
        before, *after = map(_at, numbers)
        _ADD_TREE(
            _at(self.matrices), _at(self.forces), before, self.matrices.shape[1], _at(axes), *after,
            len(column_nodes), len(self.matrices), band.shape[2], _at(band), _at(gradient),
        )  # fmt: skip


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
        counts = (size / edge).astype(np.int64) + 1
        cell = np.ravel_multi_index(tuple(((points - lowest) / edge).astype(np.int64).T), tuple(counts))
        order = np.argsort(cell, kind="stable")
        starts = np.searchsorted(cell[order], np.arange(counts.prod() + 1))
        arrays = starts.astype(np.int64), order.astype(np.int64), _real(points[order])
        place = (3 * _REAL)(*lowest), edge, (3 * _WHOLE)(*counts), len(points)
        return cls(Samples(*place, *map(_at, arrays)), arrays)

    def nearest(  # noqa: PLR0913, PLR0917  # poses of a solid, and what is asked of them
        self,
        solid: Shape,
        rotations: Float[np.ndarray, "N 3 3"],
        origins: Float[np.ndarray, "N 3"],
        centres: Float[np.ndarray, "N 3"],
        radius: float,
        near: float,
        count: int,
        apart: float,
    ) -> tuple[Int[np.ndarray, "N K"], Int[np.ndarray, "N"]]:
        """Return the points nearest to a solid in each pose, spread, and how many they are."""
        own = [_real(part) for part in (rotations, origins, centres)]
        chosen, number = np.zeros((len(origins), count), dtype=np.int64), np.zeros(len(origins), dtype=np.int64)
        _NEAREST_SAMPLES(
            self._address, solid.address, *map(_at, own), len(origins), radius, near, count, apart, _at(chosen),
            _at(number),
        )  # fmt: skip
        return chosen, number

    def deepest(
        self,
        solid: Shape,
        rotations: Float[np.ndarray, "N 3 3"],
        origins: Float[np.ndarray, "N 3"],
        centres: Float[np.ndarray, "N 3"],
        radius: float,
    ) -> Float[np.ndarray, "N"]:
        """Return the least of the distances from a solid in each pose [m]."""
        own, least = [_real(part) for part in (rotations, origins, centres)], np.empty(len(origins))
        _DEEPEST_SAMPLES(self._address, solid.address, *map(_at, own), len(origins), radius, _at(least))
        return least

    def inside(  # noqa: PLR0913, PLR0917  # poses of a solid, and what is asked of them
        self,
        solid: Shape,
        rotations: Float[np.ndarray, "N 3 3"],
        origins: Float[np.ndarray, "N 3"],
        centres: Float[np.ndarray, "N 3"],
        radius: float,
        pivots: Float[np.ndarray, "N 3"],
    ) -> tuple[Float[np.ndarray, "N 6 6"], Float[np.ndarray, "N 6"]]:
        """Return squares and products of the distances of points inside a solid."""
        own = [_real(part) for part in (rotations, origins, centres, pivots)]
        squares, products = np.zeros((len(origins), 6, 6)), np.zeros((len(origins), 6))
        _INSIDE_SUMS(
            self._address, solid.address, *map(_at, own), len(origins), radius, _at(squares), _at(products)
        )
        return squares, products


    def ways_out(  # noqa: PLR0913, PLR0917  # poses of a solid, and what is asked of them
        self,
        solid: Shape,
        rotations: Float[np.ndarray, "N 3 3"],
        origins: Float[np.ndarray, "N 3"],
        centres: Float[np.ndarray, "N 3"],
        radius: float,
        middle: Float[np.ndarray, "3"],
        directions: Float[np.ndarray, "N 3"],
        most: float,
        least_step: float,
        overrated: float,
    ) -> tuple[Float[np.ndarray, "N"], Float[np.ndarray, "N 3"]]:
        """Return the lengths [m] of the ways of a solid along directions until no point is in it, and its nearest."""
        own = [_real(part) for part in (rotations, origins, centres, middle)]
        along, ways, nearest = _real(directions), np.empty(len(origins)), np.empty((len(origins), 3))
        _WAYS_OUT(
            self._address, solid.address, *map(_at, own), len(origins), radius, _at(along), most, least_step, overrated,
            _at(ways), _at(nearest),
        )  # fmt: skip
        return ways, nearest


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
    """Return the points of a skin that are nearest to a surface, spread; their least distance, and a lower bound."""
    points, order, firsts, counts = _real(points), *(np.ascontiguousarray(part, np.int64) for part in patches[:3])
    own, radii = [_real(part) for part in poses], _real(patches[3])
    chosen, found = np.empty((len(own[1]), count), dtype=np.int64), np.empty((2, len(own[1])))
    _NEAREST_SKIN(
        surface.address, _at(points), len(points), *map(_at, (order, firsts, counts, radii)), len(counts),
        *map(_at, own), len(own[1]), near, spread, count, apart, _at(chosen), _at(found[0]), _at(found[1]),
    )  # fmt: skip
    return chosen, found[0], found[1]
