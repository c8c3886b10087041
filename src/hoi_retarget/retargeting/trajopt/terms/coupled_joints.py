"""A joint that follows another one by the robot's mechanism, as the last joints of fingers do."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import TangentRows
from hoi_retarget.robots.model import Kinematics

WEIGHT = 3e4
"""[1/rad^2]; measured, joints follow within 1.4e-3 rad."""


@dataclass(frozen=True, eq=False)
class CoupledJoints:
    """`(theta - ratio * theta' - offset)^2` [rad^2] of a follower and its leader."""

    name: str
    joint: int
    other: int
    ratio: float
    offset: float
    """[rad]"""

    def rows(self, kinematics: Kinematics) -> tuple[TangentRows, ...]:
        """Return the row at a trajectory."""
        angles = kinematics.qpos[:, 7:]
        residual = angles[:, self.joint] - self.ratio * angles[:, self.other] - self.offset
        first, second = sorted([(6 + self.joint, 1.0), (6 + self.other, -self.ratio)])
        jacobian = np.tile(np.array([first[1], second[1]])[None, None, :, None], (1, 1, 1, len(residual)))
        return (TangentRows((first[0], second[0]), residual[None], jacobian, WEIGHT),)


def coupling_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[CoupledJoints]:
    """Yield a term for each joint that follows another, with a weight of its own."""
    names = reference.model.joint_names
    for one in reference.model.spec.couplings:
        if one.other:
            joint, other = names.index(one.joint), names.index(one.other)
            yield CoupledJoints(f"{one.joint}_coupled", joint, other, one.ratio, one.offset)
