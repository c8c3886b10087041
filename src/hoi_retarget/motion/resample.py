"""A motion at any rate, with velocities that integrate to it.

Positions and joints follow cubic splines through the motion's frames. A rotation follows the cubic
spline of its quaternion, scaled back to unit length: it meets every frame, its angular velocity is
continuous, and turning or mirroring the world turns or mirrors it. Velocities are the derivatives
of these same paths. At the motion's own rate, positions and rotations are its own numbers.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Bool, Float, Int

from hoi_retarget.clip.clip import HIGHEST_RATE
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import RobotModel

_FRAME_TOLERANCE = 1e-6  # Of a frame: nearer times are that frame.


@dataclass(frozen=True, eq=False)
class ResampledMotion:
    """A robot and its objects at the rate of an export; T frames, O objects, C contact links, n joints.

    Velocities are derivatives of the paths that positions and rotations are taken from, all in the
    world's axes.
    """

    motion: Motion
    model: RobotModel
    fps: float
    qpos: Float[np.ndarray, "T nq"]  # Root position [m], root rotation wxyz, joints [rad].
    root_lin_vel: Float[np.ndarray, "T 3"]  # Of the root's origin [m/s].
    root_ang_vel: Float[np.ndarray, "T 3"]  # [rad/s]
    joint_vel: Float[np.ndarray, "T n"]  # [rad/s]
    object_pos: Float[np.ndarray, "T O 3"]
    object_quat: Float[np.ndarray, "T O 4"]
    object_lin_vel: Float[np.ndarray, "T O 3"]  # Of the objects' origins [m/s].
    object_ang_vel: Float[np.ndarray, "T O 3"]
    contact_flags: Bool[np.ndarray, "T C"]
    contact_object: Int[np.ndarray, "T C"]  # Index of the touched object, -1 for none.
    contact_points: Float[np.ndarray, "T C 3"]  # In the frame of the scaled object [m]; NaN where nothing is touched.
    stance_flags: Bool[np.ndarray, "T 2"]
    object: int | None = None
    """Index of the object that goes into a format's one place for it; None where there is no object."""

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.qpos)

    @property
    def rate(self) -> int | float:
        """Frames a second [Hz], as the whole number that they are in most files."""
        return int(self.fps) if float(self.fps).is_integer() else float(self.fps)

    @property
    def object_name(self) -> str:
        """Name of the object in the format's one place for it, which must be filled."""
        assert self.object is not None
        return self.motion.object_names[self.object]


def resample(motion: Motion, model: RobotModel, fps: float | None = None, object: int | None = None) -> ResampledMotion:
    """Return a motion at `fps` frames a second, by default its own, for a format with a place for this object.

    It begins with the motion's first frame and ends with its last one, or less than one new frame
    before it. Where a spline between two frames leaves a joint's range, the joint stays at the
    limit with zero velocity.

    Raises `ArgumentError`: the rate is not positive, or above 1000; `ClipError`: the motion has a single frame, so
    nothing moves between frames.
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
    return ResampledMotion(
        motion,
        model,
        fps,
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
        object=object,
    )


def _places(frames: int, source_fps: float, fps: float) -> Float[np.ndarray, "K"]:
    """Return where the new frames lie, counted in frames of the source."""
    if fps == source_fps:
        return np.arange(frames, dtype=float)
    count = math.floor((frames - 1) * fps / source_fps + _FRAME_TOLERANCE) + 1
    place = np.minimum(np.arange(count) * (source_fps / fps), frames - 1.0)
    whole = np.round(place)
    return np.where(np.abs(place - whole) < _FRAME_TOLERANCE, whole, place)


def _curve(values: np.ndarray, place: np.ndarray, source_fps: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a cubic spline through `values`, frames first, and its derivative by time."""
    spline = scipy.interpolate.CubicSpline(np.arange(len(values)), values)
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
    """Return joints and velocities, at rest at their limits where the spline goes beyond.

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
    both = motion.contact_flags[before] & motion.contact_flags[after]
    one_contact = both & (motion.contact_object[before] == motion.contact_object[after])
    return np.where(one_contact[:, :, None], between, targets[nearest])
