"""Skin of a robot outside other robots with known motions; the paper has one robot."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.trajopt.link_pairs import LinkPair, near_pairs
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.retargeting.trajopt.terms.self_clearance import MARGIN
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import skin_of

CLEARLY_OUTSIDE = 0.04  # [m]; a link that is so far outside shows its side as well as any.
STEADY_SECONDS = 0.27  # A side turns over this time.


@dataclass(frozen=True, eq=False)
class RobotClearance:
    """`max(0, margin - distance)^2` [m^2] of skin points of each robot from the solids of the other."""

    name: str
    other: Kinematics
    own: tuple[LinkPair, ...]  # Links of the robot that is solved for, against solids of the other.
    others: tuple[LinkPair, ...]  # Links of the other, against solids of the robot.
    margin: float  # [m]
    weight: float

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return the rows of the pairs that meet at a trajectory."""
        return (*self._own_rows(kinematics), *self._others_rows(kinematics))

    def _own_rows(self, kinematics: Kinematics) -> Iterator[FrameRows]:
        for pair in self.own:
            found = pair.meeting(kinematics, self.other, self.margin)
            if found is not None:
                yield FrameRows(pair.link, found.depths, found.inwards, found.moments, self.weight, found.frames)

    def _others_rows(self, kinematics: Kinematics) -> Iterator[FrameRows]:
        """Yield rows of points that stay where they are, while the solid moves."""
        for pair in self.others:
            found = pair.meeting(self.other, kinematics, self.margin)
            if found is None:
                continue
            origins = self.other.point(pair.link) - kinematics.point(pair.other)
            moments = np.cross(found.levers + origins[:, found.frames], found.inwards, axis=1)
            yield FrameRows(pair.other, found.depths, -found.inwards, -moments, self.weight, found.frames)


def robot_clearance_terms(
    weights: Weights, reference: Kinematics, others: Sequence[Kinematics], *, passing_at: float | None = None
) -> Iterator[RobotClearance]:
    """Yield the clearance from each other robot that comes near at the trajectory that a solve starts from.

    `weights`: `self_clearance` is the weight against other robots, too; `reference`: the trajectory; `others`: motions
    of the other robots, frame by frame in step; `passing_at`: frames a second, where links that pass each other are to
    keep to the side on which they come.
    """
    if weights.self_clearance == 0:
        return
    for index, other in enumerate(others):
        found = [
            near_pairs(first, second, reference, other)
            for first in skin_of(reference.model).links
            for second in skin_of(other.model).links
        ]
        own, theirs = (tuple(pair for pair in side if pair is not None) for side in zip(*found, strict=True))
        if passing_at is not None:
            own = tuple(_passing(pair, reference, other, passing_at) for pair in own)
            theirs = tuple(_passing(pair, other, reference, passing_at) for pair in theirs)
        if own or theirs:
            yield RobotClearance(f"robot_clearance_{index}", other, own, theirs, MARGIN, weights.self_clearance)


def _passing(pair: LinkPair, here: Kinematics, there: Kinematics, fps: float) -> LinkPair:
    """Return a pair of links with exits on the side of the link before and after the meeting.

    An arm that is more than half in another one would leave it on the wrong side, and one that goes right through it is
    pushed back in one frame and forwards in the next: of the two, the mean is the way around.
    """
    every = np.arange(len(here.qpos))
    link = here.point(pair.link.of(pair.skin.points.mean(axis=0), np.eye(3)))
    offset = link - there.point(pair.other)
    turn = there.orientation(pair.other)
    distances, slopes = pair.solid.distances_and_slopes(np.einsum("jit,jt->ti", turn, offset))
    outwards = np.einsum("jit,ti->jt", turn, slopes)
    shown = np.clip(distances, 1e-5, CLEARLY_OUTSIDE) * outwards
    nearness = 1.0 / (1.0 + ((every[:, None] - every) / (STEADY_SECONDS * fps)) ** 2)
    side = shown @ nearness
    length = np.linalg.norm(side, axis=0)
    side = np.where(length > 1e-9, side / np.maximum(length, 1e-9), outwards)
    return replace(pair, side=side, deepest=np.inf)
