"""A robot's trunk turned over against the person's: what lies or is twisted where the person sits or stands."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.person import Person
from hoi_retarget.motion.report import TrunkTurn
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.robots.model import Kinematics

LARGEST_TURN_DEG = 60.0
"""Trunks of usable motions stay within 44 degrees of the person's."""


def trunk_turns(kinematics: Kinematics, person: Person) -> tuple[TrunkTurn, ...]:
    """Return where the robot's trunk is turned by more than `LARGEST_TURN_DEG` against the person's."""
    degrees = trunk_deviation_deg(kinematics, person)
    return tuple(
        TrunkTurn(first, stop - 1, float(degrees[first:stop].max())) for first, stop in runs(degrees > LARGEST_TURN_DEG)
    )


def trunk_deviation_deg(kinematics: Kinematics, person: Person) -> Float[np.ndarray, "T"]:
    """Return the angle between the robot's trunk and the person's, each as its hips and shoulders lie [deg].

    Unlike the rotations of pelvis and chest it does not ask how a trunk bends: robots have stiff ones.
    """
    robot, human = _trunk(kinematics.site_position), _trunk(person.position)
    return np.degrees(se3.matrix_angle_between(robot, human))


def _trunk(position: Callable[[str], Float[np.ndarray, "T 3"]]) -> Float[np.ndarray, "T 3 3"]:
    """Return the frame whose z axis goes from the hips' middle to the shoulders', and whose y axis goes left."""
    left = position("left_hip") + position("left_shoulder")
    right = position("right_hip") + position("right_shoulder")
    up = position("left_shoulder") + position("right_shoulder") - position("left_hip") - position("right_hip")
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    ahead = np.cross(left - right, up)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    return np.stack([ahead, np.cross(up, ahead), up], axis=2)
