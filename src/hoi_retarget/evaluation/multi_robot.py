"""Whether people's robots hold an object as the people did, relative to each other."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.evaluation.statistics import norms
from hoi_retarget.evaluation.view import HAND_SITES
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.report import InterRobotHandError
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import RobotModel


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
