"""Points in nested balls, and the search for the nearest one to a shape, at many places at once.

The search is exact: a ball is left out only where none of its points can be the nearest. Far apart
shapes cost little, because the largest balls then decide.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.kernels.library import at, function, real
from hoi_retarget.kernels.shape import Grid, Shape

_BRANCHES = 8
_BITS = 10  # Of each coordinate, in the order of points.

_NEAR_POINTS = function("near_points", "ppdppppipiipppippipppp", counts=True)
_ROOM = 64  # For points at each place, at first.


class Accuracy(NamedTuple):
    """Bounds of a distance around that of samples."""

    error: float = 0.0  # [m]
    outside: float = 0.0  # Share of it, outside,
    inside: float = 0.0  # inside,
    beyond: float = 0.0  # and by which it may be larger
    beyond_from: float = 0.0  # from there on [m].

    def bounds(self, found: Float[np.ndarray, "K"]) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K"]]:
        """Return lower and upper bounds of distances, given those of samples [m]."""
        size, share = np.abs(found), np.where(found < 0.0, self.inside, self.outside)
        more = np.where(found > self.beyond_from, self.beyond, share)
        return found - self.error - share * size, found + self.error + more * size

    def at(self, scale: float) -> "Accuracy":
        """Return it for things of another size."""
        return self._replace(error=scale * self.error, beyond_from=scale * self.beyond_from)


_EXACT = Accuracy()


@dataclass(frozen=True, eq=False)
class Nearest:
    """Points that can be the nearest ones, by their bounds [m]."""

    place: Int[np.ndarray, "C"]  # Which of the places each is at; places without any are beyond the limit.
    point: Int[np.ndarray, "C"]  # Which of the tree's points it is.
    lower: Float[np.ndarray, "C"]
    upper: Float[np.ndarray, "C"]


@dataclass(frozen=True, eq=False)
class PointTree:
    """Points in nested balls."""

    points: Float[np.ndarray, "P 3"]  # In an order in which neighbours are near each other [m].
    order: Int[np.ndarray, "P"]  # Index that each had.

    @classmethod
    def of(cls, points: Float[np.ndarray, "P 3"]) -> "PointTree":
        """Return a tree of points, of which there is one at least."""
        low, size = points.min(axis=0), float(np.ptp(points, axis=0).max()) or 1.0
        cells = ((points - low) / size * (2**_BITS - 1)).astype(np.int64)
        code = np.zeros(len(points), dtype=np.int64)
        for bit in range(_BITS):
            for axis in range(3):
                code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
        order = np.argsort(code, kind="stable")
        return cls(np.ascontiguousarray(points[order]), order)

    @cached_property
    def _balls(self) -> tuple[Float[np.ndarray, "B 3"], Float[np.ndarray, "B"], Int[np.ndarray, "L"]]:
        """Centres and radii of the balls, around runs of `_BRANCHES` of the next level, and the levels' numbers."""
        levels: list[tuple[np.ndarray, np.ndarray]] = []
        run = _BRANCHES
        while not levels or len(levels[-1][1]) > _BRANCHES:
            starts = np.arange(0, len(self.points), run)
            low, high = (edge.reduceat(self.points, starts, axis=0) for edge in (np.minimum, np.maximum))
            centres = 0.5 * (low + high)
            away = self.points - np.repeat(centres, np.diff(starts, append=len(self.points)), axis=0)
            levels.append((centres, np.sqrt(np.maximum.reduceat(np.einsum("pi,pi->p", away, away), starts))))
            run *= _BRANCHES
        centres, radii = (np.concatenate(parts) for parts in zip(*reversed(levels), strict=True))
        return centres, radii, np.array([len(radii) for _, radii in reversed(levels)], dtype=np.int64)

    def nearest(  # noqa: PLR0913  # the parts of places, and what is asked of them
        self,
        shape: Shape,
        rotations: Float[np.ndarray, "N 3 3"],
        translations: Float[np.ndarray, "N 3"],
        *,
        limit: float | Float[np.ndarray, "N"] = np.inf,
        accuracy: Accuracy = _EXACT,
        scale: float = 1.0,
    ) -> Nearest:
        """Return which points can be the nearest ones to a shape at each of N places, within its limit.

        Args: `shape`: the solid or surface; `rotations`: of the points in its frame; `translations`: of the points in
        its frame [m]; `limit`: largest distance of interest [m]; `accuracy`: of the distances; `scale`: size of the
        shape over that of its samples.
        """
        places, total, room = len(translations), len(self.points), _ROOM * len(translations)
        limits, known = np.broadcast_to(limit, places), np.array(accuracy)
        grid, field = (shape.address, None) if isinstance(shape.structure, Grid) else (None, shape.address)
        own = real(rotations), real(translations), real(limits)
        centres, radii, counts = self._balls
        balls, low = np.empty(2 * total, dtype=np.int64), np.empty(total)
        while True:
            indices, bounds = np.empty((2, room), dtype=np.int64), np.empty((2, room))
            found = _NEAR_POINTS(
                grid, field, 1.0 / scale, *map(at, (known, centres, radii, counts)), len(counts), at(self.points),
                total, _BRANCHES, *map(at, own), places, at(balls), at(low), room, *map(at, (*indices, *bounds)),
            )  # fmt: skip
            if found <= room:
                return Nearest(*(part[:found].copy() for part in (*indices, *bounds)))
            room = found
