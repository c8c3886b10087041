"""Height of a supporting foot: the paper's E^fz."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.retarget.trajopt.rows import FrameRows
from hoi_retarget.robots.model import Kinematics

UP = np.eye(3)[2:, :, None]


@dataclass(frozen=True, eq=False)
class SiteHeight:
    """`gamma (z - z*)^2` [m^2] of one site."""

    name: str
    site: str
    target: Float[np.ndarray, "T"]
    weight: Float[np.ndarray, "T"]

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return the row at a trajectory."""
        residual = kinematics.point(self.site)[2:3] - self.target
        by_linear = np.broadcast_to(UP, (1, 3, residual.shape[1]))
        return (FrameRows(kinematics.frame(self.site), residual, by_linear, None, self.weight),)
