"""Sole corners above the floor; the paper has no such term, and its soles sink by up to 2 cm."""

from dataclasses import dataclass

import numpy as np

from hoi_retarget.robots.model import Kinematics
from hoi_retarget.trajopt.rows import SiteRows


@dataclass(frozen=True, eq=False)
class FloorClearance:
    """`min(0, z - margin)^2` [m^2] of some sites of one link; quadratic once below, nothing above."""

    name: str
    sites: tuple[str, ...]
    margin: float
    """[m]"""
    weight: float

    def rows(self, kinematics: Kinematics) -> tuple[SiteRows, ...]:
        """Return one row per site, all written for the twist of the first."""
        points = np.stack([kinematics.point(site) for site in self.sites])
        depth = points[:, 2] - self.margin
        below = depth < 0.0
        jacobian = np.zeros((len(self.sites), 6, depth.shape[1]))
        lever = points - points[0]
        # z of a point moves with v_z + (omega x lever)_z.
        jacobian[:, 2] = below
        jacobian[:, 3] = below * lever[:, 1]
        jacobian[:, 4] = below * -lever[:, 0]
        return (SiteRows(self.sites[0], np.where(below, depth, 0.0), jacobian, self.weight),)
