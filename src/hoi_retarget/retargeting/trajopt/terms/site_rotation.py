"""Rotation of a site from a world rotation: the paper's E^ho and E^fo, and the IK rotations."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.robots.model import Kinematics


@dataclass(frozen=True, eq=False)
class SiteRotation:
    """`|R - R*|_F^2` of one site, which is `8 sin^2(angle / 2)`, twice the squared angle when small."""

    name: str
    site: str
    target: Float[np.ndarray, "3 3 T"]
    weight: float | Float[np.ndarray, "T"]

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return the rows at a trajectory: nine, one column of the matrix after the other."""
        rotation = kinematics.orientation(self.site)
        frames = rotation.shape[-1]
        residual = (rotation - self.target).transpose(1, 0, 2).reshape(9, frames)
        # A column c of the matrix moves with omega x c.
        columns = rotation.transpose(1, 2, 0)
        by_angular = -se3.skew(columns).transpose(0, 2, 3, 1).reshape(9, 3, frames)
        return (FrameRows(kinematics.frame(self.site), residual, None, by_angular, self.weight),)
