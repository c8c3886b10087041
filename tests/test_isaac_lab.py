"""Isaac Lab's data sets of demonstrations: every number by its name, in Isaac Lab's order of joints."""

import io
import json

import numpy as np
import pytest

from export_motions import as_result
from hoi_retarget.cli import main
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.motion.formats import isaac_lab
from hoi_retarget.motion.formats.isaac_lab import DATA_FILE, write_demonstrations
from hoi_retarget.motion.resample import resample
from hoi_retarget.motion.result_file import save
from trajectories import MODELS

h5py = pytest.importorskip("h5py", reason="h5py is not installed")

G1, H2 = MODELS["unitree_g1"], MODELS["unitree_h2"]
RESULTS = [as_result(G1, stem="lift_a_box", objects=1, seed=1), as_result(H2, stem="b", objects=2, frames=25)]


def test_every_number_is_where_its_name_says():
    with h5py.File(io.BytesIO(write_demonstrations(RESULTS, None)[DATA_FILE])) as file:
        motions = [resample(result.motion, result.model, 50.0) for result in RESULTS]
        data = file["data"]
        assert data.attrs["total"] == sum(motion.frames for motion in motions)
        assert json.loads(data.attrs["env_args"])["type"] == 2 and set(data) == {"demo_0", "demo_1"}
        for number, (result, motion) in enumerate(zip(RESULTS, motions, strict=True)):
            demo = data[f"demo_{number}"]
            assert demo.attrs["num_samples"] == motion.frames and demo.attrs["clip"] == result.stem
            assert "success" not in demo.attrs, "nobody performed it"
            states, joints = demo["states"], list(motion.model.joint_names)
            columns = [joints.index(name) for name in demo.attrs["joint_names"]]
            assert sorted(columns) == list(range(len(joints))) and columns != sorted(columns)
            expected = {
                "articulation/robot/root_pose": motion.qpos[:, :7],
                "articulation/robot/root_velocity": np.hstack([motion.root_lin_vel, motion.root_ang_vel]),
                "articulation/robot/joint_position": motion.qpos[:, 7:][:, columns],
                "articulation/robot/joint_velocity": motion.joint_vel[:, columns],
            }
            for index, name in enumerate(motion.motion.object_names):
                expected[f"rigid_object/{name}/root_pose"] = np.hstack(
                    [motion.object_pos[:, index], motion.object_quat[:, index]]
                )
            for name, values in expected.items():
                np.testing.assert_allclose(states[name], values, rtol=1e-6, atol=1e-6, err_msg=name)
                np.testing.assert_array_equal(demo["initial_state"][name], states[name][:1], err_msg=name)
            np.testing.assert_allclose(demo["actions"][:-1], motion.qpos[1:, 7:][:, columns], atol=1e-6)
            np.testing.assert_array_equal(demo["obs/contacts"], motion.contact_flags)


def test_joints_are_in_the_order_of_beyondmimic():
    motion = resample(RESULTS[0].motion, G1, 50.0)
    written = isaac_lab.BEYONDMIMIC.write(motion)
    with h5py.File(io.BytesIO(write_demonstrations(RESULTS[:1], None)[DATA_FILE])) as file:
        assert tuple(file["data/demo_0"].attrs["joint_names"]) == written.joint_names


def test_it_is_written_by_the_command_and_nothing_is_lost(tmp_path, capsys):
    save(RESULTS[0].motion, tmp_path / "one.npz")
    command = ["export", str(tmp_path / "one.npz"), "--to", "isaaclab", "--out", str(tmp_path / "out")]
    assert main(command) == 0 and (tmp_path / "out" / DATA_FILE).stat().st_size > 1000
    assert main(command) != 0 and f"there is a {DATA_FILE} in it" in capsys.readouterr().err


def test_without_h5py_the_command_that_installs_it_is_told(monkeypatch):
    monkeypatch.setattr(isaac_lab, "install_hint", lambda module: f"pip install {module}")
    with pytest.raises(HoiRetargetError, match="pip install h5py"):
        write_demonstrations(RESULTS, None)
