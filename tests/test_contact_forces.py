"""Laws of forces: weight, balance, momentum, mirror images, masses; and of what is said about them."""

import json
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from hoi_retarget.cli import main
from hoi_retarget.dynamics.contact_forces import forces_of, least_forces
from hoi_retarget.dynamics.feasibility import infeasibilities
from hoi_retarget.dynamics.inverse_dynamics import GRAVITY, movement_of
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.evaluation.physics_figures import forces_figures
from hoi_retarget.motion import result_file
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots import load_robot
from plain_motions import FPS, plain_motion, standing_qpos
from synthetic import make
from trajectories import MODELS, random_qpos

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]])
FACES = np.concatenate([FACES, [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]])


def nothing(frames):
    """Fields of a motion without objects."""
    empty = {"object_pos": np.zeros((frames, 0, 3)), "object_quat": np.zeros((frames, 0, 4))}
    return {"object_names": (), "object_scale": np.zeros(0), **empty}


def alone(model, qpos):
    """A robot without objects."""
    return forces_of(plain_motion(model, qpos, **nothing(len(qpos))), model, ())


def leaning_qpos(model, angle, frames=5):
    """Stand on unmoved legs, with everything above the hips turned ahead by an angle [rad]."""
    upright = standing_qpos(model, frames)
    qpos = upright.copy()
    qpos[:, 3:7] = se3.exp(np.array([0.0, angle, 0.0]))
    for side in ("left", "right"):
        qpos[:, 7 + model.joint_names.index(f"{side}_hip_pitch_joint")] -= angle
    foot = "left_sole_toe_inner"
    qpos[:, :3] += model.forward(upright).site_position(foot) - model.forward(qpos).site_position(foot)
    return qpos


def holding(model, *, hands=(True, True), frames=5):
    """A robot that holds a box between its palms, and the box's shape."""
    qpos = standing_qpos(model, frames)
    kinematics = model.forward(qpos)
    left, right = (kinematics.site_position(f"{side}_palm")[0] for side in ("left", "right"))
    size = np.array([0.3, left[1] - right[1], 0.3])
    flags = np.tile(hands, (frames, 1))
    motion = plain_motion(
        model,
        qpos,
        object_pos=np.tile(0.5 * (left + right), (frames, 1, 1)),
        contact_flags=flags,
        contact_object=np.where(flags, 0, -1),
        contact_points=np.where(flags[:, :, None], np.zeros(3), np.nan),
    )
    return motion, (ObjectGeometry(CORNERS * size, faces=FACES),)


@pytest.mark.parametrize("name", ["unitree_g1", "unitree_h2"])
def test_a_robot_that_stands_still_needs_its_weight_from_the_floor_and_nothing_else(name):
    model = load_robot(name)
    forces = alone(model, standing_qpos(model))
    assert forces.mass == pytest.approx(model.inertias.masses.sum())
    np.testing.assert_allclose(forces.on_robot.sum(axis=1), [[0.0, 0.0, forces.mass * GRAVITY]] * 30, atol=1e-6)
    assert forces.missing_share.max() < 1e-9
    assert forces_figures(forces, plain_motion(model, standing_qpos(model), **nothing(30))) == {
        "missing_wrench_p95_share": pytest.approx(0.0, abs=1e-9),
        "object_missing_wrench_p95_share": None,
        "torque_p95_share": pytest.approx(forces.torque_shares.max(), rel=1e-6),
        "torque_over_limit_share": 0.0,
        "one_hand_unheld_s": None,
    }


@settings(deadline=None, max_examples=40)
@given(angle=st.floats(-0.9, 1.5))
def test_a_robot_lacks_nothing_as_long_as_its_centre_of_mass_is_above_its_soles(angle):
    model = MODELS["unitree_g1"]
    qpos = leaning_qpos(model, angle)
    kinematics = model.forward(qpos)
    corners = np.array([kinematics.site_position(name)[0, :2] for name in model.site_names if "_sole_" in name])
    data = mujoco.MjData(compiled := mujoco.MjModel.from_xml_path(str(model.spec.mjcf)))
    data.qpos[:] = qpos[0]
    mujoco.mj_kinematics(compiled, data)
    mujoco.mj_comPos(compiled, data)
    outside = (ConvexHull(corners).equations @ [*data.subtree_com[1][:2], 1.0]).max()
    assume(abs(outside) > 1e-3)
    share = alone(model, qpos).missing_share.max()
    assert share < 1e-9 if outside < 0.0 else share > 1e-4


def test_in_free_fall_nothing_is_needed():
    model = MODELS["unitree_g1"]
    qpos = standing_qpos(model)
    qpos[:, 2] += 20.0 - 0.5 * GRAVITY * (np.arange(30) / FPS) ** 2
    forces = alone(model, qpos)
    assert forces.missing_share.max() < 1e-9 and np.abs(forces.torques).max() < 1e-6


@pytest.mark.parametrize("name", ["unitree_g1", "unitree_h2"])
def test_forces_gravity_and_what_is_missing_are_mass_times_acceleration(name):
    model = load_robot(name)
    motion, geometries = holding(model, frames=30)
    qpos = motion.qpos + 0.0
    qpos[:, 7:] += 0.2 * np.sin(np.arange(30)[:, None] / 5.0 + np.arange(model.n))
    motion = motion.with_qpos(qpos)
    forces = forces_of(motion, model, geometries, Physics())
    movement = movement_of(motion.qpos, FPS, Physics().smoothing)
    acceleration = np.array([centre_acceleration(model, movement, frame) for frame in range(30)])
    on_robot = [point.link is not None for point in forces.points]
    found = forces.on_robot[:, on_robot].sum(axis=1) + forces.missing[:, :3] - [0.0, 0.0, forces.mass * GRAVITY]
    np.testing.assert_allclose(found, forces.mass * acceleration, atol=1e-9 * forces.mass * GRAVITY)
    assert forces.missing_share.max() > 0.0


def test_torques_are_those_that_move_the_joints_with_these_forces():
    model = MODELS["unitree_g1"]
    motion, geometries = holding(model)
    forces = forces_of(motion, model, geometries, Physics(object_mass=2.0))
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    data = mujoco.MjData(compiled)
    data.qpos[:] = motion.qpos[0]
    mujoco.mj_forward(compiled, data)
    applied = np.zeros(compiled.nv)
    for number, point in enumerate(forces.points):
        if point.link is not None:
            body = data.body(compiled.body(_body_of(model, point.link)).id).id
            place, force = point.position[0], forces.on_robot[0, number]
            mujoco.mj_applyFT(compiled, data, force, np.zeros(3), place, body, applied)
    np.testing.assert_allclose(forces.torques[0], (data.qfrc_bias - applied)[6:], atol=1e-6)


def test_a_mirrored_pose_takes_mirrored_torques():
    model = MODELS["unitree_g1"]
    qpos = standing_qpos(model, 5)
    names = list(model.joint_names)
    for name, angle in (("left_shoulder_pitch", -0.8), ("left_elbow", 0.4), ("right_shoulder_roll", -0.6)):
        qpos[:, 7 + names.index(f"{name}_joint")] += angle
    qpos[:, 7 + names.index("waist_yaw_joint")] = 0.3
    other = {"left": "right", "right": "left"}
    mirrored = qpos.copy()
    for column, name in enumerate(names):
        side = name.split("_")[0]
        twin = names.index(name.replace(side, other[side])) if side in other else column
        sign = 1.0 if "pitch" in name or "knee" in name or "elbow" in name else -1.0
        mirrored[:, 7 + twin] = sign * qpos[:, 7 + column]
    torques, twins = alone(model, qpos).torques[0], alone(model, mirrored).torques[0]
    for column, name in enumerate(names):
        side = name.split("_")[0]
        twin = names.index(name.replace(side, other[side])) if side in other else column
        # The maker's inertias are alike on both sides to some grams.
        assert abs(torques[column]) == pytest.approx(abs(twins[twin]), abs=0.15), name
    assert np.abs(torques - twins).max() > 1.0


def test_a_heavier_object_takes_larger_torques_until_hands_cannot_hold_it():
    model = MODELS["unitree_g1"]
    motion, geometries = holding(model)
    found = [
        forces_of(motion, model, geometries, Physics(object_mass=mass)) for mass in (0.2, 0.5, 1.0, 2.0, 4.0, 30.0)
    ]
    arms = [column for column, name in enumerate(model.joint_names) if "shoulder" in name or "elbow" in name]
    torques = [np.linalg.norm(forces.unlimited_torques[0, arms]) for forces in found]
    missing = [forces.missing_share_at_objects.max() for forces in found]
    assert (np.diff(torques) > 0.0).all()
    assert missing[0] < 1e-9 and missing[-1] > 0.1 and (np.diff(missing) > -1e-9).all()
    assert all(np.abs(forces.torques).max() < 50.0 * 1.2 for forces in found)


def test_what_a_robot_gives_to_an_object_is_the_objects_weight():
    model = MODELS["unitree_g1"]
    motion, geometries = holding(model)
    forces = forces_of(motion, model, geometries, Physics(object_mass=1.0))
    given = -forces.on_robot[0, [point.object == 0 for point in forces.points]].sum(axis=0)
    np.testing.assert_allclose(given, [0.0, 0.0, GRAVITY], atol=1e-6)


def test_forces_stay_in_their_friction_cones():
    model = MODELS["unitree_g1"]
    motion, geometries = holding(model)
    physics = Physics(object_mass=1.0, hand_friction=0.5, object_friction=0.3)
    forces = forces_of(motion, model, geometries, physics)
    for number, point in enumerate(forces.points):
        force = forces.on_robot[:, number]
        normal = np.einsum("ti,ti->t", force, point.normal)
        across = np.linalg.norm(force - normal[:, None] * point.normal, axis=1)
        friction = 0.3 if point.link is None else 0.8 if point.on_floor else 0.5
        assert (across <= friction * normal + 1e-9).all()
        assert (force[~point.active] == 0.0).all()


@pytest.mark.parametrize(("speed", "slides"), [(0.2, True), (0.02, False)])
def test_what_slides_over_the_floor_is_braked_by_it(speed, slides):
    """Robot and box, which one hand cannot lift, glide ahead: the floor may push only what does not slide."""
    model = load_robot("unitree_g1")
    motion, (shape,) = holding(model, hands=(True, False), frames=20)
    seconds = np.arange(20) / FPS
    way = (speed * seconds)[:, None] * [1.0, 0.0, 0.0]
    qpos, place = motion.qpos.copy(), motion.object_pos + way[:, None]
    qpos[:, :3] += way
    tall = replace(shape, points=shape.points * [1.0, 1.0, place[0, 0, 2] / 0.15])
    found = forces_of(replace(motion.with_qpos(qpos), object_pos=place), model, (tall,))
    on_floor = [index for index, point in enumerate(found.points) if point.link is None]
    forces = found.on_robot[3:-3, on_floor]
    assert on_floor and forces[..., 2].sum(axis=1).min() > 1.0
    if slides:
        np.testing.assert_allclose(forces[..., 0], -Physics().object_friction * forces[..., 2], atol=1e-9)
        np.testing.assert_allclose(forces[..., 1], 0.0, atol=1e-9)
    else:
        assert np.abs(forces[..., 0]).max() < 0.5 * Physics().object_friction * forces[..., 2].max()


def test_one_hand_on_a_side_cannot_carry_a_box():
    model = MODELS["unitree_g1"]
    motion, geometries = holding(model, hands=(True, False))
    forces = forces_of(motion, model, geometries, Physics(object_mass=1.0))
    (found, *_) = [item for item in infeasibilities(forces, motion) if item.kind == "one hand"]
    assert (found.first_frame, found.last_frame) == (0, motion.frames - 1)
    assert "left_palm alone cannot move the box of 1.0 kg so" in str(found)
    assert forces_figures(forces, motion)["one_hand_unheld_s"] == pytest.approx(motion.frames / FPS)
    both = holding(model)
    assert not infeasibilities(forces_of(both[0], model, both[1], Physics(object_mass=1.0)), both[0])


def test_a_hand_that_is_far_from_what_it_is_to_hold_is_named():
    model = MODELS["unitree_g1"]
    motion, geometries = holding(model)
    away = replace(motion, object_pos=motion.object_pos + np.array([0.0, 0.0, 1.0]))
    (found,) = infeasibilities(forces_of(away, model, geometries), away)
    assert "left_palm and right_palm are too far off to hold the box" in str(found)


def test_what_others_hold_too_is_not_judged():
    model = MODELS["unitree_g1"]
    motion, geometries = holding(model, hands=(True, False))
    others = np.ones((motion.frames, 1), dtype=bool)
    forces = forces_of(motion, model, geometries, held_by_others=others)
    assert np.isnan(forces.missing_at_objects).all()
    assert not infeasibilities(forces, motion)


def test_torques_over_limits_are_named_with_what_they_would_be():
    model = MODELS["unitree_g1"]
    motion, geometries = holding(model)
    forces = forces_of(motion, model, geometries, Physics(object_mass=20.0))
    found = infeasibilities(forces, motion)
    over = [item for item in found if item.kind == "torque"]
    assert over and all("with the box of 20.0 kg" in str(item) and item.largest_share > 1.0 for item in over)
    name, needed, more = re.findall(r"^(\w+) would need ([\d.]+) N m .*, ([\d.]+) more than it has", over[0].text)[0]
    limit = float(forces.limits[model.joint_names.index(name)])
    assert float(needed) == pytest.approx(over[0].largest_share * limit, abs=0.06)
    assert float(more) == pytest.approx(float(needed) - limit, abs=0.11)


def test_what_a_robot_in_the_air_lacks_is_its_weight():
    model = MODELS["unitree_g1"]
    motion = plain_motion(model, standing_qpos(model) + 2.0 * (np.arange(7 + model.n) == 2), **nothing(30))
    forces = forces_of(motion, model, ())
    (found,) = infeasibilities(forces, motion)
    assert (found.kind, found.first_frame, found.last_frame) == ("balance", 0, 29)
    weight = f"{forces.mass * GRAVITY:.0f} N and 0.0 N m, 100 % of its weight"
    assert str(found) == (
        f"frames 0 to 29: the robot lacks {weight}: nothing of it is on the floor (worst in frame {_worst(found)})"
    )


def test_what_a_robot_lacks_that_speeds_up_beyond_friction_is_a_share_of_its_weight():
    model = MODELS["unitree_g1"]
    qpos = standing_qpos(model)
    qpos[:, 0] += 0.5 * 12.0 * (np.arange(30) / FPS) ** 2
    motion = plain_motion(model, qpos, **nothing(30))
    forces = forces_of(motion, model, ())
    (found,) = [item for item in infeasibilities(forces, motion) if item.kind == "balance"]
    frame = _worst(found)
    force, torque, share = map(float, re.findall(r"lacks (\d+) N and ([\d.]+) N m, (\d+) % of", found.text)[0])
    assert share == round(100.0 * forces.missing_share[frame]) == round(100.0 * found.largest_share)
    assert force == round(np.linalg.norm(forces.missing[frame, :3]))
    assert torque == pytest.approx(np.linalg.norm(forces.missing[frame, 3:]), abs=0.05)
    assert "its soles and hands cannot give them" in found.text


def _worst(found) -> int:
    return int(re.findall(r"worst in frame (\d+)", found.text)[0])


def test_a_motion_longer_than_a_block_is_the_same_everywhere():
    model = MODELS["unitree_g1"]
    forces = alone(model, standing_qpos(model, 520))
    np.testing.assert_allclose(forces.on_robot, forces.on_robot[:1].repeat(520, axis=0), atol=1e-6)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_short_motions_have_forces(frames):
    model = MODELS["unitree_g1"]
    assert alone(model, standing_qpos(model, frames)).missing_share.max() < 1e-9


@settings(deadline=None, max_examples=20)
@given(turn=st.tuples(*[st.floats(-2.0, 2.0)] * 3), fps=st.sampled_from([20.0, 30.0, 120.0]))
def test_velocities_and_accelerations_are_those_of_the_path(turn, fps):
    time, rate = np.arange(40) / fps, np.array(turn)
    path = np.stack([1.0 + time, time**2, -(time**3)], axis=1)
    start = se3.exp(np.array([0.3, -1.0, 0.5]))
    quats = se3.quat_multiply(start, se3.exp(0.5 * time[:, None] ** 2 * rate))
    movement = movement_of(np.concatenate([path, quats, path], axis=1), fps, 0.3)
    np.testing.assert_allclose(movement.qacc[:, :3], np.stack([0 * time, 2 + 0 * time, -6 * time], axis=1), atol=1e-6)
    np.testing.assert_allclose(
        movement.qvel[:, 6:], np.stack([1 + 0 * time, 2 * time, -3 * time**2], axis=1), atol=1e-6
    )
    np.testing.assert_allclose(movement.qvel[5:-5, 3:6], time[5:-5, None] * rate, atol=0.05)
    np.testing.assert_allclose(movement.qacc[5:-5, 3:6], np.tile(rate, (30, 1)), atol=0.5)


def test_any_motion_has_finite_forces():
    model, generator = MODELS["unitree_g1"], np.random.default_rng(3)
    forces = alone(model, random_qpos(model, 30, generator))
    assert np.isfinite(forces.missing).all() and np.isfinite(forces.torques).all()


def test_the_command_tells_what_speaks_against_a_result(tmp_path, capsys):
    model = MODELS["unitree_g1"]
    motion, _ = holding(model, hands=(True, False), frames=make("carry_box").frames)
    result_file.save(motion, tmp_path / "carry.npz")
    words = ["feasible", str(tmp_path / "carry.npz"), "--clip", "builtin:carry_box", "--object-mass", "2"]
    assert main([*words, "--json", str(tmp_path / "found.json")]) == 0
    said = capsys.readouterr().out
    assert "left_palm" in said and "the box of 2.0 kg" in said and "missing wrench" in said
    (facts,) = json.loads((tmp_path / "found.json").read_text())
    assert facts["objects"][0]["mass"] == 2.0 and facts["shortcomings"]
    assert main([*words, "--json", str(tmp_path / "carry.npz")]) == 2
    assert main(["feasible", str(tmp_path / "none.npz")]) == 1
    assert main([*words[:3], "builtin:push_table"]) == 1
    assert "it was made from" in capsys.readouterr().err


def centre_acceleration(model, movement, frame):
    """Return the acceleration of the robot's centre of mass, by MuJoCo."""
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    compiled.opt.gravity[:] = 0.0
    data = mujoco.MjData(compiled)
    data.qpos[:], data.qvel[:] = movement.qpos[frame], movement.qvel[frame]
    mujoco.mj_forward(compiled, data)
    data.qacc[:] = movement.qacc[frame]
    mujoco.mj_rnePostConstraint(compiled, data)
    total, one = np.zeros(3), np.zeros(6)
    for body in range(1, compiled.nbody):
        mujoco.mj_objectAcceleration(compiled, data, mujoco.mjtObj.mjOBJ_BODY, body, one, 0)
        total += compiled.body_mass[body] * one[3:]
    return total / compiled.body_mass.sum()


def _body_of(model, link):
    return next(name for name, frame in model.body_frames.frames.items() if frame.node == link.node)


def test_forces_are_finite_where_those_of_the_frame_before_are_alike():
    """As of fingers that come to one place on a light object, on which their effects are large."""
    random = np.random.default_rng(0)
    effects = np.abs(random.standard_normal((2, 12, 18)))
    effects[1] = 5000.0 * effects[1, 0] * (1.0 + 1e-15 * random.standard_normal((12, 1)))
    targets = np.einsum("fn,fnh->fh", np.abs(random.standard_normal((2, 12))), effects)
    found = least_forces(effects, targets, np.zeros((2, 12, 3)), np.zeros((2, 3)), np.ones((2, 12), dtype=bool))
    assert np.isfinite(found).all() and (found >= 0.0).all()
    assert np.einsum("sfn,fnh->sfh", found, effects) == pytest.approx(np.stack([targets] * 2), rel=1e-6)
