"""Whether people's robots hold an object as the people did, relative to each other, and keep out of each other."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.evaluation.link_depths import pair_depths, placed_links
from hoi_retarget.evaluation.statistics import norms
from hoi_retarget.evaluation.view import HAND_SITES
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.report import InterRobotHandError, InterRobotPenetration
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import LinkSkin

SUNK = 5e-3
"""[m]; skins are known to a millimetre, and palms of rubber give way by as much."""
SHORTEST = 3
"""Frames."""


def inter_robot_hand_errors(motions: Sequence[Motion], models: Sequence[RobotModel]) -> tuple[InterRobotHandError, ...]:
    """Return how each pair of hands of different robots is placed on each object that both touch at once.

    Args:
        motions: One for each person of a clip, frame by frame in step.
        models: The robots of the motions.
    """
    hands = [tuple(_hands(motion, model)) for motion, model in zip(motions, models, strict=True)]
    found = []
    for (one, ones), (other, others) in combinations(enumerate(hands), 2):
        for ours in ones:
            for theirs in others:
                both = ours.touching & theirs.touching
                if ours.object != theirs.object or not both.any():
                    continue
                off = norms(ours.misplaced[both] - theirs.misplaced[both])
                found.append(
                    InterRobotHandError(
                        (one, other),
                        (ours.link, theirs.link),
                        ours.object,
                        int(both.sum()),
                        float(off.mean()),
                        float(off.max()),
                    )
                )
    return tuple(found)


def robot_depths(
    one: Kinematics, other: Kinematics
) -> tuple[Float[np.ndarray, "pairs T"], tuple[tuple[LinkSkin, LinkSkin], ...]]:
    """Return how deep links of two robots are in each other in every frame [m], for pairs that ever are near."""
    ones, others = placed_links(one), placed_links(other)
    return pair_depths(ones, others, product(range(len(ones)), range(len(others))))


def inter_robot_penetrations(
    motions: Sequence[Motion], models: Sequence[RobotModel]
) -> tuple[tuple[InterRobotPenetration, ...], tuple[float | None, ...]]:
    """Return where robots are more than `SUNK` in each other for `SHORTEST` frames or longer, and the depth of each.

    The depth [m] is the largest of a robot in any other, over all frames; None where there is no other.

    Args:
        motions: One for each person of a clip, frame by frame in step.
        models: The robots of the motions.
    """
    moving = [model.forward(motion.qpos) for motion, model in zip(motions, models, strict=True)]
    found, largest = [], [0.0 if len(moving) > 1 else None] * len(moving)
    for (one, here), (other, there) in combinations(enumerate(moving), 2):
        depths, near = robot_depths(here, there)
        deepest = float(depths.max(initial=0.0))
        largest[one], largest[other] = (max(deepest, largest[person] or 0.0) for person in (one, other))
        for (link, met), depth in zip(near, depths, strict=True):
            found += [
                InterRobotPenetration(
                    (one, other), (link.link, met.link), first, stop - 1, float(depth[first:stop].max())
                )
                for first, stop in runs(depth > SUNK)
                if stop - first >= SHORTEST
            ]
    return tuple(found), tuple(largest)


@dataclass(frozen=True, eq=False)
class _Hand:
    """One hand and one object."""

    link: str
    object: str
    touching: Bool[np.ndarray, "T"]
    misplaced: Float[np.ndarray, "T 3"]
    """From the target to the hand, in the object's frame [m]."""


def _hands(motion: Motion, model: RobotModel) -> Iterator[_Hand]:
    kinematics = model.forward(motion.qpos)
    sites = set(HAND_SITES.values())
    for column, link in enumerate(motion.contact_links):
        if link not in sites:
            continue
        for index, name in enumerate(motion.object_names):
            away = kinematics.site_position(link) - motion.object_pos[:, index]
            inside = se3.rotate_inverse(motion.object_quat[:, index], away)
            touching = motion.contact_flags[:, column] & (motion.contact_object[:, column] == index)
            yield _Hand(link, name, touching, inside - motion.contact_points[:, column])
