"""A robot's trunk turned over against the person's: what lies or is twisted where the person sits or stands."""

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.trunk import trunk_rotations
from hoi_retarget.motion.report import TrunkTurn
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.robots.model import Kinematics

LARGEST_TURN_DEG = 60.0
"""Trunks of usable motions stay within 44 degrees of the person's."""


def trunk_turns(kinematics: Kinematics, targets: Targets) -> tuple[TrunkTurn, ...]:
    """Return where the robot's trunk is turned by more than `LARGEST_TURN_DEG` against the person's.

    A trunk on a base stays upright where the person bends down; it is not turned over.
    """
    if targets.base_qpos is not None:
        return ()
    degrees = trunk_errors_deg(kinematics, targets)
    return tuple(
        TrunkTurn(first, stop - 1, float(degrees[first:stop].max())) for first, stop in runs(degrees > LARGEST_TURN_DEG)
    )


def trunk_errors_deg(kinematics: Kinematics, targets: Targets) -> Float[np.ndarray, "T"]:
    """Return the angle between the robot's trunk and the person's [deg]."""
    return np.degrees(se3.matrix_angle_between(trunk_rotations(kinematics.site_position), targets.trunk_rotations))
