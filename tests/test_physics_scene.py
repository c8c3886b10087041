"""Laws of the scene: kinematics as ours, masses of solids, gains as published, files that open anywhere."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.cli import main
from hoi_retarget.dynamics import object_bodies as collision_shape_module
from hoi_retarget.dynamics.actuators import actuators_of
from hoi_retarget.dynamics.object_bodies import collision_shape, object_body, oriented_box
from hoi_retarget.dynamics.physics_scene import compiled, scene_files, scene_of
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.errors import ArgumentError, RobotError
from hoi_retarget.motion import result_file
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots import load_robot
from plain_motions import plain_motion, standing_qpos, tracks_of
from synthetic import make
from tiny_robot import tiny_robot
from trajectories import random_qpos

SIZES = st.tuples(*[st.floats(0.05, 2.0)] * 3).map(np.array)
ROTATIONS = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(lambda vector: se3.exp(np.array(vector)))
BOX_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def box(size, quat=se3.IDENTITY_QUAT, place=(0.0, 0.0, 0.0), faces=BOX_FACES):
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
    return ObjectGeometry(se3.rotate(quat, corners) + place, faces=faces)


@pytest.fixture(scope="module", params=["unitree_g1", "unitree_h2"])
def staged(request):
    """A motion, its robot and its scene, with an object of convex parts."""
    model, generator = load_robot(request.param), np.random.default_rng(0)
    quats = se3.quat_normalize(generator.normal(size=(40, 1, 4)))
    motion = plain_motion(model, random_qpos(model, 40, generator), object_quat=quats)
    (track,) = make("move_chair").objects
    return motion, model, scene_of(motion, model, tracks_of(motion, (track.geometry,)))


@settings(deadline=None, max_examples=25)
@given(size=SIZES, quat=ROTATIONS, place=SIZES, mass=st.floats(0.1, 50.0))
def test_a_box_has_the_mass_centre_and_inertia_of_a_box(size, quat, place, mass):
    body = object_body("thing", box(size, quat, place), 1.0, Physics(object_mass=mass))
    turn = se3.quat_to_matrix(quat)
    expected = turn @ np.diag(mass / 12.0 * (size @ size - size**2)) @ turn.T
    assert body.mass == mass
    np.testing.assert_allclose(body.centre, place, atol=1e-9)
    np.testing.assert_allclose(body.inertia, expected, atol=1e-9 * np.trace(expected))


@pytest.mark.parametrize("name", ["largebox", "a thing without a kind"])
def test_what_is_made_twice_as_large_weighs_eight_times_as_much(name):
    geometry = box(np.array([0.3, 0.2, 0.1]))
    small, large = (object_body(name, geometry, scale, Physics()) for scale in (0.5, 1.0))
    assert large.mass == pytest.approx(8.0 * small.mass)
    assert np.trace(large.inertia) == pytest.approx(32.0 * np.trace(small.inertia))


def test_what_is_flat_has_a_mass():
    assert 0.0 < object_body("sheet", box(np.array([1.0, 1.0, 0.0])), 1.0, Physics()).mass < 1.0


@settings(deadline=None, max_examples=15)
@given(size=SIZES, quat=ROTATIONS)
def test_a_box_collides_as_the_same_box(size, quat):
    geometry = box(size, quat, (0.1, 0.2, 0.3))
    shape = collision_shape(geometry)
    assert shape.kind == "box"
    assert shape.box is not None
    local = (geometry.points - shape.box.centre) @ shape.box.rotation
    np.testing.assert_allclose(np.abs(local), np.tile(shape.box.half, (8, 1)), atol=1e-6)


def test_an_open_box_is_no_box():
    bin_without_lid = box(np.array([0.5, 0.4, 0.3]), faces=BOX_FACES[2:])
    assert collision_shape(bin_without_lid).kind != "box"


def test_convex_parts_are_made_once_and_kept(monkeypatch, tmp_path):
    made = []

    def halves(surface):
        made.append(surface)
        return tuple(surface.vertices[surface.vertices[:, 0] * sign >= 0.0] for sign in (-1.0, 1.0))

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("hoi_retarget.errors.find_spec", lambda name: name)
    monkeypatch.setattr(collision_shape_module, "_decomposed", halves)
    bin_without_lid = box(np.array([0.5, 0.4, 0.3]), faces=BOX_FACES[2:])
    first, second = collision_shape(bin_without_lid), collision_shape(bin_without_lid)
    assert len(made) == 1 and first.text == second.text == "2 convex parts"
    for one, other in zip(first.parts, second.parts, strict=True):
        np.testing.assert_array_equal(one, other)
    (kept,) = tmp_path.rglob("parts-*.npz")
    kept.write_bytes(b"damaged")
    assert collision_shape(bin_without_lid).kind == "convex parts" and len(made) == 2


def test_the_smallest_box_holds_all_points():
    points = np.random.default_rng(0).normal(size=(200, 3)) @ np.diag([1.0, 0.3, 0.1])
    found = oriented_box(points)
    assert (np.abs((points - found.centre) @ found.rotation) <= found.half + 1e-9).all()


def test_drives_of_the_g1_are_those_that_are_published():
    model = load_robot("unitree_g1")
    drives = actuators_of(model)
    rounded = {name: round(float(value), 1) for name, value in zip(model.joint_names, drives.stiffness, strict=True)}
    limits = dict(zip(model.joint_names, drives.torque.tolist(), strict=True))
    assert drives.published
    assert rounded["left_hip_pitch_joint"] == rounded["waist_yaw_joint"] == 40.2
    assert rounded["right_knee_joint"] == 99.1
    assert rounded["left_ankle_roll_joint"] == rounded["waist_pitch_joint"] == 28.5
    assert rounded["left_elbow_joint"] == 14.3 and rounded["right_wrist_yaw_joint"] == 16.8
    assert limits["left_ankle_pitch_joint"] == 50.0 and limits["left_wrist_pitch_joint"] == 5.0
    np.testing.assert_allclose(drives.damping**2, 16.0 * drives.armature * drives.stiffness)


def test_a_robot_without_torque_limits_is_refused(tmp_path):
    with pytest.raises(RobotError, match=r"no torque limit for left_leg_x.*actuatorfrcrange"):
        actuators_of(tiny_robot(tmp_path))


def test_the_scenes_kinematics_are_the_motions(staged):
    motion, model, scene = staged
    assert _kinematic_error(compiled(scene), scene.qpos(motion), model.forward(motion.qpos)) < 1e-9


def test_files_open_from_elsewhere_and_keyframes_are_frames_of_the_motion(staged, tmp_path, monkeypatch):
    motion, model, scene = staged
    for place, content in scene_files(scene, motion).items():
        (tmp_path / "a" / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "a" / place).write_bytes(content)
    monkeypatch.chdir("/")
    opened = mujoco.MjModel.from_xml_path(str(tmp_path / "a" / "scene.xml"))
    frames = [int(opened.key(key).name.removeprefix("frame_")) for key in range(opened.nkey)]
    assert frames[0] == 0 and frames[-1] == motion.frames - 1 and len(frames) > 5
    kinematics = model.forward(motion.qpos[frames])
    assert _kinematic_error(opened, opened.key_qpos, kinematics) < 1e-9
    np.testing.assert_allclose(opened.key_ctrl, motion.qpos[frames, 7:], atol=1e-12)
    ours = compiled(scene)
    for name in ("body_mass", "body_inertia", "geom_size", "geom_friction", "actuator_gainprm", "dof_armature"):
        np.testing.assert_allclose(getattr(opened, name), getattr(ours, name), rtol=1e-5, atol=1e-6)


def test_the_binary_file_simulates_as_the_scene_to_the_bit(staged, tmp_path):
    motion, _, scene = staged
    (tmp_path / "scene.mjb").write_bytes(scene_files(scene, motion)[Path("scene.mjb")])
    paths = []
    for simulated in (compiled(scene), mujoco.MjModel.from_binary_path(str(tmp_path / "scene.mjb"))):
        data = mujoco.MjData(simulated)
        data.qpos[:] = scene.qpos(motion)[0]
        data.ctrl[:] = motion.qpos[0, 7:]
        mujoco.mj_step(simulated, data, 50)
        paths.append(data.qpos.tobytes())
    assert paths[0] == paths[1]


def test_a_robot_that_is_set_on_the_floor_is_carried_by_its_soles(staged):
    _, model, scene = staged
    simulated = compiled(scene)
    data = mujoco.MjData(simulated)
    data.qpos[: model.home_qpos.size] = model.home_qpos
    data.qpos[model.home_qpos.size + 2] = 5.0  # The object is far up.
    soles = model.forward(model.home_qpos[None])
    data.qpos[2] -= min(soles.site_position(name)[0, 2] for name in model.site_names if "_sole_" in name)
    data.ctrl[:] = model.home_qpos[7:]
    for _ in range(20):
        mujoco.mj_step(simulated, data)
    touching = {simulated.geom(int(geom)).name for geom in data.contact.geom.ravel()}
    assert touching == {"floor", *(name for name in model.site_names if "_sole_" in name)}


def test_each_contact_has_the_friction_of_its_kind(staged):
    motion, model, scene = staged
    physics = Physics(hand_friction=0.7, floor_friction=0.9, object_friction=0.3)
    scene = replace(scene, physics=physics)
    simulated = compiled(scene)
    data = mujoco.MjData(simulated)
    data.qpos[:] = scene.qpos(motion)[0]
    data.qpos[: 7 + model.n] = standing_qpos(model, 1)[0]
    data.qpos[2] -= 0.003
    for depth, place in ((0.0, data.site("left_palm").xpos), (0.002, np.array([5.0, 0.0, 0.0]))):
        mujoco.mj_forward(simulated, data)
        lowest = (se3.rotate(data.qpos[-4:], scene.objects[0].corners))[:, 2].min()
        data.qpos[-7:-4] = place - [0.0, 0.0, depth and lowest + depth]
        mujoco.mj_forward(simulated, data)
        kinds = {}
        for contact in data.contact:
            names = [simulated.body(simulated.geom_bodyid[geom]).name for geom in contact.geom]
            hand = any("wrist" in name for name in names)
            kinds["hand" if hand else "object" if scene.objects[0].body_name in names else "sole"] = contact
        assert kinds["sole"].friction[0] == 0.9
        if depth:
            assert kinds["object"].friction[0] == 0.3 and kinds["object"].dim == 3
        else:
            assert kinds["hand"].friction[0] == 0.7 and kinds["hand"].dim == 4


def test_robots_and_objects_do_not_share_names(staged):
    motion, model, _ = staged
    renamed = replace(motion, object_names=("torso_link", *motion.object_names[1:]))
    shape = box(np.array([0.3, 0.3, 0.3]))
    scene = scene_of(renamed, model, tracks_of(renamed, (shape,)))
    assert len({item.body_name for item in scene.objects} | set(model.body_frames.names)) == len(scene.objects) + len(
        model.body_frames.names
    )
    assert compiled(scene).nbody > len(model.body_frames.names)


@pytest.mark.parametrize("wrong", [{"object_mass": 0.0}, {"floor_friction": float("nan")}, {"timestep": -0.01}])
def test_settings_that_no_world_has_are_refused(wrong):
    with pytest.raises(ArgumentError, match="must be a positive number"):
        Physics(**wrong)


def test_the_command_writes_a_scene_and_says_what_is_in_it(tmp_path, capsys):
    model = load_robot("unitree_g1")
    motion = plain_motion(model, standing_qpos(model, make("carry_box").frames))
    result_file.save(motion, tmp_path / "carry.npz")
    words = ["scene", str(tmp_path / "carry.npz"), "--out", str(tmp_path / "out"), "--clip", "builtin:carry_box"]
    assert main([*words, "--object-mass", "2.5"]) == 0
    said = capsys.readouterr().out
    assert "2.50 kg (as asked for), collides as a box" in said and "published gains" in said
    opened = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "scene.xml"))
    assert opened.body("box").mass == pytest.approx(2.5)
    assert main([*words, "--object-mass", "0"]) == 2
    assert "object-mass is 0.0" in capsys.readouterr().err


def _kinematic_error(simulated, qpos, kinematics):
    data, worst = mujoco.MjData(simulated), 0.0
    for frame in range(0, len(qpos), max(1, len(qpos) // 10)):
        data.qpos[:] = qpos[frame]
        mujoco.mj_kinematics(simulated, data)
        for site in kinematics.model.site_names:
            away = data.site(site).xpos - kinematics.site_position(site)[frame]
            turned = data.site(site).xmat.reshape(3, 3) - kinematics.site_rotation(site)[frame]
            worst = max(worst, float(np.abs(away).max()), float(np.abs(turned).max()))
    return worst
