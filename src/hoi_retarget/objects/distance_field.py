"""Signed distance from an object's surface, sampled once: a query costs a fifth of a microsecond.

Sides are told by how often the surface winds around a point, so that meshes need not be closed
(`Surface.signed_distances`). A surface that does not part its two sides, such as a sheet or faces that are not wound
alike, has no inside. It counts as a shell: what is within `SHELL_THICKNESS` of it, on either side, is inside.
"""

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.files import npz, user_cache
from hoi_retarget.numerics.trilinear import directions, interpolate, with_slopes
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.objects.surface_cells import STEPS, Cells, sample, starts_of
from hoi_retarget.objects.track import ObjectGeometry

SHELL_THICKNESS = 1e-3
"""[m] on either side of a surface without an inside."""

_VERSION = 1  # Of what the builder makes of the same triangles: fields of others are not read.
_PROBES = 2000  # Places on the surface that tell its sides and the field's error.
_PROBE_DEPTH = 5e-4  # [m]
_PARTED = 0.5  # A surface that parts its sides at fewer of these places is a shell.
_BLOCK = 1 << 16  # Points of a query at once.
_INSIDE = 1.0 - 1e-12  # Of the cells' extent: the last place that is in a cell.
_CORNERS = np.array([[(x * (n + 1) + y) * (n + 1) + z for n in STEPS] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


@dataclass(frozen=True, eq=False)
class DistanceField:
    """Signed distance from one surface in the object's frame at captured size; negative inside."""

    cells: Cells
    shell: bool
    """Whether the surface has no inside; distances are then those from either side less `SHELL_THICKNESS`."""
    error: float
    """Largest error that was seen within two steps of the surface [m]."""

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

    def distances(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K"]:
        """Return the distances of points [m].

        Beyond the cells, which reach past the object by their edge or more, it is a lower bound: at least 0.7 of
        the distance.
        """
        return np.concatenate([self._distances(block) for block in _blocks(points)])

    def distances_and_slopes(
        self, points: Float[np.ndarray, "K 3"]
    ) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
        """Return the distances of points [m], and their derivatives by the points."""
        distances, slopes = zip(*(self._distances_and_slopes(block) for block in _blocks(points)), strict=True)
        return np.concatenate(distances), np.concatenate(slopes)

    def distances_and_normals(
        self, points: Float[np.ndarray, "K 3"]
    ) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K 3"]]:
        """Return the distances of points [m], and the directions in which they grow: unit vectors."""
        distances, slopes = self.distances_and_slopes(points)
        return distances, directions(slopes)

    def _distances(self, points: np.ndarray) -> np.ndarray:
        corners, place, _, beyond = self._located(points)
        distances = interpolate(corners, place)
        return distances if beyond is None else _lengthened(distances, beyond)

    def _distances_and_slopes(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        corners, place, steps, beyond = self._located(points)
        distances, slopes = with_slopes(corners, place)
        slopes *= steps / self.cells.edge
        if beyond is not None:
            # Along an axis in which a point is beyond the cells, the distance within them does not change.
            longer = _lengthened(distances, beyond)
            outside = beyond.any(axis=0)
            way = np.where(beyond == 0, distances * slopes, beyond) / np.where(outside, longer, 1.0)
            distances, slopes = longer, np.where(outside, way, slopes)
        return distances, slopes.T

    def _located(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
        """Return the samples around points, where between them, steps along a cell's edge, and the way to the cells."""
        cells = self.cells
        at = (points.T - cells.origin[:, None]) / cells.edge
        counts = np.array(cells.levels.shape)
        inside = np.clip(at, 0.0, counts[:, None] * _INSIDE)
        beyond = (at - inside) * cells.edge if (at != inside).any() else None
        cell = inside.astype(np.int64)
        index = (cell[0] * counts[1] + cell[1]) * counts[2] + cell[2]
        level = cells.levels.reshape(-1)[index]
        steps = STEPS[level]
        place = (inside - cell) * steps
        local = place.astype(np.int64)
        nodes = steps + 1
        first = self._starts[index] + (local[0] * nodes + local[1]) * nodes + local[2]
        return cells.samples[first + _CORNERS[:, level]], place - local, steps, beyond

    @cached_property
    def _starts(self) -> Int[np.ndarray, "C"]:
        return starts_of(self.cells.levels)


def distance_field(geometry: ObjectGeometry) -> DistanceField:
    """Return the field of an object's surface; fields are kept in the user's cache folder.

    Raises:
        GeometryError: The mesh file is missing, damaged, or has no triangles.
    """
    surface = surface_of(geometry)
    digest = hashlib.sha256(f"{_VERSION} {surface.exact}".encode())
    digest.update(surface.vertices.data)
    digest.update(surface.faces.data)
    return _kept(_Named(digest.hexdigest()[:32], surface))


def field_of(surface: Surface, step: float | None = None) -> DistanceField:
    """Return the field of a surface, with so far between samples where they are densest [m]; None: by its size."""
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
    depth = np.full(len(points), min(_PROBE_DEPTH, 1e-2 * float(np.ptp(surface.vertices, axis=0).max())))
    sides = [surface.encloses(points + sign * depth[:, None] * normals, depth) for sign in (-1, 1)]
    return len(points) > 0 and float(np.mean(sides[0] != sides[1])) > _PARTED


@dataclass(frozen=True)
class _Named:
    """A surface with a digest of all that its field depends on."""

    digest: str
    surface: Surface = field(compare=False)


@lru_cache(maxsize=8)
def _kept(named: _Named) -> DistanceField:
    name = f"field-{named.digest}.npz"
    content = user_cache.kept(name)
    if content is not None:
        try:
            return _decode(content)
        except ValueError:
            pass  # Damaged: it is built anew.
    built = field_of(named.surface)
    user_cache.keep(name, _encode(built))
    return built


def _encode(built: DistanceField) -> bytes:
    cells = built.cells
    return npz.encode(
        {
            "place": np.array([*cells.origin, cells.edge, built.error]),
            "levels": cells.levels,
            "samples": cells.samples,
            "shell": np.array([built.shell], dtype=np.int8),
        }
    )


def _decode(content: bytes) -> DistanceField:
    """Return a field from its bytes, or raise `ValueError`."""
    entries = npz.members(content)
    try:
        place, levels, samples, shell = (
            npz.array(name, entries[name], kind)
            for name, kind in (("place", "f"), ("levels", "i"), ("samples", "f"), ("shell", "i"))
        )
    except KeyError as error:
        raise ValueError(f"no array {error}") from error
    cells = Cells(place[:3], float(place[3]), levels, samples)
    return DistanceField(cells, bool(shell[0]), float(place[4]))


def _lengthened(distances: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    """Return distances with the way to the cells, for the points that are beyond these."""
    return np.where(beyond.any(axis=0), np.sqrt(distances**2 + (beyond**2).sum(axis=0)), distances)


def _blocks(points: np.ndarray) -> list[np.ndarray]:
    points = np.asarray(points, dtype=float)
    return [points[first : first + _BLOCK] for first in range(0, max(len(points), 1), _BLOCK)]
