"""Pairs of links that may meet: which skin points of one are inside the solid of the other.

All points inside count, so residuals are smooth however a link turns. Two links that cross deeply have points of the
larger one on both sides of the smaller one, which would hold this fast: beyond `GRAZING_DEPTH_M`, only the smaller
one's points decide the direction.
"""

from bisect import bisect_left
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float, Int

from hoi_retarget.kernels import moving_points
from hoi_retarget.kernels.shape import OVERRATED, DistanceGrid
from hoi_retarget.robots.frames import Frame
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin

GRAZING_DEPTH_M = 8e-3  # [m]
REACH = 0.02  # [m]: links that are further apart do not meet in one solve.
MAX_EXIT_M, EXIT_STEPS = 0.1, 12
"""[m]; a link that is longer than this in a direction is left another way. Steps to its surface."""
SPACING, COARSE = 0.006, 0.035  # [m] between a link's points; between the coarse ones of them.


@dataclass(frozen=True, eq=False)
class SpreadPoints:
    """Points all over a link's skin, in the link's frame [m]."""

    points: Float[np.ndarray, "K 3"]
    coarse: int  # Number of points at the front that leave none of the others further than `COARSE` from one of them.
    nearest: Int[np.ndarray, "K"]  # Which of them is nearest to each point,
    away: Float[np.ndarray, "K"]  # and how far it is.


@dataclass(frozen=True, eq=False)
class LinkPair:
    """Skin of one link that may meet the solid of another, in the frames in which they are near."""

    link: Frame
    skin: SpreadPoints
    other: Frame
    solid: DistanceGrid
    deepest: float  # Depth beyond which a point no longer decides the direction [m].
    frames: Int[np.ndarray, "F"]
    side: Float[np.ndarray, "3 T"] | None = None
    """World direction in which points are out of the solid; None where it is the nearest."""

    def meeting(self, here: Kinematics, there: Kinematics, margin: float) -> "Meeting | None":
        """Return the points that are inside or not as far from the solid as the margin [m], or None.

        The link has the trajectory `here` and the other `there`: the same one, or those of two robots.
        """
        times, seen, depths, slopes = self._inside(here, there, margin)
        if not times.size:
            return None
        turn = there.orientation(self.other)[:, :, self.frames]
        slopes[depths > self.deepest] = 0.0
        if self.side is not None:
            away = np.einsum("jik,jk->ki", turn[:, :, times], self.side[:, self.frames[times]])
            ways = self._ways_out(seen, away, margin)
            out = ways < MAX_EXIT_M
            depths, slopes = np.where(out, ways, depths), np.where(out[:, None], away, slopes)
        active, first, column = np.unique(times, return_index=True, return_inverse=True)
        row = np.arange(len(times)) - first[column]
        found = np.zeros((row.max() + 1, len(active)))
        inwards, levers = np.zeros((2, len(found), 3, len(active)))
        found[row, column] = np.minimum(depths, self.deepest)
        inwards[row, :, column] = -np.einsum("ijk,kj->ki", turn[:, :, times], slopes)
        offset = there.point(self.other)[:, self.frames] - here.point(self.link)[:, self.frames]
        levers[row, :, column] = np.einsum("ijk,kj->ki", turn[:, :, times], seen) + offset[:, times].T
        return Meeting(self.frames[active], found, inwards, levers)

    def _inside(
        self, here: Kinematics, there: Kinematics, margin: float
    ) -> tuple[Int[np.ndarray, "N"], Float[np.ndarray, "N 3"], Float[np.ndarray, "N"], Float[np.ndarray, "N 3"]]:
        """Return index of the frame, place in the solid's frame and depth [m] of points inside; slopes of distances."""
        link, other = ((own.orientation(at), own.point(at)) for own, at in ((here, self.link), (there, self.other)))
        neighbours = self.skin.coarse, self.skin.nearest, self.skin.away, COARSE
        factors = {"margin": margin, "overrated": OVERRATED}
        solid = self.solid.compiled
        return moving_points.meeting(solid, self.skin.points, neighbours, link, other, self.frames, **factors)

    def _ways_out(
        self, points: Float[np.ndarray, "K 3"], away: Float[np.ndarray, "K 3"], margin: float
    ) -> Float[np.ndarray, "K"]:
        """Return the distances of points to the outside of the solid along directions in its frame [m]."""
        ways = np.zeros(len(points))
        for _ in range(EXIT_STEPS):
            ways += np.maximum(margin - self.solid.distances(points + ways[:, None] * away), 0.0)
        return np.where(self.solid.distances(points + ways[:, None] * away) > 0.0, ways, np.inf)

    def nearest(self, here: Kinematics, there: Kinematics) -> Float[np.ndarray, "F"]:
        """Return the distance of the nearest of the coarse points in every frame [m]."""
        position, rotation = _pose(here, self.link, self.frames)
        other_position, turn = _pose(there, self.other, self.frames)
        offset = np.einsum("jit,jt->it", turn, position - other_position)
        return self._coarse(np.einsum("jit,jkt->ikt", turn, rotation), offset).min(axis=1, initial=np.inf)

    def _coarse(self, rotation: np.ndarray, offset: np.ndarray) -> Float[np.ndarray, "F C"]:
        seen = np.matmul(self.skin.points[: self.skin.coarse], rotation.transpose(2, 1, 0)) + offset.T[:, None]
        return self.solid.distances(seen.reshape(-1, 3)).reshape(seen.shape[:2])


@dataclass(frozen=True, eq=False)
class Meeting:
    """Points of one link inside another, as many a frame as the most in any; zeros where there are fewer."""

    frames: Int[np.ndarray, "F"]
    depths: Float[np.ndarray, "m F"]  # [m]
    inwards: Float[np.ndarray, "m 3 F"]  # Derivative of the depth by the point's position, in world axes.
    levers: Float[np.ndarray, "m 3 F"]  # From the link's origin to the point, in world axes [m].

    @property
    def moments(self) -> Float[np.ndarray, "m 3 F"]:
        """Derivative of the depth by the link's rotation about its origin [m/rad]."""
        return np.cross(self.levers, self.inwards, axis=1)


def near_pairs(
    first: LinkSkin, second: LinkSkin, here: Kinematics, there: Kinematics
) -> tuple[LinkPair | None, LinkPair | None]:
    """Return the first link's points against the second's solid, and the other way around; None where they stay apart.

    They have the frames in which the links are near.

    `first`: skin of one link; `second`: skin of the other; `here`: trajectory of the first link; `there`: trajectory of
    the second.
    """
    frames = _beside(first, second, here, there)
    if not frames.size:
        return None, None
    larger = first.radius > second.radius
    return (
        _near_pair(first, second, here, there, GRAZING_DEPTH_M if larger else np.inf, frames),
        _near_pair(second, first, there, here, np.inf if larger else GRAZING_DEPTH_M, frames),
    )


def _near_pair(  # noqa: PLR0913, PLR0917  # the parts of a pair
    link: LinkSkin, other: LinkSkin, here: Kinematics, there: Kinematics, deepest: float, frames: np.ndarray
) -> LinkPair | None:
    pair = LinkPair(link.frame, _spread(link), other.frame, other.solid, deepest, frames)
    near = frames[pair.nearest(here, there) < REACH]
    return replace(pair, frames=near) if near.size else None


def _beside(first: LinkSkin, second: LinkSkin, here: Kinematics, there: Kinematics) -> Int[np.ndarray, "F"]:
    """Return the frames in which the ball around the smaller link is not further than `REACH` from the other."""
    if first.radius > second.radius:
        return _beside(second, first, there, here)
    centre, around = here.point(first.middle), there.point(second.middle)
    frames = np.flatnonzero(((centre - around) ** 2).sum(axis=0) < (first.radius + second.radius + REACH) ** 2)
    position, turn = _pose(there, second.frame, frames)
    seen = np.einsum("jit,jt->ti", turn, centre[:, frames] - position)
    return frames[second.solid.distances(seen) < OVERRATED * (first.radius + REACH)]


@lru_cache(maxsize=256)
def _spread(link: LinkSkin) -> SpreadPoints:
    """Return the first of a link's points, as many as leave none further than `SPACING` from one of them."""
    count, coarse = (_covering(link.points, spacing) for spacing in (SPACING, COARSE))
    away, nearest = scipy.spatial.KDTree(link.points[:coarse]).query(link.points[:count])
    return SpreadPoints(link.points[:count], coarse, np.asarray(nearest), away)


def _covering(points: Float[np.ndarray, "P 3"], spacing: float) -> int:
    """Return the number of first points that leave no other point further than `spacing` [m] from one of them."""

    def covered(count: int) -> bool:
        return bool(scipy.spatial.KDTree(points[:count]).query(points)[0].max() < spacing)

    return 1 + bisect_left(range(1, len(points)), True, key=covered)


def _pose(
    kinematics: Kinematics, frame: Frame, frames: Int[np.ndarray, "F"]
) -> tuple[Float[np.ndarray, "3 F"], Float[np.ndarray, "3 3 F"]]:
    """Return position [m] and rotation of a frame fixed to a node, in some frames of the trajectory."""
    turn = kinematics.node_rotation[:, :, frame.node, frames]
    position = kinematics.node_position[:, frame.node, frames] + np.einsum("ijt,j->it", turn, frame.position)
    return position, np.einsum("ijt,jk->ikt", turn, frame.rotation)
