"""Sole corners above the floor; the paper has no such term, and its soles sink by up to 2 cm."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import SIDES, SOLE_CORNERS


@dataclass(frozen=True, eq=False)
class FloorClearance:
    """`min(0, z - margin)^2` [m^2] of some sites of one link; quadratic once below, nothing above."""

    name: str
    sites: tuple[str, ...]
    margin: float
    """[m]"""
    weight: float

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return one row per site, all written for the twist of the first."""
        first = kinematics.frame(self.sites[0])
        points = np.stack([kinematics.point(site) for site in self.sites])
        depth = points[:, 2] - self.margin
        below = depth < 0.0
        lever = points - points[0]
        # z of a point moves with v_z + (omega x lever)_z.
        by_linear = np.zeros((len(self.sites), 3, depth.shape[1]))
        by_linear[:, 2] = below
        by_angular = np.zeros_like(by_linear)
        by_angular[:, 0] = below * lever[:, 1]
        by_angular[:, 1] = below * -lever[:, 0]
        return (FrameRows(first, np.where(below, depth, 0.0), by_linear, by_angular, self.weight),)


def floor_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[FloorClearance]:
    """Yield the sole corners of each foot above the floor."""
    for side in SIDES:
        corners = tuple(f"{side}_sole_{corner}" for corner in SOLE_CORNERS)
        yield FloorClearance(f"{side}_floor", corners, 0.0, weights.floor_clearance)
