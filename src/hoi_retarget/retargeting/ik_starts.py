"""Trajectories that inverse kinematics starts from: poses that follow the person, and other branches of limbs."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.motion.report import OrientationFlip
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import fade, frames_in
from hoi_retarget.retargeting.orientation_flips import limb_joints
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.robots.model import RobotModel

Start = Callable[[RobotModel, Targets], Float[np.ndarray, "T nq"]]

TWISTED_DEG = 60.0  # Off a target by more, a limb may have gone the wrong way around.
TWIST_MARGIN_SECONDS = 0.17  # On either side, for such a limb to come back.
SWUNG = 1.0  # [rad]; a joint that differs by more before and after a flip has changed its branch.


def standing(model: RobotModel, targets: Targets) -> Float[np.ndarray, "T nq"]:
    """Return the home pose in every frame, carried along by the pelvis target."""
    return _home(model, targets, targets.site_quats[:, _pelvis(model)])


def seated(model: RobotModel, targets: Targets) -> Float[np.ndarray, "T nq"]:
    """Return the home pose in every frame, its trunk as the person's lies: a bent back leaves the pelvis elsewhere."""
    return _home(model, targets, se3.matrix_to_quat(targets.trunk_rotations))


def _pelvis(model: RobotModel) -> int:
    return [row.site for row in model.spec.ik].index("pelvis")


def _home(model: RobotModel, targets: Targets, quats: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T nq"]:
    """Return the home pose, its pelvis where its target is and turned by `quats`; the root may be any other link.

    On a base it is where the base goes.
    """
    if targets.base_qpos is not None:
        return np.concatenate([targets.base_qpos, np.tile(model.home_qpos[7:], (targets.frames, 1))], axis=1)
    at_origin = np.concatenate([[0, 0, 0, 1, 0, 0, 0], model.home_qpos[7:]])
    pelvis = model.forward(at_origin[None])
    place, turn = pelvis.site_position("pelvis")[0], pelvis.site_rotation("pelvis")[0]
    qpos = np.tile(model.home_qpos, (targets.frames, 1))
    qpos[:, 3:7] = se3.quat_multiply(quats, se3.matrix_to_quat(turn.T))
    qpos[:, :3] = targets.site_positions[:, _pelvis(model)] - se3.rotate(qpos[:, 3:7], place)
    return qpos


def interpolated(qpos: np.ndarray, stride: int, frames: int) -> np.ndarray:
    """Return a trajectory at all frames from its every `stride`-th."""
    place = np.minimum(np.arange(frames) / stride, len(qpos) - 1)
    before = np.minimum(place.astype(int), max(len(qpos) - 2, 0))
    after = np.minimum(before + 1, len(qpos) - 1)
    fraction = place - before
    blended = qpos[before] + fraction[:, None] * (qpos[after] - qpos[before])
    blended[:, 3:7] = se3.slerp(qpos[before, 3:7], qpos[after, 3:7], fraction)
    return blended


def straightened(
    model: RobotModel, qpos: Float[np.ndarray, "T nq"], errors: Mapping[str, Float[np.ndarray, "T"]], fps: float
) -> Float[np.ndarray, "T nq"] | None:
    """Return a trajectory whose twisted limbs are interpolated from before and after; None where none is."""
    straight = qpos.copy()
    for site, degrees in errors.items():
        if degrees.max() >= TWISTED_DEG:
            near = fade(degrees >= TWISTED_DEG, frames_in(TWIST_MARGIN_SECONDS, fps)) > 0
            _bridge(straight, model, 7 + limb_joints(model, site), near)
    return None if np.array_equal(straight, qpos) else straight


def in_one_branch(
    model: RobotModel, qpos: Float[np.ndarray, "T nq"], flips: Sequence[OrientationFlip]
) -> Float[np.ndarray, "T nq"] | None:
    """Return a trajectory that does not change branches where limbs flip; None where none does.

    A flip is the way from one branch of a limb to another. The joints that swing in it are bridged over the flip and
    over what comes before or after it until the next one, whichever is shorter.
    """
    start = qpos.copy()
    for site in dict.fromkeys(flip.site for flip in flips):
        spans = [(flip.first_frame, flip.last_frame + 1) for flip in flips if flip.site == site]
        swung, left = np.zeros(qpos.shape[1], dtype=bool), np.zeros(len(qpos), dtype=bool)
        for index, (first, stop) in enumerate(spans):
            begin = spans[index - 1][1] if index else 0
            end = spans[index + 1][0] if index + 1 < len(spans) else len(qpos)
            swung |= np.abs(qpos[min(stop, len(qpos) - 1)] - qpos[max(first - 1, 0)]) > SWUNG
            left[slice(begin, stop) if first - begin < end - stop else slice(first, end)] = True
        limb = 7 + limb_joints(model, site)
        _bridge(start, model, limb[swung[limb]], left)
    return None if np.array_equal(start, qpos) else start


def _bridge(qpos: np.ndarray, model: RobotModel, joints: np.ndarray, left: Bool[np.ndarray, "T"]) -> None:
    """Interpolate joints over frames from those around, in place; all frames at once are taken home."""
    if left.all():
        qpos[:, joints] = model.home_qpos[joints]
        return
    frames, kept = np.arange(len(qpos)), np.flatnonzero(~left)
    for joint in joints:
        qpos[left, joint] = np.interp(frames[left], kept, qpos[kept, joint])
