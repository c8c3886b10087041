"""Sites near positions, heights and rotations: the paper's E^b, E^h, E^f, E^fz, E^fo, E^ho and E^r; IK rows; pins."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import rate_limited_upper_envelope
from hoi_retarget.retargeting.config import Weights
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import FrameRows, TangentRows
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import SIDES

# An anchored foot that turns weighs as much as one that moves by the angle times this [m]. With more, where a wide
# squat leaves no flat sole (H2), the hands pay for it.
SOLE_REACH = 0.05
PINNED_REACH = 0.1  # Of a pinned part that turns, likewise.
IDENTITY = np.eye(3)[:, :, None]
UPRIGHT, LYING = 0.5, 0.26
"""How much of the trunk's length is upwards; a trunk that is tilted by 60 degrees begins to lie, one by 75 lies."""
LYING_FACTOR = 100.0  # Times the weight of the torso's rotation in the base frame.


@dataclass(frozen=True, eq=False)
class _SiteTerm:
    name: str
    site: str
    target: Float[np.ndarray, "*place T"]
    weight: float | Float[np.ndarray, "T"]


class SitePosition(_SiteTerm):
    """`|p - p*|^2` [m^2] of one site; targets are 3 x T."""

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return the rows at a trajectory."""
        residual = kinematics.point(self.site) - self.target
        by_linear = np.broadcast_to(IDENTITY, (3, 3, residual.shape[1]))
        return (FrameRows(kinematics.frame(self.site), residual, by_linear, None, self.weight),)


class SiteHeight(_SiteTerm):
    """`gamma (z - z*)^2` [m^2] of one site; there is one target a frame."""

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return the row at a trajectory."""
        residual = kinematics.point(self.site)[2:3] - self.target
        by_linear = np.broadcast_to(IDENTITY[2:], (1, 3, residual.shape[1]))
        return (FrameRows(kinematics.frame(self.site), residual, by_linear, None, self.weight),)


class SiteRotation(_SiteTerm):
    """`|R - R*|_F^2` of one site, `8 sin^2(angle / 2)`, twice the squared angle when small; targets are 3 x 3 x T."""

    def rows(self, kinematics: Kinematics) -> tuple[FrameRows, ...]:
        """Return the rows at a trajectory: nine, one column of the matrix after the other."""
        rotation = kinematics.orientation(self.site)
        frames = rotation.shape[-1]
        residual = (rotation - self.target).transpose(1, 0, 2).reshape(9, frames)
        # A column c of the matrix moves with omega x c.
        columns = rotation.transpose(1, 2, 0)
        by_angular = -se3.skew(columns).transpose(0, 2, 3, 1).reshape(9, 3, frames)
        return (FrameRows(kinematics.frame(self.site), residual, None, by_angular, self.weight),)


def position_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[SitePosition]:
    """Yield base and head near those of inverse kinematics, and the feet near their targets."""
    yield SitePosition("base_position", "pelvis", reference.point("pelvis"), weights.base_position)
    yield SitePosition("head_position", "head", reference.point("head"), weights.head_position)
    for k, side in enumerate(SIDES):
        target = targets.foot_positions[:, k].T
        weight = weights.feet_position + weights.stance_anchor * targets.anchor_weights[:, k]
        yield SitePosition(f"{side}_foot_position", f"{side}_foot", target, weight)


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


def pin_terms(weights: Weights, targets: Targets, reference: Kinematics) -> Iterator[SitePosition | SiteRotation]:
    """Yield place and rotation of every site that is pinned."""
    for pin in targets.pins:
        if pin.weights.any():
            yield SitePosition(f"{pin.site}_pin", pin.site, pin.positions.T, weights.pin * pin.weights)
        if pin.turn_weights.any():
            rotation = se3.quat_to_matrix(pin.quats).transpose(1, 2, 0)
            # The residual's square is twice the squared angle.
            weight = 0.5 * PINNED_REACH**2 * weights.pin * pin.turn_weights
            yield SiteRotation(f"{pin.site}_pinned_rotation", pin.site, rotation, weight)


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
