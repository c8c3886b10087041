"""From a motion to a trajectory at any rate, with velocities that integrate to it.

Positions and joints follow cubic splines through the motion's frames. A rotation follows the cubic
spline of its quaternion, scaled back to unit length: it meets every frame, its angular velocity is
continuous, and turning or mirroring the world turns or mirrors it. Velocities are the derivatives
of these same paths. At the motion's own rate, positions and rotations are its own numbers.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import CubicSpline

from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.trajectory import Trajectory
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import RobotModel

HIGHEST_RATE = 1000.0  # [frames/s]; what asks for more is a slip of the keyboard.
_ROUNDING = 1e-6  # Of a frame: what is that near to a frame is that frame.


def resample(motion: Motion, model: RobotModel, fps: float | None = None) -> Trajectory:
    """Return a motion at `fps` frames a second, by default its own.

    It begins with the motion's first frame and ends with its last one, or less than one new frame
    before it. Where a spline between two frames leaves a joint's range, the joint stays at the
    limit with zero velocity.

    Raises:
        ArgumentError: the rate is not positive, or above 1000.
        ClipError: the motion has a single frame, so nothing moves between frames.
    """
    fps = motion.fps if fps is None else fps
    if not (np.isfinite(fps) and 0 < fps <= HIGHEST_RATE):
        raise ArgumentError(f"--fps {fps}: the rate must be positive and at most {HIGHEST_RATE:g} frames a second.")
    if motion.frames < 2:
        raise ClipError("the motion has one frame; at least 2 are needed to have velocities.")
    place = _places(motion.frames, motion.fps, fps)
    at_frames = fps == motion.fps
    root_pos, root_lin_vel = _curve(motion.qpos[:, :3], place, motion.fps)
    root_quat, root_ang_vel = _turning(motion.qpos[:, 3:7], place, motion.fps)
    joints, joint_vel = _in_range(*_curve(motion.qpos[:, 7:], place, motion.fps), motion, model)
    object_pos, object_lin_vel = _curve(motion.object_pos, place, motion.fps)
    object_quat, object_ang_vel = _turning(motion.object_quat, place, motion.fps)
    nearest = np.floor(place + 0.5).astype(int)
    return Trajectory(
        fps=fps,
        qpos=motion.qpos if at_frames else np.concatenate([root_pos, root_quat, joints], axis=1),
        root_lin_vel=root_lin_vel,
        root_ang_vel=root_ang_vel,
        joint_vel=joint_vel,
        object_pos=motion.object_pos if at_frames else object_pos,
        object_quat=motion.object_quat if at_frames else object_quat,
        object_lin_vel=object_lin_vel,
        object_ang_vel=object_ang_vel,
        contact_flags=motion.contact_flags[nearest],
        contact_object=motion.contact_object[nearest],
        contact_points=_contact_points(motion, place, nearest),
        stance_flags=motion.stance_flags[nearest],
    )


def _places(frames: int, source_fps: float, fps: float) -> Float[np.ndarray, "K"]:
    """Return where the new frames lie, counted in frames of the source."""
    if fps == source_fps:
        return np.arange(frames, dtype=float)
    count = math.floor((frames - 1) * fps / source_fps + _ROUNDING) + 1
    place = np.minimum(np.arange(count) * (source_fps / fps), frames - 1.0)
    whole = np.round(place)
    return np.where(np.abs(place - whole) < _ROUNDING, whole, place)


def _curve(values: np.ndarray, place: np.ndarray, source_fps: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a cubic spline through `values`, frames first, and its derivative by time."""
    spline = CubicSpline(np.arange(len(values)), values)
    return spline(place), spline(place, 1) * source_fps


def _turning(quats: np.ndarray, place: np.ndarray, source_fps: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations between frames and their angular velocity in the world's axes [rad/s]."""
    raw, rate = _curve(se3.quat_continuous(quats), place, source_fps)
    # Of a quaternion s of any length, 2 (ds/dt) / s is the angular velocity, beside a real part that
    # only lengthens it.
    squared = np.sum(raw * raw, axis=-1, keepdims=True)
    angular = 2.0 * se3.quat_multiply(rate, se3.quat_conjugate(raw))[..., 1:] / squared
    return raw / np.sqrt(squared), angular


def _in_range(
    joints: np.ndarray, velocity: np.ndarray, motion: Motion, model: RobotModel
) -> tuple[np.ndarray, np.ndarray]:
    """Return joints held at their limits where the spline goes beyond, and what their velocity is then.

    What the motion itself has beyond its limits stays: export repairs nothing.
    """
    lower = np.minimum(model.lower, motion.qpos[:, 7:].min(axis=0))
    upper = np.maximum(model.upper, motion.qpos[:, 7:].max(axis=0))
    held = np.clip(joints, lower, upper)
    return held, np.where(held == joints, velocity, 0.0)


def _contact_points(
    motion: Motion, place: Float[np.ndarray, "K"], nearest: Int[np.ndarray, "K"]
) -> Float[np.ndarray, "K C 3"]:
    """Return contact points: between two frames of one contact in between, else the nearest frame's."""
    before = np.floor(place).astype(int)
    after = np.minimum(before + 1, motion.frames - 1)
    fraction = (place - before)[:, None, None]
    targets = motion.contact_points
    between = (1.0 - fraction) * targets[before] + fraction * targets[after]
    return np.where(_one_contact(motion, before, after)[:, :, None], between, targets[nearest])


def _one_contact(motion: Motion, before: Int[np.ndarray, "K"], after: Int[np.ndarray, "K"]) -> Bool[np.ndarray, "K C"]:
    both = motion.contact_flags[before] & motion.contact_flags[after]
    return both & (motion.contact_object[before] == motion.contact_object[after])
