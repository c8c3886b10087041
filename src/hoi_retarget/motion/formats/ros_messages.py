"""Results as MCAP files of ROS 2 messages, a file a motion, which Foxglove, RViz and `ros2 bag` play.

`/joint_trajectory` is one message with all joints, `/joint_states` and `/tf` have one for each frame: transforms of the
robot's root link and of objects in `world`. Rotations are x, y, z, w, as ROS has them.

Cites: ros2/common_interfaces and ros2/geometry2 (fields of the messages), mcap.dev (the container).
"""

import io
from collections.abc import Iterator, Sequence
from typing import Any

from hoi_retarget.errors import HoiRetargetError, install_hint
from hoi_retarget.motion.links import source_joints
from hoi_retarget.motion.resample import ResampledMotion, resample
from hoi_retarget.motion.result import Result
from hoi_retarget.numerics import se3

NAME, WORLD = "mcap", "world"
NANOSECONDS = 1_000_000_000  # A second.
_TIME = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec"
_DURATION = "MSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec"
_HEADER = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id"
_POINT = (
    "MSG: trajectory_msgs/JointTrajectoryPoint\nfloat64[] positions\nfloat64[] velocities\nfloat64[] accelerations\n"
    "float64[] effort\nbuiltin_interfaces/Duration time_from_start"
)
_STAMPED = "MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\nTransform transform"
_TRANSFORM = "MSG: geometry_msgs/Transform\nVector3 translation\nQuaternion rotation"
_VECTOR = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"
_QUATERNION = "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w"
_JOINTS = "std_msgs/Header header\nstring[] "
_KINDS = {
    "trajectory_msgs/msg/JointTrajectory": (
        f"{_JOINTS}joint_names\nJointTrajectoryPoint[] points",
        *(_HEADER, _TIME, _POINT, _DURATION),
    ),
    "sensor_msgs/msg/JointState": (
        f"{_JOINTS}name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
        *(_HEADER, _TIME),
    ),
    "tf2_msgs/msg/TFMessage": (
        "geometry_msgs/TransformStamped[] transforms",
        *(_STAMPED, _HEADER, _TIME, _TRANSFORM, _VECTOR, _QUATERNION),
    ),
}
"""Type of a message -> its fields, and those of all types in it."""


def write_messages(results: Sequence[Result], fps: float | None) -> dict[str, bytes]:
    """Return a file for each motion by its name; raises `HoiRetargetError` where mcap-ros2-support is missing."""
    if hint := install_hint("mcap_ros2"):
        raise HoiRetargetError(f"MCAP is written with mcap-ros2-support, which is not installed. {hint}")
    return {
        f"{result.stem}.{result.motion.robot}.mcap": _file_of(resample(result.motion, result.model, fps))
        for result in results
    }


def _file_of(motion: ResampledMotion) -> bytes:
    from mcap_ros2.writer import Writer  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - optional

    buffer = io.BytesIO()
    writer = Writer(buffer)
    kinds = {kind: writer.register_msgdef(kind, f"\n{80 * '='}\n".join(parts)) for kind, parts in _KINDS.items()}
    for number, (topic, kind, nanoseconds, message) in enumerate(_messages(motion)):
        writer.write_message(topic, kinds[kind], message, nanoseconds, nanoseconds, number)
    writer.finish()
    return buffer.getvalue()


def _messages(motion: ResampledMotion) -> Iterator[tuple[str, str, int, dict[str, Any]]]:
    """Yield topic, type, time [ns] and content of every message."""
    joints = source_joints(motion)
    times = [round(frame * NANOSECONDS / motion.fps) for frame in range(motion.frames)]
    trajectory, state, transforms = _KINDS
    positions, velocities = joints.pos.tolist(), joints.vel.tolist()
    points = [
        {"positions": p, "velocities": v, "accelerations": [], "effort": [], "time_from_start": _time(at)}
        for p, v, at in zip(positions, velocities, times, strict=True)
    ]
    header = {"header": {"stamp": _time(0), "frame_id": WORLD}}
    yield "/joint_trajectory", trajectory, 0, {**header, "joint_names": list(joints.names), "points": points}
    bodies = [(motion.model.body_names[0], motion.qpos[:, :3], motion.qpos[:, 3:7])]
    for index, name in enumerate(motion.motion.object_names):
        bodies.append((name, motion.object_pos[:, index], motion.object_quat[:, index]))
    for frame, at in enumerate(times):
        header = {"header": {"stamp": _time(at), "frame_id": WORLD}}
        values = {"position": positions[frame], "velocity": velocities[frame], "effort": []}
        yield "/joint_states", state, at, {**header, "name": list(joints.names), **values}
        poses = [{**header, "child_frame_id": name, "transform": _pose(p[frame], q[frame])} for name, p, q in bodies]
        yield "/tf", transforms, at, {"transforms": poses}


def _time(nanoseconds: int) -> dict[str, int]:
    return dict(zip(("sec", "nanosec"), divmod(nanoseconds, NANOSECONDS), strict=True))


def _pose(position: Any, wxyz: Any) -> dict[str, dict[str, float]]:
    values = {"translation": ("xyz", position), "rotation": ("xyzw", se3.quat_to_xyzw(wxyz))}
    return {name: dict(zip(axes, array.tolist(), strict=True)) for name, (axes, array) in values.items()}
