"""Several people's robots: how their hands on one object wander from each other, and penetrations of each other."""

from collections.abc import Sequence
from itertools import combinations, product

import numpy as np

from hoi_retarget.evaluation.comparison import HAND_SITES, norms
from hoi_retarget.evaluation.penetration import sunk_runs
from hoi_retarget.evaluation.unreached_contacts import contact_offsets
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.motion_report import Event, InterRobotHandError
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.robots.link_depths import robot_depths
from hoi_retarget.robots.model import RobotModel


def inter_robot_hand_errors(motions: Sequence[Motion], models: Sequence[RobotModel]) -> tuple[InterRobotHandError, ...]:
    """Return how hands of different robots wander from each other on objects that both touch, pair by pair.

    That is the change of the vector between the two hands' offsets from their targets, from its mean over each run of
    frames in which both touch: hands as thick as they are stay as far off, and hands that move alike do not wander.
    There is one motion for each person of a clip, frame by frame in step.
    """
    paths = zip(motions, models, strict=True)
    hands = [(motion, contact_offsets(motion, model.forward(motion.qpos))) for motion, model in paths]
    found = []
    for (person, (own, offsets)), (other, (others, their_offsets)) in combinations(enumerate(hands), 2):
        for one, (index, name), another in product(_palms(own), enumerate(own.object_names), _palms(others)):
            both = own.labelled(index)[:, one] & others.labelled(index)[:, another]
            if both.any():
                apart = offsets[:, one] - their_offsets[:, another]
                errors = np.concatenate([norms(apart[a:b] - apart[a:b].mean(axis=0)) for a, b in runs(both)])
                links, frames = (own.contact_links[one], others.contact_links[another]), int(both.sum())
                numbers = frames, float(errors.mean()), float(errors.max())
                found.append(InterRobotHandError((person, other), links, name, *numbers))
    return tuple(found)


def inter_robot_penetrations(
    motions: Sequence[Motion], models: Sequence[RobotModel]
) -> tuple[tuple[Event, ...], tuple[float | None, ...]]:
    """Return the stretches of frames in which two robots are sunk in each other, and the depth of each robot.

    The depth [m] is the largest of a robot in any other, over all frames; None where there is no other. There is one
    motion for each person of a clip, frame by frame in step.
    """
    moving = [model.forward(motion.qpos) for motion, model in zip(motions, models, strict=True)]
    found, largest = [], [0.0 if len(moving) > 1 else None] * len(moving)
    for (one, here), (other, there) in combinations(enumerate(moving), 2):
        depths, near = robot_depths(here, there)
        deepest = float(depths.max(initial=0.0))
        largest[one], largest[other] = (max(deepest, largest[person] or 0.0) for person in (one, other))
        for (link, met), depth in zip(near, depths, strict=True):
            found += [
                Event(
                    "inter_robot_penetration",
                    first,
                    stop - 1,
                    float(depth[first:stop].max()),
                    people=(one, other),
                    links=(link.link, met.link),
                )
                for first, stop in sunk_runs(depth)
            ]
    return tuple(found), tuple(largest)


def _palms(motion: Motion) -> list[int]:
    """Return the columns of the contact links that are palms."""
    return [column for column, link in enumerate(motion.contact_links) if link in HAND_SITES.values()]
