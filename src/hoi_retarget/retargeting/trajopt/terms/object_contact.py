"""Contact of a site with a point of the object: the paper's E^c (Eq. 1)."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.retargeting.trajopt.terms.site_pose import SiteRotation
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import PALMS

HOLD_FACTOR = 20.0  # Of the contact's weight at a hold, at which the hand touches.


@dataclass(frozen=True, eq=False)
class ObjectContact:
    """`beta |p^o - p^o*|^2` [m^2]: the site's position in the object's frame against the contact point."""

    name: str
    site: str
    target_object: Float[np.ndarray, "3 T"]
    """Contact point in the object's frame [m]; any finite number where the weight is zero."""
    object_position: Float[np.ndarray, "3 T"]
    object_rotation: Float[np.ndarray, "3 3 T"]
    weight: Float[np.ndarray, "T"]  # Zero where there is no contact.
    projection: Float[np.ndarray, "3 3 T"] | None = None
    """Of the residual, in the object's frame, as where it costs less along one direction; None for none."""

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return the rows at a trajectory."""
        frame = kinematics.frame(self.site)
        offset = kinematics.point(frame) - self.object_position
        residual = np.einsum("jit,jt->it", self.object_rotation, offset) - self.target_object
        by_linear = self.object_rotation.transpose(1, 0, 2)
        if self.projection is not None:
            residual = np.einsum("ijt,jt->it", self.projection, residual)
            by_linear = np.einsum("ijt,jkt->ikt", self.projection, by_linear)
        return (FrameRows(frame, residual, by_linear, None, self.weight),)


def contact_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[ObjectContact | SiteRotation]:
    """Yield the contact of every link that touches an object, and the rotation of a palm that does."""
    spec, frames = reference.model.spec, np.arange(targets.frames)
    for link, site in enumerate(targets.contact_links):
        if not targets.contact_flags[:, link].any():
            continue
        # Surfaces that touch hold a foot by themselves; a firm point would hold it against them. Hands have holds.
        on_surface = HOLD_FACTOR if site in PALMS else 1.0
        firm = spec.contact_weight if targets.contact == "landmark" else on_surface
        aimed = targets.carried_contact_object[:, link]
        yield ObjectContact(
            f"{site}_contact",
            site,
            targets.carried_contact_points[:, link].T,
            targets.object_pos[frames, aimed].T,
            se3.quat_to_matrix(targets.object_quat[frames, aimed]).transpose(1, 2, 0),
            weights.object_contact * firm * targets.contact_weights[:, link],
        )
        if site in PALMS and site not in spec.dropped_rotations:
            rotation = se3.quat_to_matrix(targets.contact_quats[:, PALMS.index(site)]).transpose(1, 2, 0)
            weight = weights.hand_orientation * spec.palm_weight * targets.contact_rotation_weights[:, link]
            yield SiteRotation(f"{site}_orientation", site, rotation, weight)
