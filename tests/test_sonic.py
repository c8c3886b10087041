"""Motion libraries of SONIC and GRAIL: rotations of bodies, fingers, objects and contacts, read back by joblib."""

import io
import pickle

import mujoco
import numpy as np
import pytest

from export_motions import as_result
from hoi_retarget.cli import main
from hoi_retarget.errors import ArgumentError
from hoi_retarget.motion import formats
from hoi_retarget.motion.formats.sonic import write_library
from hoi_retarget.motion.resample import resample
from hoi_retarget.motion.result_file import save
from hoi_retarget.numerics import se3
from hoi_retarget.robots import load_robot
from trajectories import MODELS

joblib = pytest.importorskip("joblib", reason="joblib is not installed")

G1, H2, DEX3 = MODELS["unitree_g1"], MODELS["unitree_h2"], load_robot("g1_dex3")


def entry(files, name):
    """A file's one motion, as SONIC's loader takes it."""
    (values,) = joblib.load(io.BytesIO(files[name])).values()
    return values


@pytest.mark.parametrize("model", [G1, H2])
def test_rotations_are_those_of_the_bodies_in_mujoco(model):
    result = as_result(model, stem="lift", objects=1, seed=1)
    robot = entry(write_library([result], None), "robot/lift.pkl")
    simulated = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    data = mujoco.MjData(simulated)
    bodies = [int(simulated.jnt_bodyid[joint]) for joint in range(1, simulated.njnt)]
    assert robot["pose_aa"].shape == (result.motion.frames, 1 + model.n, 3)
    for frame in range(0, result.motion.frames, 7):
        data.qpos[:] = result.motion.qpos[frame]
        mujoco.mj_kinematics(simulated, data)
        root = se3.exp(robot["pose_aa"][frame, 0].astype(float))
        assert se3.angle_between(root[None], data.xquat[1:2]).max() < 1e-5
        for body, turn in zip(bodies, robot["pose_aa"][frame, 1:].astype(float), strict=True):
            above = data.xquat[simulated.body_parentid[body]]
            turned = se3.quat_multiply(above, se3.quat_multiply(simulated.body_quat[body], se3.exp(turn)))
            assert se3.angle_between(turned[None], data.xquat[body][None]).max() < 1e-5


def test_fingers_stand_behind_the_bodys_joints():
    result = as_result(DEX3, stem="grasp", objects=1, seed=2)
    robot = entry(write_library([result], None), "robot/grasp.pkl")
    assert robot["dof"].shape[1] == 43 and robot["pose_aa"].shape[1] == 30
    names = list(DEX3.joint_names)
    fingers = [index for index, name in enumerate(names) if "hand" in name]
    body = [index for index in range(43) if index not in fingers]
    np.testing.assert_allclose(robot["dof"], result.motion.qpos[:, 7:][:, body + fingers], atol=1e-6)


def test_objects_hands_and_rate_are_the_motions():
    result = as_result(G1, stem="two", objects=2, seed=3)
    files = write_library([result], 50.0)
    motion, objects, robot = (
        resample(result.motion, G1, 50.0),
        entry(files, "objects/two.pkl"),
        entry(files, "robot/two.pkl"),
    )
    assert objects["fps"] == robot["fps"] == 50
    np.testing.assert_array_equal(objects["root_pos"], motion.object_pos)
    np.testing.assert_array_equal(objects["root_quat"], motion.object_quat)
    for palm in ("left_palm", "right_palm"):
        column = motion.motion.contact_links.index(palm)
        touching = motion.contact_flags[:, column] & (motion.contact_object[:, column] == 0)
        points = objects[f"contact_points_{palm.split('_')[0]}_hand"]
        assert sorted(points) == np.flatnonzero(touching).tolist()
        for frame, found in points.items():
            np.testing.assert_array_equal(found, motion.contact_points[frame, [column]])
        action = robot[f"hand_action_{palm.split('_')[0]}"]
        assert set(np.unique(action)) <= {-1.0, 1.0} and (action[motion.contact_flags[:, column]] == 1.0).all()


def test_a_library_is_read_again_and_not_written_over(tmp_path, capsys):
    result = as_result(G1, stem="one", objects=1)
    save(result.motion, tmp_path / "one.npz")
    command = ["export", str(tmp_path / "one.npz"), "--to", "sonic-motion-lib", "--out", str(tmp_path / "lib")]
    assert main(command) == 0
    stored = formats.read(tmp_path / "lib" / "robot" / "one.pkl")
    np.testing.assert_allclose(stored.joint_pos, result.motion.qpos[:, 7:], atol=1e-6)
    assert pickle.loads((tmp_path / "lib" / "objects" / "one.pkl").read_bytes())["one"]["names"]
    assert main(command) == 2
    assert "which would be lost" in " ".join(capsys.readouterr().err.split())


def test_a_library_is_of_one_robot():
    with pytest.raises(ArgumentError, match="of unitree_g1, unitree_h2"):
        write_library([as_result(G1, stem="a"), as_result(H2, stem="b")], None)
