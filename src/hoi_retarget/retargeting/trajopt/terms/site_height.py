"""Height of a supporting foot: the paper's E^fz."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.retargeting.trajopt.terms.site_rotation import SiteRotation
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import SIDES

# An anchored foot that turns weighs as much as one that moves by the angle times this [m]. With more, where a wide
# squat leaves no flat sole (H2), the hands pay for it.
SOLE_REACH = 0.05
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


def stance_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[SiteHeight | SiteRotation]:
    """Yield height and rotation of every foot that stands."""
    for k, side in enumerate(SIDES):
        flags, site = targets.stance_flags[:, k], f"{side}_foot"
        if not flags.any():
            continue
        height = targets.foot_positions[:, k, 2]
        yield SiteHeight(f"{side}_stance_height", site, height, weights.stance_height * flags)
        if site not in reference.model.spec.dropped_rotations:
            rotation = se3.quat_to_matrix(targets.foot_quats[:, k]).transpose(1, 2, 0)
            # The residual's square is twice the squared angle.
            anchored = 0.5 * SOLE_REACH**2 * weights.stance_anchor * targets.anchor_weights[:, k]
            weight = weights.stance_orientation * flags + anchored
            yield SiteRotation(f"{side}_stance_orientation", site, rotation, weight)
