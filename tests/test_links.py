"""Joints that an added robot holds still are in its exports, as its maker's file has them."""

import json

import mujoco
import numpy as np
import pytest

from export_motions import as_result, waves
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.check import check
from hoi_retarget.motion.formats import read
from hoi_retarget.motion.links import source_joints
from hoi_retarget.motion.motion import Stage
from hoi_retarget.motion.resample import resample
from hoi_retarget.motion.write_export import export, format_named
from hoi_retarget.robots import load_robot, user_robots
from hoi_retarget.robots.adding.build import build_robot
from hoi_retarget.robots.adding.findings import Hints
from hoi_retarget.robots.spec import SIDES
from synthetic_humanoids import Choices, humanoid

FORMATS = ("mjlab", "holosoma", "holosoma-qpos", "hdmi", "gmr", "named-csv")
RATIO, OFFSET = 0.5, 0.1


def couplings(truth):
    """Return which joint follows which other one, on both sides alike."""
    fingers = [[name for name in truth.held if name.startswith(side)] for side in SIDES]
    return {
        follower: other
        for first, second, *_ in fingers
        for follower, other in ((first, truth.joints["neck"]), (second, first))
    }


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """Return a robot with fingers, some of which follow the neck or each other, and its file."""
    folder = tmp_path_factory.mktemp("maker")
    truth = humanoid(Choices(2, fingers=3))
    coupled = "".join(
        f'<joint joint1="{one}" joint2="{other}" polycoef="{OFFSET} {RATIO} 0 0 0"/>'
        for one, other in couplings(truth).items()
    )
    path = folder / "maker.xml"
    path.write_text(truth.mjcf.replace("</mujoco>", f"<equality>{coupled}</equality></mujoco>"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOI_RETARGET_ROBOTS", str(folder / "robots"))
        built = build_robot(path, "with_fingers", Hints())
        user_robots.save(built.spec, built.mjcf)
        yield load_robot("with_fingers"), path, truth


def standing(model):
    """Return a robot that stands and moves a little, which no check takes for something else."""
    rng = np.random.default_rng(0)
    moved = 0.03 * waves(rng, 40, 30.0, 6 + model.n)
    moved[:, 2:6] *= 0.1
    qpos = model.integrate(np.tile(model.home_qpos, (40, 1)), moved)
    return np.concatenate([qpos[:, :7], np.clip(qpos[:, 7:], model.lower, model.upper)], axis=1)


def exported(model, name, folder):
    """Export a motion, and return what was exported and the path of the file."""
    result = as_result(model, stages=(Stage("trajectory", standing(model)),))
    files = export(result, format_named(name), name="take", fps=30.0).files
    write_together({folder / file: content for file, content in files.items()})
    described = json.loads((folder / "take.meta.json").read_text())
    return result.motion, described, folder / described["files"][0]


@pytest.mark.parametrize("name", FORMATS)
def test_exported_file_read_back_is_the_motion_and_has_all_of_the_makers_joints(robot, tmp_path, name):
    model, path, truth = robot
    compiled = mujoco.MjModel.from_xml_path(str(path))
    makers = [
        compiled.joint(k).name for k in range(compiled.njnt) if compiled.jnt_type[k] == mujoco.mjtJoint.mjJNT_HINGE
    ]
    motion, described, file = exported(model, name, tmp_path)
    assert described["joint_names"] == makers
    assert {item["name"] for item in described["held_joints"]} == set(truth.held)
    assert read(file).joint_pos.shape[1] == len(makers)
    found = check(read(file), model)
    np.testing.assert_allclose(found.qpos, motion.qpos, atol=1e-6)


def test_held_joints_are_still_and_coupled_ones_follow(robot):
    model, _, truth = robot
    joints = source_joints(resample(as_result(model).motion, model))
    pos, vel = ({name: of[:, k] for k, name in enumerate(joints.names)} for of in (joints.pos, joints.vel))
    coupled = couplings(truth)
    for one, other in coupled.items():
        np.testing.assert_allclose(pos[one], OFFSET + RATIO * pos[other])
        np.testing.assert_allclose(vel[one], RATIO * vel[other])
        assert np.ptp(pos[one]) > 1e-3
    for name in set(truth.held) - set(coupled):
        assert np.ptp(pos[name]) == 0.0 and not vel[name].any()
