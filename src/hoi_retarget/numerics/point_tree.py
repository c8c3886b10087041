"""Points in nested balls, and the search for the nearest one to a shape, at many places at once.

The search is exact: a ball is left out only where none of its points can be the nearest. Far apart
shapes cost little, because the largest balls then decide.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

_BRANCHES = 8
_BITS = 10
"""Of each coordinate, in the order of points."""

Bounds = Callable[[Float[np.ndarray, "K 3"]], tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K"]]]
"""Lower and upper bounds of the distances of points [m]."""


@dataclass(frozen=True, eq=False)
class _Level:
    """Balls around runs of `_BRANCHES` balls of the next level."""

    centres: Float[np.ndarray, "B 3"]
    radii: Float[np.ndarray, "B"]


@dataclass(frozen=True, eq=False)
class Nearest:
    """Points that can be the nearest ones, by their bounds [m]."""

    place: Int[np.ndarray, "C"]
    """Which of the places each is at; places without any are beyond the limit."""
    point: Int[np.ndarray, "C"]
    """Which of the tree's points it is."""
    lower: Float[np.ndarray, "C"]
    upper: Float[np.ndarray, "C"]


@dataclass(frozen=True, eq=False)
class PointTree:
    """Points in nested balls."""

    points: Float[np.ndarray, "P 3"]
    """In an order in which neighbours are near each other [m]."""
    order: Int[np.ndarray, "P"]
    """Index that each had."""

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
    def _levels(self) -> tuple[_Level, ...]:
        """From the largest balls to the smallest, the runs of points."""
        levels: list[_Level] = []
        run = _BRANCHES
        while not levels or len(levels[-1].radii) > _BRANCHES:
            starts = np.arange(0, len(self.points), run)
            low, high = (edge.reduceat(self.points, starts, axis=0) for edge in (np.minimum, np.maximum))
            centres = 0.5 * (low + high)
            away = self.points - np.repeat(centres, np.diff(starts, append=len(self.points)), axis=0)
            radii = np.sqrt(np.maximum.reduceat(np.einsum("pi,pi->p", away, away), starts))
            levels.append(_Level(centres, radii))
            run *= _BRANCHES
        return tuple(reversed(levels))

    def nearest(
        self,
        rotations: Float[np.ndarray, "K 3 3"],
        translations: Float[np.ndarray, "K 3"],
        bounds: Bounds,
        limit: float | Float[np.ndarray, "K"] = np.inf,
    ) -> Nearest:
        """Return which points can be the nearest at each of K places, within its limit.

        A place turns and moves the points, `R p + t`, into the frame in which `bounds` measures. The distance must not
        change by more than the way between two points, as distances do.

        Args:
            rotations: Of the places.
            translations: Of the places [m].
            bounds: Lower and upper bounds of the distance of points.
            limit: Largest distance of interest [m].
        """
        places = len(translations)
        most = np.full(places, np.inf)
        most[:] = limit
        place = np.repeat(np.arange(places), len(self._levels[0].radii))
        ball = np.tile(np.arange(len(self._levels[0].radii)), places)
        sizes = [len(level.radii) for level in self._levels[1:]] + [len(self.points)]
        for level, below in zip(self._levels, sizes, strict=True):
            radius = level.radii[ball]
            lower, upper = bounds(_placed(level.centres[ball], rotations[place], translations[place]))
            np.minimum.at(most, place, upper + radius)
            near = lower - radius <= most[place]
            place, ball = np.repeat(place[near], _BRANCHES), ball[near]
            ball = (ball[:, None] * _BRANCHES + np.arange(_BRANCHES)).ravel()
            there = ball < below
            place, ball = place[there], ball[there]
        lower, upper = bounds(_placed(self.points[ball], rotations[place], translations[place]))
        np.minimum.at(most, place, upper)
        near = lower <= most[place]
        return Nearest(place[near], ball[near], lower[near], upper[near])


def _placed(points: np.ndarray, rotations: np.ndarray, translations: np.ndarray) -> np.ndarray:
    return np.einsum("kij,kj->ki", rotations, points) + translations
