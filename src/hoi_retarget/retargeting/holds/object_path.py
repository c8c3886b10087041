"""An object's path gives way, by centimetres and smoothly, where arms cannot reach the holds on it.

It moves towards where the palms end, only while it is lifted: what stands or slides on the floor stays as recorded.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float

from hoi_retarget.motion.motion_report import ObjectShift
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.numerics.filters import seconds_to_frames
from hoi_retarget.retargeting.holds.arm_reach import reach
from hoi_retarget.retargeting.holds.hand_shape import HandPoses
from hoi_retarget.retargeting.holds.hold import Hold
from hoi_retarget.retargeting.surfaces.skin_points import MovingObject
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import extreme_points

LARGEST_SHIFT, LARGEST_TURN = 0.03, np.radians(5.0)  # [m, rad]
MISSED = 0.01  # [m]; holds that the arm reaches within this leave the path as it is.
STRIDE_SECONDS, SMOOTHING_SECONDS = 0.1, 0.25
CLEARANCE, LIFTED = 0.005, 0.05
"""Height over the floor that an object keeps, and from which on it gives way wholly [m]."""
SHIFT_COST, TURN_COST = 0.05, 1.0  # Of 1 m and of 1 rad, against 1 m by which an arm misses its hold.
SMALLEST, TOLD = 0.005, (0.001, 0.1)
"""A path that would move by less stays as recorded [m]; frames that move or turn by less are not told [m, deg]."""
FRAMES_AT_ONCE = 500


def given_way(targets: Targets, moving_object: MovingObject, holds: Sequence[Hold], start: Kinematics) -> Targets:
    """Return the targets with the path of their only object nearer to where arms can hold it.

    `targets`: of the robot; `moving_object`: the object; `holds`: on it; `start`: where the body is about.
    """
    twists = _limited(_wanted(targets, moving_object, holds, start))
    if np.linalg.norm(twists[:, :3], axis=1).max() >= SMALLEST:
        twists *= _free_share(targets, twists, moving_object)[:, None]
    if np.linalg.norm(twists[:, :3], axis=1).max() < SMALLEST:
        return targets
    positions = targets.object_pos[:, 0] + twists[:, :3]
    quats = se3.quat_multiply(se3.exp(twists[:, 3:]), targets.object_quat[:, 0])
    return replace(targets, object_pos=frozen(positions[:, None]), object_quat=frozen(quats[:, None]))


def _wanted(
    targets: Targets, moving_object: MovingObject, holds: Sequence[Hold], start: Kinematics
) -> Float[np.ndarray, "T 6"]:
    """Return the moves and turns of the object [m, rad] with which arms miss their holds by least, smoothed."""
    normal, aim = np.zeros((targets.frames, 6, 6)), np.zeros((targets.frames, 6))
    keys = np.unique(
        np.append(np.arange(0, targets.frames, seconds_to_frames(STRIDE_SECONDS, targets.fps)), targets.frames - 1)
    )
    for hold in holds:
        frames = keys[(keys >= hold.episode.first) & (keys < hold.episode.stop)]
        if hold.off.max() < MISSED or not frames.size:
            continue
        pose = HandPoses(hold.touch.position[None], hold.touch.rotation[None])
        missing = -reach(start, targets.contact_links[hold.episode.link], moving_object, frames, pose).missing[0]
        lever = np.einsum("ijf,j->fi", moving_object.rotation[:, :, frames], hold.touch.position)
        rows = np.concatenate([np.broadcast_to(np.eye(3), (len(frames), 3, 3)), -se3.skew(lever)], axis=2)
        normal[frames] += rows.transpose(0, 2, 1) @ rows
        aim[frames] += np.einsum("fij,fi->fj", rows, missing)
    costs = np.diag(np.repeat([SHIFT_COST, TURN_COST], 3))
    found = np.linalg.solve(normal[keys] + costs, aim[keys, :, None])[:, :, 0]
    every = np.stack([np.interp(np.arange(targets.frames), keys, along) for along in found.T], axis=1)
    sigma = seconds_to_frames(SMOOTHING_SECONDS, targets.fps)
    return scipy.ndimage.gaussian_filter1d(every, sigma, axis=0, mode="nearest")


def _limited(twists: Float[np.ndarray, "T 6"]) -> Float[np.ndarray, "T 6"]:
    sizes = np.linalg.norm(twists.reshape(-1, 2, 3), axis=2)
    shares = (np.minimum(1.0, [LARGEST_SHIFT, LARGEST_TURN] / np.maximum(sizes, 1e-12))).min(axis=1)
    return twists * shares[:, None]


def _free_share(
    targets: Targets, twists: Float[np.ndarray, "T 6"], moving_object: MovingObject
) -> Float[np.ndarray, "T"]:
    """Return the share of moves with which an object stays on the floor and above it; it changes smoothly."""
    corners = targets.object_scale[0] * extreme_points(targets.object_geometry[0].points)
    lowest, drop = np.zeros((2, targets.frames))
    for first in range(0, targets.frames, FRAMES_AT_ONCE):
        frames = slice(first, first + FRAMES_AT_ONCE)
        placed = np.einsum("ijt,kj->tki", moving_object.rotation[:, :, frames], corners)
        height, own = targets.object_pos[frames, 0, 2], twists[frames, None]
        lowest[frames] = height + placed[:, :, 2].min(axis=1)
        turned = placed + np.cross(own[:, :, 3:], placed) + own[:, :, :3]
        drop[frames] = lowest[frames] - height - turned[:, :, 2].min(axis=1)
    share = np.clip((lowest - CLEARANCE) / np.maximum(drop, LIFTED), 0.0, 1.0)
    around = seconds_to_frames(SMOOTHING_SECONDS, targets.fps)
    least = scipy.ndimage.minimum_filter1d(share, 4 * around + 1, mode="nearest")
    return scipy.ndimage.gaussian_filter1d(least, around, mode="nearest", truncate=2.0)


def shift_between(recorded: Targets, targets: Targets) -> ObjectShift | None:
    """Return how the path of the targets' only object gave way; None where it did not."""
    moved = np.linalg.norm(targets.object_pos - recorded.object_pos, axis=2).max(axis=1)
    turned = np.degrees(se3.angle_between(targets.object_quat, recorded.object_quat)).max(axis=1)
    frames = np.flatnonzero((moved > TOLD[0]) | (turned > TOLD[1]))
    if not frames.size:
        return None
    return ObjectShift(
        targets.object_names[0], int(frames[0]), int(frames[-1]), float(moved.max()), float(turned.max())
    )
