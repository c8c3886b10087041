"""Rotation of a site in the frame of the robot's pelvis: the paper's E^r for the torso."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import rate_limited_upper_envelope
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import TangentRows
from hoi_retarget.retargeting.trajopt.terms.site_pose import SiteRotation
from hoi_retarget.robots.model import Kinematics

UPRIGHT, LYING = 0.5, 0.26
"""How much of the trunk's length is upwards; a trunk that is tilted by 60 degrees begins to lie, one by 75 lies."""
LYING_FACTOR = 100.0
"""Times the weight of the torso's rotation in the base frame."""


@dataclass(frozen=True, eq=False)
class RelativeRotation:
    """`|R^b - R^b*|_F^2` of one site, where `R^b` is its rotation in the frame of the site `base`.

    Either of the two may be on the robot's root link, or none.
    """

    name: str
    site: str
    base: str
    target_base: Float[np.ndarray, "3 3 T"]
    weight: float

    def rows(self, kinematics: Kinematics) -> tuple[TangentRows, ...]:
        """Return the rows at a trajectory, by the hinges between base and site; none where there is no hinge."""
        supports = kinematics.model.supports[1:]
        moves = supports[:, kinematics.frame(self.site).node] - supports[:, kinematics.frame(self.base).node]
        hinges = np.flatnonzero(moves)
        if not hinges.size:
            return ()
        base = kinematics.orientation(self.base)
        relative = np.einsum("jit,jkt->ikt", base, kinematics.orientation(self.site))
        frames = relative.shape[-1]
        axes = np.einsum("jit,jkt->ikt", base, kinematics.motion_axes[3:, 6 + hinges] * moves[hinges, None])
        # Column c of the matrix moves with axis x c.
        crosses = -se3.skew(relative.transpose(1, 2, 0)).transpose(0, 2, 3, 1)
        moved = np.einsum("cjit,ikt->cjkt", crosses, axes)
        residual = (relative - self.target_base).transpose(1, 0, 2).reshape(9, frames)
        jacobian = moved.reshape(1, 9, len(hinges), frames)
        return (TangentRows(tuple(int(hinge) + 6 for hinge in hinges), residual, jacobian, self.weight),)


def torso_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[RelativeRotation]:
    """Yield the torso's rotation in the pelvis' frame near that of inverse kinematics."""
    torso = np.einsum("jit,jkt->ikt", reference.orientation("pelvis"), reference.orientation("torso"))
    yield RelativeRotation("torso_orientation", "torso", "pelvis", torso, weights.torso_orientation)


def trunk_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[SiteRotation]:
    """Yield rotations in the world in surface contact: the torso's near the person's, the pelvis' near that of IK.

    Of those who lie, the torso's is near that of IK, too: head, base and feet of a lying robot are in a line, about
    which nothing else holds it where the floor pushes.
    """
    if targets.contact != "surface":
        return
    torso = se3.quat_to_matrix(targets.torso_quats).transpose(1, 2, 0)
    yield SiteRotation("trunk_orientation", "torso", torso, weights.trunk_orientation)
    # With the chest alone held, a waist with three joints twists: hips tilt by 50 degrees under a straight chest.
    yield SiteRotation("hips_orientation", "pelvis", reference.orientation("pelvis"), weights.trunk_orientation)
    tilt = np.clip((UPRIGHT - targets.trunk_rotations[:, 2, 2]) / (UPRIGHT - LYING), 0.0, 1.0)
    lies = np.where(targets.stance_flags.any(axis=1), 0.0, tilt)
    if lies.any():
        weight = LYING_FACTOR * weights.torso_orientation * rate_limited_upper_envelope(lies, targets.fps)
        yield SiteRotation("lying_orientation", "torso", reference.orientation("torso"), weight)
