"""Parts that are pinned by hand: near the path through their pins; not in the paper."""

from collections.abc import Iterator

from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.terms.site_pose import SitePosition, SiteRotation
from hoi_retarget.robots.model import Kinematics

# A part that turns weighs as much as one that moves by the angle times this [m].
REACH = 0.1


def pin_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[SitePosition | SiteRotation]:
    """Yield place and rotation of every site that is pinned."""
    for pin in targets.pins:
        if pin.weights.any():
            yield SitePosition(f"{pin.site}_pin", pin.site, pin.positions.T, weights.pin * pin.weights)
        if pin.turn_weights.any():
            rotation = se3.quat_to_matrix(pin.quats).transpose(1, 2, 0)
            # The residual's square is twice the squared angle.
            weight = 0.5 * REACH**2 * weights.pin * pin.turn_weights
            yield SiteRotation(f"{pin.site}_pinned_rotation", pin.site, rotation, weight)
