"""Contact of a site with a point of the object: the paper's E^c (Eq. 1)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.retarget.trajopt.rows import FrameRows
from hoi_retarget.robots.model import Kinematics


@dataclass(frozen=True, eq=False)
class ObjectContact:
    """`beta |p^o - p^o*|^2` [m^2]: the site's position in the object's frame against the contact point."""

    name: str
    site: str
    target_object: Float[np.ndarray, "3 T"]
    """Contact point in the object's frame [m]; any finite number where the weight is zero."""
    object_position: Float[np.ndarray, "3 T"]
    object_rotation: Float[np.ndarray, "3 3 T"]
    weight: Float[np.ndarray, "T"]
    """Zero where there is no contact."""

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return the rows at a trajectory."""
        frame = kinematics.frame(self.site)
        offset = kinematics.point(frame) - self.object_position
        residual = np.einsum("jit,jt->it", self.object_rotation, offset) - self.target_object
        return (
            FrameRows(
                kinematics.frame(self.site), residual, self.object_rotation.transpose(1, 0, 2), None, self.weight
            ),
        )
