"""Joint angles near a reference, the paper's E^theta, and joints that follow others by the robot's mechanism."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics.arrays import runs
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.fingers import finger_joints
from hoi_retarget.retargeting.targets import Targets, finger_links
from hoi_retarget.retargeting.trajopt.problem import StencilRows, TangentRows
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import PALMS, SIDES

STILL_FINGERS = 1e3
"""Weight of fingers that touch nothing by themselves [1/rad^2]: the hand is as rigid as its hold takes it to be."""
COUPLING = 3e4  # Weight of a joint that follows another [1/rad^2]; measured, it does within 1.4e-3 rad.


@dataclass(frozen=True, eq=False)
class Posture:
    """`|theta - theta*|^2` [rad^2]."""

    name: str
    target: Float[np.ndarray, "n T"]
    weight: float
    first: int = 0  # Joint of the first row; those of the others follow it.

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


@dataclass(frozen=True, eq=False)
class CoupledJoints:
    """`(theta - ratio * theta' - offset)^2` [rad^2] of a follower and its leader, as the last joints of fingers are."""

    name: str
    joint: int
    other: int
    ratio: float
    offset: float  # [rad]

    def rows(self, kinematics: Kinematics) -> tuple[TangentRows, ...]:
        """Return the row at a trajectory."""
        angles = kinematics.qpos[:, 7:]
        residual = angles[:, self.joint] - self.ratio * angles[:, self.other] - self.offset
        first, second = sorted([(6 + self.joint, 1.0), (6 + self.other, -self.ratio)])
        jacobian = np.tile(np.array([first[1], second[1]])[None, None, :, None], (1, 1, 1, len(residual)))
        return (TangentRows((first[0], second[0]), residual[None], jacobian, COUPLING),)


def coupling_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[CoupledJoints]:
    """Yield a term for each joint that follows another, with a weight of its own."""
    names = reference.model.joint_names
    for one in reference.model.spec.couplings:
        if one.other:
            joint, other = names.index(one.joint), names.index(one.other)
            yield CoupledJoints(f"{one.joint}_coupled", joint, other, one.ratio, one.offset)
