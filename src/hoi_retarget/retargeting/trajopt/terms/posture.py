"""Joint angles near a reference: the paper's E^theta."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics.arrays import runs
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.fingers import finger_joints
from hoi_retarget.retargeting.targets import Targets, finger_links
from hoi_retarget.retargeting.trajopt.problem import StencilRows
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import PALMS, SIDES

STILL_FINGERS = 1e3
"""Weight of fingers that touch nothing by themselves [1/rad^2]: the hand is as rigid as its hold takes it to be."""


@dataclass(frozen=True, eq=False)
class Posture:
    """`|theta - theta*|^2` [rad^2]."""

    name: str
    target: Float[np.ndarray, "n T"]
    weight: float
    first: int = 0
    """Joint of the first row; those of the others follow it."""

    def rows(self, kinematics: Kinematics) -> tuple[StencilRows, ...]:
        """Return the rows at a trajectory."""
        stop = self.first + len(self.target)
        residual = kinematics.qpos[:, 7 + self.first : 7 + stop].T - self.target
        return (StencilRows(slice(6 + self.first, 6 + stop), (1.0,), residual, self.weight),)


def posture_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[Posture]:
    """Yield the joint angles near those of inverse kinematics, and fingers of hands that hold by themselves at them."""
    angles, model = reference.qpos[:, 7:].T, reference.model
    yield Posture("joint_position", np.ascontiguousarray(angles), weights.joint_position)
    for side, palm in zip(SIDES, PALMS, strict=True):
        pads = [site for part, site in model.spec.fingers.items() if part.startswith(side)]
        holds = palm in targets.contact_links and targets.contact_weights[:, targets.contact_links.index(palm)].any()
        if pads and holds and not any(finger_links(targets, palm)):
            for first, stop in runs(finger_joints(model, palm, pads)):
                target = np.ascontiguousarray(angles[first:stop])
                yield Posture(f"{side}_fingers_{first}", target, STILL_FINGERS, first)
