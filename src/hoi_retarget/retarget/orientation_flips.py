"""Links that ended up turned over against the human's: the classic wrong optimum of inverse kinematics."""

from dataclasses import dataclass

import numpy as np

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.retarget.targets import Targets
from hoi_retarget.robots.model import Kinematics

TURNED_DEG = 100.0
"""Between a quarter turn, which joint ranges can force, and half a turn."""


@dataclass(frozen=True)
class TurnedSegment:
    """A site that points away from its target, from its first to its last frame."""

    site: str
    first_frame: int
    last_frame: int
    """Included."""
    largest_deg: float

    def __str__(self) -> str:
        return (
            f"{self.site} is turned by up to {self.largest_deg:.0f} degrees against the human's, "
            f"frames {self.first_frame} to {self.last_frame}"
        )


def turned_over(kinematics: Kinematics, targets: Targets) -> tuple[TurnedSegment, ...]:
    """Return where a site of the IK table is further than `TURNED_DEG` from the rotation it should follow."""
    found = []
    for column, row in enumerate(kinematics.model.spec.ik_rows):
        if row.rotation_weight == 0:
            continue
        wanted = se3.quat_to_matrix(targets.site_quats[:, column])
        degrees = np.degrees(se3.matrix_angle_between(kinematics.site_rotation(row.site), wanted))
        for first, stop in runs(degrees > TURNED_DEG):
            found.append(TurnedSegment(row.site, first, stop - 1, float(degrees[first:stop].max())))
    return tuple(found)
