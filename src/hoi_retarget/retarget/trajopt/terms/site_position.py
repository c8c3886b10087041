"""Distance of a site from a world position: the paper's E^b, E^h and E^f, and the IK positions."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.retarget.trajopt.rows import FrameRows
from hoi_retarget.robots.model import Kinematics

IDENTITY = np.eye(3)[:, :, None]


@dataclass(frozen=True, eq=False)
class SitePosition:
    """`|p - p*|^2` [m^2] of one site."""

    name: str
    site: str
    target: Float[np.ndarray, "3 T"]
    weight: float | Float[np.ndarray, "T"]

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return the rows at a trajectory."""
        residual = kinematics.point(self.site) - self.target
        by_linear = np.broadcast_to(IDENTITY, (3, 3, residual.shape[1]))
        return (FrameRows(kinematics.frame(self.site), residual, by_linear, None, self.weight),)
