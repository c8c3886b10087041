"""Joint angles near a reference: the paper's E^theta."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.retarget.trajopt.rows import StencilRows
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
