"""Height of a supporting foot: the paper's E^fz."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.model import Kinematics
from hoi_retarget.trajopt.rows import SiteRows

UP_BY_TWIST = np.eye(6)[2:3, :, None]


@dataclass(frozen=True, eq=False)
class SiteHeight:
    """`gamma (z - z*)^2` [m^2] of one site."""

    name: str
    site: str
    target: Float[np.ndarray, "T"]
    weight: Float[np.ndarray, "T"]

    def rows(self, kinematics: Kinematics) -> tuple[SiteRows, ...]:
        """Return the row at a trajectory."""
        residual = kinematics.point(self.site)[2:3] - self.target
        jacobian = np.broadcast_to(UP_BY_TWIST, (1, 6, residual.shape[1]))
        return (SiteRows(self.site, residual, jacobian, self.weight),)
