"""Differences of the configuration over time: the paper's E^j, and the IK stage's smoothness."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import comb

import numpy as np

from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import StencilRows, TangentRows
from hoi_retarget.robots.model import Kinematics

PAPER_RATE = 30.0  # [frames/s] at which the paper's weights are given


@dataclass(frozen=True, eq=False)
class Differences:
    """`|delta^order q|^2`, where q is base position [m], base quaternion and joint angles [rad].

    The base rotation enters as a unit quaternion, half the rotation vector when small. For the jerk
    of the paper, whose table writes `|delta qdd|^2`, the order is 3 and the weight is divided by
    `dt^4`; this is how the authors' release scales it.
    """

    name: str
    order: int
    weight: float

    def rows(self, kinematics: Kinematics) -> tuple[StencilRows | TangentRows, ...]:
        """Return the rows at a trajectory; none when it is too short for a difference."""
        qpos = kinematics.qpos
        if len(qpos) <= self.order:
            return ()
        order = self.order
        coefficients = tuple(float((-1) ** (order - k) * comb(order, k)) for k in range(order + 1))
        quats = se3.quat_continuous(qpos[:, 3:7])
        count = len(qpos) - order
        # d quat = quat * (0, dphi / 2): columns are half the products with the three units.
        by_rotation = 0.5 * np.stack([se3.quat_multiply(quats, unit) for unit in _UNITS]).transpose(2, 0, 1)
        jacobian = np.stack([c * by_rotation[:, :, k : k + count] for k, c in enumerate(coefficients)])
        return (
            StencilRows(slice(0, 3), coefficients, _difference(qpos[:, :3], order), self.weight),
            StencilRows(slice(6, None), coefficients, _difference(qpos[:, 7:], order), self.weight),
            TangentRows((3, 4, 5), _difference(quats, order), jacobian, self.weight),
        )


_UNITS = np.eye(4)[1:]


def _difference(values: np.ndarray, order: int) -> np.ndarray:
    return np.ascontiguousarray(np.diff(values, order, axis=0).T)


def jerk_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[Differences]:
    """Yield the third differences over time."""
    yield Differences("joint_jerk", 3, weights.jerk * targets.fps**4 * (targets.fps / PAPER_RATE) ** 2)
