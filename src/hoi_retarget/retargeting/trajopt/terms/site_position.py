"""Distance of a site from a world position: the paper's E^b, E^h and E^f, and the IK positions."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import SIDES

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


def position_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[SitePosition]:
    """Yield base and head near those of inverse kinematics, and the feet near their targets."""
    yield SitePosition("base_position", "pelvis", reference.point("pelvis"), weights.base_position)
    yield SitePosition("head_position", "head", reference.point("head"), weights.head_position)
    for k, side in enumerate(SIDES):
        target = targets.foot_positions[:, k].T
        weight = weights.feet_position + weights.stance_anchor * targets.anchor_weights[:, k]
        yield SitePosition(f"{side}_foot_position", f"{side}_foot", target, weight)
