"""Skin of a robot's links outside the solids of its other links; the paper has no such term, and its hands sink.

All points that are inside cost something, so the cost is smooth however a link turns. Two links that cross deeply have
points of the larger one on both sides of the smaller one, which would hold this fast: beyond `GRAZING`, only the
smaller one's points tell the way out.
"""

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from hoi_retarget.numerics.distance_grid import DistanceGrid
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.rows import FrameRows, PairRows
from hoi_retarget.robots.limbs import separable_pairs
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.parts import Frame
from hoi_retarget.robots.skin import LinkSkin, skin_of

MARGIN = 3e-3  # [m]
GRAZING = 8e-3  # [m]
REACH = 0.04  # [m]: links that are further apart do not meet in one solve.
SPACING, COARSE = 0.006, 0.035  # [m] between a link's points; between those of them that tell where it is near.
_NO_FRAMES = np.zeros(0, dtype=int)
_OVERRATED = 1.5  # Beyond its grid, a solid may seem further away than it is by a factor of up to the root of 2.


@dataclass(frozen=True, eq=False)
class SpreadPoints:
    """Points all over a link's skin, in the link's frame [m]."""

    points: Float[np.ndarray, "K 3"]
    coarse: int
    """Number of points at the front that leave none of the others further than `COARSE` from one of them."""
    nearest: Int[np.ndarray, "K"]
    """Which of them is nearest to each point,"""
    away: Float[np.ndarray, "K"]
    """and how far it is."""


@dataclass(frozen=True, eq=False)
class LinkPair:
    """Skin of one link that may meet the solid of another, in the frames in which they are near."""

    link: Frame
    skin: SpreadPoints
    other: Frame
    solid: DistanceGrid
    deepest: float
    """Depth from which on a point no longer tells the way out [m]."""
    frames: Int[np.ndarray, "F"]

    def rows_at(self, kinematics: Kinematics, margin: float, weight: float) -> PairRows | None:
        """Return `max(0, margin - distance)` of the points where it is above zero: as many as the most in a frame."""
        rotation, offset, turn = self._poses(kinematics)
        times, points = self._near(rotation, offset, margin)
        seen = np.einsum("ijk,kj->ki", rotation[:, :, times], self.skin.points[points]) + offset[:, times].T
        depths = margin - self.solid.distances(seen)
        inside = depths > 0
        if not inside.any():
            return None
        times, seen, depths = times[inside], seen[inside], depths[inside]
        _, slopes = self.solid.distances_and_slopes(seen)
        slopes[depths > self.deepest] = 0.0
        turns = turn[:, :, times]
        inwards = -np.einsum("ijk,kj->ki", turns, slopes)
        levers = np.einsum("ijk,kj->ki", turns, seen - offset[:, times].T)
        active, first, column = np.unique(times, return_index=True, return_inverse=True)
        row = np.arange(len(times)) - first[column]
        residual = np.zeros((row.max() + 1, len(active)))
        by_linear, by_angular = np.zeros((2, len(residual), 3, len(active)))
        residual[row, column] = np.minimum(depths, self.deepest)
        by_linear[row, :, column] = inwards
        by_angular[row, :, column] = np.cross(levers, inwards)
        return PairRows(FrameRows(self.link, residual, by_linear, by_angular, weight, self.frames[active]), self.other)

    def nearest(self, kinematics: Kinematics) -> Float[np.ndarray, "F"]:
        """Return the distance of the nearest of the coarse points in every frame [m]."""
        rotation, offset, _ = self._poses(kinematics)
        return self._coarse(rotation, offset).min(axis=1, initial=np.inf)

    def _near(
        self, rotation: np.ndarray, offset: np.ndarray, margin: float
    ) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"]]:
        """Return frame and point, by frames, wherever the coarse point beside it does not tell that it is far."""
        distances = self._coarse(rotation, offset)
        frames = np.flatnonzero(distances.min(axis=1) < margin + _OVERRATED * COARSE)
        near = distances[frames[:, None], self.skin.nearest] < margin + _OVERRATED * self.skin.away
        times, points = np.nonzero(near)
        return frames[times], points

    def _coarse(self, rotation: np.ndarray, offset: np.ndarray) -> Float[np.ndarray, "F C"]:
        seen = np.matmul(self.skin.points[: self.skin.coarse], rotation.transpose(2, 1, 0)) + offset.T[:, None]
        return self.solid.distances(seen.reshape(-1, 3)).reshape(seen.shape[:2])

    def _poses(
        self, kinematics: Kinematics
    ) -> tuple[Float[np.ndarray, "3 3 F"], Float[np.ndarray, "3 F"], Float[np.ndarray, "3 3 F"]]:
        """Return rotation and origin [m] of the link in the other's frame, and the rotation of that in the world."""
        position, rotation = _pose(kinematics, self.link, self.frames)
        other_position, turn = _pose(kinematics, self.other, self.frames)
        relative = np.einsum("jit,jkt->ikt", turn, rotation)
        return relative, np.einsum("jit,jt->it", turn, position - other_position), turn


@dataclass(frozen=True, eq=False)
class SelfClearance:
    """`max(0, margin - distance)^2` [m^2] of links' skin points from the solids of other links."""

    name: str
    pairs: tuple[LinkPair, ...]
    margin: float
    """[m]"""
    weight: float

    def rows(self, kinematics: Kinematics) -> tuple[PairRows, ...]:
        """Return the rows of the pairs that meet at a trajectory."""
        found = (pair.rows_at(kinematics, self.margin, self.weight) for pair in self.pairs)
        return tuple(rows for rows in found if rows is not None)


def self_clearance_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[SelfClearance]:
    """Yield the clearance of links that come near to each other at the trajectory a solve starts from, if any do."""
    pairs = tuple(_near_pairs(reference)) if weights.self_clearance > 0 else ()
    if pairs:
        yield SelfClearance("self_clearance", pairs, MARGIN, weights.self_clearance)


def _near_pairs(kinematics: Kinematics) -> Iterator[LinkPair]:
    """Yield the pairs of links that are near to each other at a trajectory, with the frames in which they are."""
    for smaller, larger, pairs in _pairs(kinematics.model):
        frames = _beside(kinematics, smaller, larger)
        for pair in pairs if frames.size else ():
            beside = replace(pair, frames=frames)
            near = frames[beside.nearest(kinematics) < REACH]
            if near.size:
                yield replace(pair, frames=near)


@lru_cache(maxsize=8)
def _pairs(model: RobotModel) -> tuple[tuple[LinkSkin, LinkSkin, tuple[LinkPair, LinkPair]], ...]:
    """Return the smaller and the larger link of every pair that must stay apart, and each against the other."""
    skins = skin_of(model).by_link
    spread = {name: _spread(skin) for name, skin in skins.items()}
    found = []
    for names in separable_pairs(model, tuple(skins)):
        smaller, larger = sorted(names, key=lambda name: skins[name].radius)
        both = tuple(
            LinkPair(skins[link].frame, spread[link], skins[other].frame, skins[other].solid, deepest, _NO_FRAMES)
            for link, other, deepest in ((smaller, larger, np.inf), (larger, smaller, GRAZING))
        )
        found.append((skins[smaller], skins[larger], both))
    return tuple(found)


def _beside(kinematics: Kinematics, link: LinkSkin, other: LinkSkin) -> Int[np.ndarray, "F"]:
    """Return the frames in which the ball around a link is not further than `REACH` from another."""
    centre, around = (kinematics.point(skin.frame.of(skin.centre, np.eye(3))) for skin in (link, other))
    frames = np.flatnonzero(((centre - around) ** 2).sum(axis=0) < (link.radius + other.radius + REACH) ** 2)
    position, turn = _pose(kinematics, other.frame, frames)
    seen = np.einsum("jit,jt->ti", turn, centre[:, frames] - position)
    return frames[other.solid.distances(seen) < _OVERRATED * (link.radius + REACH)]


def _spread(link: LinkSkin) -> SpreadPoints:
    """Return the first of a link's points, as many as leave none further than `SPACING` from one of them."""
    count, coarse = (_covering(link.points, spacing) for spacing in (SPACING, COARSE))
    away, nearest = KDTree(link.points[:coarse]).query(link.points[:count])
    return SpreadPoints(link.points[:count], coarse, np.asarray(nearest), away)


def _covering(points: Float[np.ndarray, "P 3"], spacing: float) -> int:
    """Return how many of the first points leave none further than `spacing` from one of them."""

    def covered(count: int) -> bool:
        return bool(KDTree(points[:count]).query(points)[0].max() < spacing)

    return 1 + bisect_left(range(1, len(points)), True, key=covered)


def _pose(
    kinematics: Kinematics, frame: Frame, frames: Int[np.ndarray, "F"]
) -> tuple[Float[np.ndarray, "3 F"], Float[np.ndarray, "3 3 F"]]:
    """Return position [m] and rotation of a frame fixed to a node, in some frames of the trajectory."""
    turn = kinematics.node_rotation[:, :, frame.node, frames]
    position = kinematics.node_position[:, frame.node, frames] + np.einsum("ijt,j->it", turn, frame.position)
    return position, np.einsum("ijt,jk->ikt", turn, frame.rotation)
