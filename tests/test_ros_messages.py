"""MCAP of ROS 2 messages, read back by the reader of its makers: joints by name, transforms, times."""

import io

import numpy as np
import pytest

from export_motions import as_result
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.motion.formats import ros_messages
from hoi_retarget.motion.formats.ros_messages import write_messages
from hoi_retarget.motion.resample import resample
from trajectories import MODELS

reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")

RESULT = as_result(MODELS["unitree_h2"], stem="lift", objects=2, seed=4)


@pytest.fixture(scope="module")
def messages() -> dict[str, list]:
    (content,) = write_messages([RESULT], 50.0).values()
    found: dict[str, list] = {}
    factories = [decoder.DecoderFactory()]
    for _, channel, message, value in reader.make_reader(
        io.BytesIO(content), decoder_factories=factories
    ).iter_decoded_messages():
        found.setdefault(channel.topic, []).append((message.log_time, value))
    return found


def test_each_topic_has_the_motion(messages):
    motion = resample(RESULT.motion, RESULT.model, 50.0)
    joints = list(motion.model.joint_names)
    ((_, whole),) = messages["/joint_trajectory"]
    columns = [whole.joint_names.index(name) for name in joints]
    np.testing.assert_allclose([np.array(point.positions)[columns] for point in whole.points], motion.qpos[:, 7:])
    np.testing.assert_allclose([np.array(point.velocities)[columns] for point in whole.points], motion.joint_vel)
    times = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in whole.points]
    np.testing.assert_allclose(times, np.arange(motion.frames) / 50.0, atol=1e-9)
    states, transforms = messages["/joint_states"], messages["/tf"]
    assert len(states) == len(transforms) == motion.frames
    np.testing.assert_allclose([log for log, _ in states], np.arange(motion.frames) * 2e7)
    np.testing.assert_allclose([np.array(state.position)[columns] for _, state in states], motion.qpos[:, 7:])
    for frame, (_, value) in enumerate(transforms):
        root, *objects = value.transforms
        assert root.header.frame_id == "world" and root.child_frame_id == motion.model.body_names[0]
        assert [item.child_frame_id for item in objects] == list(motion.motion.object_names)
        for item, pose in (
            (root, motion.qpos[frame, :7]),
            (objects[1], np.hstack([motion.object_pos[frame, 1], motion.object_quat[frame, 1]])),
        ):
            place, turn = item.transform.translation, item.transform.rotation
            np.testing.assert_allclose([place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z], pose, atol=1e-12)


def test_files_are_named_by_motion_and_robot():
    results = [RESULT, as_result(MODELS["unitree_g1"], stem="lift")]
    assert set(write_messages(results, None)) == {"lift.unitree_h2.mcap", "lift.unitree_g1.mcap"}


def test_without_the_package_the_command_that_installs_it_is_told(monkeypatch):
    monkeypatch.setattr(ros_messages, "install_hint", lambda module: f"pip install {module}")
    with pytest.raises(HoiRetargetError, match="pip install mcap_ros2"):
        write_messages([RESULT], None)
