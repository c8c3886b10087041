"""Samples of the distance from a surface, dense where it bends and sparse where it does not.

Space is cut into cubic cells. A cell holds samples on a lattice of its own, of one to eight steps along an edge: as
many as it takes for the values in between, which are trilinear, to be right (adaptively sampled distance fields;
Frisken et al., 2000). Samples are exact. Their side of a closed surface is that of a neighbour where no surface can lie
between.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy import ndimage

from hoi_retarget.objects.mesh import Surface

STEPS = np.array([1, 2, 4, 8])
"""Steps along an edge of a cell, by level."""

_FINEST = 3e-3  # [m] between samples where they are densest.
_LEAST_SIZE = 1e-2  # [m]
_LEAST_STEPS = 64  # Along the longest side: a small object gets finer ones.
_MOST_CELLS = 150_000  # A large one gets coarser ones,
_MOST_SAMPLES = 2_500_000  # and so does one that bends everywhere.
# An interpolated value may be off by so much: at the surface [m], and more by shares of the distance on both sides.
_TOLERANCE, _OUTSIDE, _INSIDE = 3e-4, 0.05, 0.2
_FAR = 2.0  # Cells: so far from the surface, one step a cell is enough.


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells around a surface and the samples of each."""

    origin: Float[np.ndarray, "3"]
    """Lowest corner of the first cell [m]."""
    edge: float
    """[m]"""
    levels: Int[np.ndarray, "X Y Z"]
    """How finely each cell is sampled: index into `STEPS`."""
    samples: Float[np.ndarray, "S"]
    """[m], cell after cell, in single precision; the z coordinate of a cell's lattice runs fastest."""


def sample(surface: Surface, *, signed: bool, step: float | None = None) -> Cells:
    """Return samples of the distance from a surface, negative inside where they are signed.

    The step is that of the finest lattices [m]; None chooses by the object's size. Objects that would take more
    samples than memory is worth get coarser ones.
    """
    corners = surface.triangles.reshape(-1, 3)
    lowest, size = corners.min(axis=0), np.ptp(corners, axis=0)
    edge = STEPS[-1] * (step or min(_FINEST, max(float(size.max()), _LEAST_SIZE) / _LEAST_STEPS))
    while True:
        counts = np.ceil(size / edge).astype(int) + 2  # One cell around at least.
        if np.prod(counts.astype(float)) <= _MOST_CELLS:
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
        near = np.abs(lattices).min(axis=(1, 2, 3)) < _FAR * self.edge
        for level in range(1, len(STEPS)):
            active, lattices = active[near], lattices[near]
            if len(lattices) * (STEPS[level] + 1) ** 3 > _MOST_SAMPLES:
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
            kept = levels[active] == level
            count = int(STEPS[level] + 1) ** 3
            samples[starts[active[kept], None] + np.arange(count)] = lattices[kept].reshape(-1, count)
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
            ndimage.label((distances > self.edge).reshape(regions.shape), output=regions)
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
    """Return where the samples of each cell start."""
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
