"""Orientation flips: links that point away from the human's, the classic wrong optimum of inverse kinematics."""

import numpy as np

from hoi_retarget.motion.report import OrientationFlip
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.robots.model import Kinematics

FLIP_DEG = 100.0
"""Between a quarter turn, which joint ranges can force, and half a turn."""


def orientation_flips(kinematics: Kinematics, targets: Targets) -> tuple[OrientationFlip, ...]:
    """Return where a site of the IK table is further than `FLIP_DEG` from the rotation it should follow."""
    found = []
    for column, row in enumerate(kinematics.model.spec.ik_rows):
        if row.rotation_weight == 0:
            continue
        wanted = se3.quat_to_matrix(targets.site_quats[:, column])
        degrees = np.degrees(se3.matrix_angle_between(kinematics.site_rotation(row.site), wanted))
        for first, stop in runs(degrees > FLIP_DEG):
            found.append(OrientationFlip(row.site, first, stop - 1, float(degrees[first:stop].max())))
    return tuple(found)
