"""Joint angles near a reference: the paper's E^theta."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import StencilRows
from hoi_retarget.robots.model import Kinematics


@dataclass(frozen=True, eq=False)
class Posture:
    """`|theta - theta*|^2` [rad^2]."""

    name: str
    target: Float[np.ndarray, "n T"]
    weight: float

    def rows(self, kinematics: Kinematics) -> tuple[StencilRows, ...]:
        """Return the rows at a trajectory."""
        residual = kinematics.qpos[:, 7:].T - self.target
        return (StencilRows(slice(6, None), (1.0,), residual, self.weight),)


def posture_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[Posture]:
    """Yield the joint angles near those of inverse kinematics."""
    yield Posture("joint_position", np.ascontiguousarray(reference.qpos[:, 7:].T), weights.joint_position)
