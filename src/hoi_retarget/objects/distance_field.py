"""Signed distance from an object's surface, sampled once: a query costs a fifth of a microsecond.

Space is cut into cubic cells. A cell holds samples on a lattice of its own, of one to eight steps along an edge: as
many as make the values in between, which are trilinear, right (adaptively sampled distance fields; Frisken et al.,
2000). Samples are exact. Their side of a closed surface is that of a neighbour where no surface can lie between. The
side is decided by the winding of the surface around a point, so meshes need not be closed (`Surface.signed_distances`).
A surface that does not part its two sides, such as a sheet or faces that are not wound alike, has no inside. It is a
shell: points within `SHELL_THICKNESS` of it, on either side, are inside.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float, Int

from hoi_retarget.files import user_cache
from hoi_retarget.kernels.shape import SampledDistances, Shape
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.objects.track import ObjectGeometry

STEPS = np.array([1, 2, 4, 8])  # Steps along an edge of a cell, by level.

_MIN_STEP = 3e-3  # [m] between samples where they are densest.
_MIN_SIZE = 1e-2  # [m]
_MIN_STEPS = 64  # Along the longest side: a small object gets finer ones.
_MAX_CELLS = 150_000  # A large one gets coarser ones,
_MAX_SAMPLES = 2_500_000  # and so does one that bends everywhere.
# An interpolated value may be off by so much: at the surface [m], and more by shares of the distance on both sides.
_TOLERANCE, _OUTSIDE, _INSIDE = 3e-4, 0.05, 0.2
_COARSE_DISTANCE = 2.0  # Edges of a cell; from there on, one step a cell is enough.


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells around a surface and the samples of each."""

    origin: Float[np.ndarray, "3"]  # Lowest corner of the first cell [m].
    edge: float  # [m]
    levels: Int[np.ndarray, "X Y Z"]  # Of each cell: index into `STEPS`.
    samples: Float[np.ndarray, "S"]
    """[m], cell after cell, in single precision; the z coordinate of a cell's lattice runs fastest."""


def sample(surface: Surface, *, signed: bool, step: float | None = None) -> Cells:
    """Return samples of the distance from a surface, negative inside where they are signed.

    The step is that of the finest lattices [m]; None chooses by the object's size. Objects that would take more
    samples than memory is worth get coarser ones.
    """
    corners = surface.triangles.reshape(-1, 3)
    lowest, size = corners.min(axis=0), np.ptp(corners, axis=0)
    edge = STEPS[-1] * (step or min(_MIN_STEP, max(float(size.max()), _MIN_SIZE) / _MIN_STEPS))
    while True:
        counts = np.ceil(size / edge).astype(int) + 2  # One cell around at least.
        if np.prod(counts.astype(float)) <= _MAX_CELLS:
            origin = lowest - 0.5 * (counts * edge - size)
            cells = _Sampling(surface, signed, origin, edge, counts).cells()
            if cells is not None:
                return cells
        edge *= 1.25


@dataclass(frozen=True, eq=False)
class _Sampling:
    surface: Surface
    signed: bool
    origin: Float[np.ndarray, "3"]
    edge: float
    counts: Int[np.ndarray, "3"]

    def cells(self) -> Cells | None:
        """Return the cells, or None where they would be too many samples."""
        indices = np.indices(tuple(self.counts)).reshape(3, -1)
        corners = np.indices((2, 2, 2)).reshape(3, 8)
        lattices = self._corners()[tuple(indices[:, :, None] + corners[:, None])].reshape(-1, 2, 2, 2)
        active = np.arange(len(lattices))
        levels = np.zeros(len(lattices), dtype=np.int8)
        by_level = [(active, lattices)]
        near = np.abs(lattices).min(axis=(1, 2, 3)) < _COARSE_DISTANCE * self.edge
        for level in range(1, len(STEPS)):
            active, lattices = active[near], lattices[near]
            if len(lattices) * (STEPS[level] + 1) ** 3 > _MAX_SAMPLES:
                return None
            if len(lattices) == 0:
                break
            expected = _halved(lattices, _mean)
            lattices = self._refined(indices[:, active], lattices, expected, int(STEPS[level]))
            excess = np.abs(lattices - expected) - np.maximum(_OUTSIDE * lattices, -_INSIDE * lattices)
            near = excess.max(axis=(1, 2, 3), initial=0.0) > _TOLERANCE
            levels[active[near]] = level
            by_level.append((active, lattices))
        starts = starts_of(levels)
        samples = np.empty(int(((STEPS[levels] + 1) ** 3).sum()), dtype=np.float32)
        for level, (active, lattices) in enumerate(by_level):
            own = levels[active] == level
            count = int(STEPS[level] + 1) ** 3
            samples[starts[active[own], None] + np.arange(count)] = lattices[own].reshape(-1, count)
        return Cells(self.origin, self.edge, levels.reshape(self.counts), samples)

    def _corners(self) -> Float[np.ndarray, "X Y Z"]:
        """Return the distances at the corners of all cells."""
        places = np.indices(tuple(self.counts + 1))
        points = self.origin + self.edge * places.reshape(3, -1).T
        distances = self.surface.distances(points)
        if not self.signed:
            return distances.reshape(self.counts + 1)
        unknown = np.arange(len(points))
        inside = np.zeros(len(points), dtype=bool)
        if self.surface.closed:
            # Corners next to each other that are farther from the surface than from one another are on one side.
            regions = np.empty(self.counts + 1, dtype=np.int32)
            scipy.ndimage.label((distances > self.edge).reshape(regions.shape), output=regions)
            regions = regions.reshape(-1)
            _, first, region = np.unique(regions, return_index=True, return_inverse=True)
            inside = self.surface.encloses(points[first], distances[first])[region.reshape(-1)]
            unknown = np.flatnonzero(regions == 0)
        inside[unknown] = self.surface.encloses(points[unknown], distances[unknown])
        return np.where(inside, -distances, distances).reshape(self.counts + 1)

    def _refined(self, indices: np.ndarray, lattices: np.ndarray, expected: np.ndarray, steps: int) -> np.ndarray:
        """Return the lattices of some cells with half the step: `expected`, with exact values at the new places."""
        step = self.edge / steps
        local = np.indices((steps + 1,) * 3).reshape(3, -1)
        halfway = (local % 2).sum(axis=0)
        new = np.flatnonzero(halfway)
        places = (indices[:, :, None] * steps + local[:, None, new]).reshape(3, -1)
        # Neighbouring cells share places.
        _, first, shared = np.unique(
            np.ravel_multi_index(tuple(places), tuple(self.counts * steps + 1)), return_index=True, return_inverse=True
        )
        points = self.origin + step * places[:, first].T
        values = self.surface.distances(points)
        if self.signed:
            neighbours = _halved(lattices, _farther).reshape(len(lattices), -1)[:, new].reshape(-1)[first]
            reach = np.tile(step * np.sqrt(halfway[new]), len(lattices))[first]
            inside = neighbours < 0
            unknown = np.abs(neighbours) <= (reach if self.surface.closed else np.inf)
            inside[unknown] = self.surface.encloses(points[unknown], values[unknown])
            values = np.where(inside, -values, values)
        refined = expected.reshape(len(lattices), -1).copy()
        refined[:, new] = values[shared.reshape(-1)].reshape(len(lattices), -1)
        return refined.reshape(expected.shape)


def starts_of(levels: Int[np.ndarray, "..."]) -> Int[np.ndarray, "C"]:
    """Return the index of the first sample of each cell."""
    ends = np.cumsum((STEPS[levels.reshape(-1)] + 1) ** 3)
    return np.concatenate([[0], ends[:-1]])


def _halved(lattices: np.ndarray, middle: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """Return lattices with half the step; `middle` gives new values from those on both sides, axis after axis."""
    for axis in (1, 2, 3):
        coarse = np.moveaxis(lattices, axis, -1)
        fine = np.empty((*coarse.shape[:-1], 2 * coarse.shape[-1] - 1))
        fine[..., ::2] = coarse
        fine[..., 1::2] = middle(coarse[..., :-1], coarse[..., 1:])
        lattices = np.moveaxis(fine, -1, axis)
    return np.ascontiguousarray(lattices)


def _mean(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return 0.5 * (first + second)


def _farther(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.where(np.abs(first) > np.abs(second), first, second)


SHELL_THICKNESS = 1e-3  # [m] on either side of a surface without an inside.

_VERSION = 1  # Of what the builder makes of the same triangles: fields of others are not read.
_PROBES = 2000  # Places on the surface that tell its sides and the field's error.
_PROBE_DEPTH = 5e-4  # [m]
_PARTED = 0.5  # A surface that parts its sides at fewer of these places is a shell.


@dataclass(frozen=True, eq=False)
class DistanceField(SampledDistances):
    """Signed distance from one surface in the object's frame at captured size; negative inside.

    Beyond the cells, which reach past the object by their edge or more, it is a lower bound: at least 0.7 of the
    distance.
    """

    cells: Cells
    shell: bool  # Whether the surface has no inside; distances are then those from either side less `SHELL_THICKNESS`.
    error: float  # Largest error at random points within two steps of the surface [m].

    @property
    def step(self) -> float:
        """Distance between samples where they are densest [m]."""
        return self.cells.edge / float(STEPS[-1])

    def scaled(self, factor: float) -> "DistanceField":
        """Return the field of the same surface at another size; the thickness of a shell grows with it."""
        cells = replace(
            self.cells,
            origin=self.cells.origin * factor,
            edge=self.cells.edge * factor,
            samples=self.cells.samples * np.float32(factor),
        )
        return replace(self, cells=cells, error=self.error * factor)

    @cached_property
    def compiled(self) -> Shape:
        """The field for the compiled library."""
        cells = self.cells
        return Shape.of_cells(cells.origin, cells.edge, cells.levels, self._starts, cells.samples)

    @cached_property
    def _starts(self) -> Int[np.ndarray, "C"]:
        return starts_of(self.cells.levels)


def distance_field(geometry: ObjectGeometry) -> DistanceField:
    """Return the field of an object's surface, which stays in the user's cache folder; raises as `surface_of`."""
    surface = surface_of(geometry)
    return _cached(_Named(f"field-{surface.digest(f'{_VERSION} {surface.exact}')}.npz", surface))


def field_of(surface: Surface, step: float | None = None) -> DistanceField:
    """Return the field of a surface; `step` is the smallest distance of samples [m], None chooses it by the size."""
    on_surface, normals = surface.random_points(_PROBES)
    shell = not _parts_its_sides(surface, on_surface, normals)
    cells = sample(surface, signed=not shell, step=step)
    if shell:
        cells = replace(cells, samples=cells.samples - np.float32(SHELL_THICKNESS))
    built = DistanceField(cells, shell, 0.0)
    reach = 2 * built.step
    near = on_surface + np.random.default_rng(0).uniform(-reach, reach, on_surface.shape)
    true = surface.distances(near) - SHELL_THICKNESS if shell else surface.signed_distances(near)
    return replace(built, error=float(np.abs(built.distances(near) - true).max(initial=0.0)))


def _parts_its_sides(surface: Surface, points: np.ndarray, normals: np.ndarray) -> bool:
    """Return whether one side of a surface is inside and the other is not, at most of these points."""
    depth = np.full(len(points), min(_PROBE_DEPTH, 1e-2 * surface.size))
    sides = [surface.encloses(points + sign * depth[:, None] * normals, depth) for sign in (-1, 1)]
    return len(points) > 0 and float(np.mean(sides[0] != sides[1])) > _PARTED


@dataclass(frozen=True)
class _Named:
    """A surface with the name of its cached field."""

    name: str
    surface: Surface = field(compare=False)


@lru_cache(maxsize=6)
def _cached(named: _Named) -> DistanceField:
    kinds = {"place": "f", "levels": "i", "samples": "f", "shell": "i"}
    arrays = user_cache.cached_arrays(named.name, kinds, lambda: _arrays(field_of(named.surface)))
    place = arrays["place"]
    cells = Cells(place[:3], float(place[3]), arrays["levels"], arrays["samples"])
    return DistanceField(cells, bool(arrays["shell"][0]), float(place[4]))


def _arrays(built: DistanceField) -> dict[str, np.ndarray]:
    cells = built.cells
    return {
        "place": np.array([*cells.origin, cells.edge, built.error]),
        "levels": cells.levels,
        "samples": cells.samples,
        "shell": np.array([built.shell], dtype=np.int8),
    }


# Multiples of these two numbers, without their whole parts, fill a square evenly (Roberts, 2018).
_EVEN = np.array([0.7548776662466927, 0.5698402909980532])


_MANY_SAMPLES = 1_000_000  # From there on, those of a large object are made only where they can matter.
_PIECE = 0.25  # Longest edge of the pieces of triangles that are chosen there [m].


@dataclass(frozen=True, eq=False)
class Region:
    """Space within a distance of some points."""

    centres: Float[np.ndarray, "K 3"]  # [m]
    radius: float  # [m]


def is_large(surface: Surface, spacing: float) -> bool:
    """Return whether a surface has too many samples at a spacing [m] to make all of them."""
    return surface.area > _MANY_SAMPLES * spacing**2


def surface_samples(surface: Surface, spacing: float, region: Region | None = None) -> Float[np.ndarray, "K 3"]:
    """Return points of the surface [m], one for each square of that side [m], as dense on every triangle.

    Of a large one they are those in a region, where one is given, and some beyond it.
    """
    if region is None or not is_large(surface, spacing):
        return _samples(surface.triangles, spacing)
    pieces = _pieces_in(surface.triangles, region)
    return _samples(pieces if len(pieces) else surface.triangles[:1, [0, 0, 0]], spacing)


def _pieces_in(triangles: Float[np.ndarray, "F 3 3"], region: Region) -> Float[np.ndarray, "G 3 3"]:
    """Return parts of triangles that reach into a region, cut until they are small."""
    tree, chosen = scipy.spatial.KDTree(region.centres), [np.zeros((0, 3, 3))]
    while len(triangles):
        middles = triangles.mean(axis=1)
        reach = np.linalg.norm(triangles - middles[:, None], axis=2).max(axis=1)
        triangles = triangles[tree.query(middles)[0] <= region.radius + reach]
        small = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1) <= _PIECE
        chosen.append(triangles[small])
        a, b, c = np.moveaxis(triangles[~small], 1, 0)
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        triangles = np.concatenate(
            [np.stack(corners, axis=1) for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    return np.concatenate(chosen)


def _samples(corners: Float[np.ndarray, "F 3 3"], spacing: float) -> Float[np.ndarray, "K 3"]:
    # Corners in the order of the sides across from them: mirrored surfaces have mirrored points.
    across = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1), axis=2)
    order = np.argsort(across.round(9), axis=1, kind="stable")
    corners = np.take_along_axis(corners, order[:, :, None], axis=1)
    along = corners[:, 1:] - corners[:, :1]
    areas = np.cumsum(0.5 * np.linalg.norm(np.cross(along[:, 0], along[:, 1]), axis=1))
    count = max(1, round(float(areas[-1]) / spacing**2))
    steps = np.arange(count)
    triangles = np.searchsorted(areas, (steps + 0.5) / count * areas[-1])
    square = (0.5 + steps[:, None] * _EVEN) % 1.0
    # The half of the square beyond its diagonal is folded back onto the triangle.
    weights = np.where(square.sum(axis=1, keepdims=True) > 1.0, 1.0 - square, square)
    return corners[triangles, 0] + np.einsum("kc,kci->ki", weights, along[triangles])
