"""Motions at other rates: the same path, velocities that integrate to it, and bodies as MuJoCo has them."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from export_motions import smooth_motion
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.motion.links import breadth_first, link_states
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.resample import resample
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import RobotModel
from trajectories import MODELS

G1 = MODELS["unitree_g1"]
LAWS = settings(max_examples=12, deadline=None, derandomize=True, database=None)
every_robot = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
rates = st.sampled_from([10.0, 24.0, 30.0, 50.0, 59.94, 60.0, 100.0, 120.0])


def simpson(rate: np.ndarray, step: float) -> np.ndarray:
    """Return integrals over every second frame and the one after it."""
    return step / 3 * (rate[:-2:2] + 4 * rate[1:-1:2] + rate[2::2])


# what stays


@every_robot
def test_at_its_own_rate_a_motion_stays_as_it_is(model):
    motion = smooth_motion(model, objects=2)
    for trajectory in (resample(motion, model), resample(motion, model, motion.fps)):
        for name in ("qpos", "object_pos", "object_quat", "contact_flags", "contact_object", "stance_flags"):
            np.testing.assert_array_equal(getattr(trajectory, name), getattr(motion, name))
        np.testing.assert_array_equal(trajectory.contact_points, motion.contact_points)


@LAWS
@given(source=rates, target=rates, frames=st.integers(2, 50), seed=st.integers(0, 10**6))
def test_the_duration_stays_but_for_less_than_a_frame(source, target, frames, seed):
    motion = smooth_motion(G1, frames=frames, fps=source, seed=seed)
    trajectory = resample(motion, G1, target)
    duration, new = (frames - 1) / source, (trajectory.frames - 1) / target
    assert new <= duration + 1e-9 < new + 1 / target + 2e-9
    assert trajectory.fps == target
    np.testing.assert_allclose(trajectory.qpos[0], motion.qpos[0], atol=1e-12)
    arrays = [value for value in vars(trajectory).values() if isinstance(value, np.ndarray)]
    assert len(arrays) == 12 and all(len(array) == trajectory.frames for array in arrays)


@LAWS
@given(factor=st.integers(2, 5), seed=st.integers(0, 10**6))
def test_at_a_multiple_of_the_rate_every_frame_is_met(factor, seed):
    motion = smooth_motion(G1, seed=seed)
    trajectory = resample(motion, G1, factor * motion.fps)
    assert trajectory.frames == factor * (motion.frames - 1) + 1
    np.testing.assert_allclose(trajectory.qpos[::factor, :3], motion.qpos[:, :3], atol=1e-12)
    np.testing.assert_allclose(trajectory.qpos[::factor, 7:], motion.qpos[:, 7:], atol=1e-12)
    assert se3.angle_between(trajectory.qpos[::factor, 3:7], motion.qpos[:, 3:7]).max() < 1e-7
    assert se3.angle_between(trajectory.object_quat[::factor], motion.object_quat).max() < 1e-7
    own = resample(motion, G1)
    for name in ("root_lin_vel", "root_ang_vel", "joint_vel", "object_lin_vel", "object_ang_vel"):
        np.testing.assert_allclose(getattr(trajectory, name)[::factor], getattr(own, name), atol=1e-9)


def test_quaternions_of_either_sign_are_the_same_motion():
    motion = smooth_motion(G1, seed=3)
    signs = np.where(np.random.default_rng(0).random(motion.frames) < 0.5, -1.0, 1.0)[:, None]
    root, joints = motion.qpos[:, :7], motion.qpos[:, 7:]
    flipped = motion.with_qpos(np.concatenate([root[:, :3], signs * root[:, 3:], joints], axis=1))
    a, b = resample(motion, G1, 50.0), resample(flipped, G1, 50.0)
    assert se3.angle_between(a.qpos[:, 3:7], b.qpos[:, 3:7]).max() < 1e-7
    np.testing.assert_allclose(a.root_ang_vel, b.root_ang_vel, atol=1e-9)


# velocities


@LAWS
@given(seed=st.integers(0, 10**6))
def test_velocities_integrate_to_positions_and_rotations(seed):
    motion = smooth_motion(G1, seed=seed)
    trajectory = resample(motion, G1, 20 * motion.fps)
    step = 1 / trajectory.fps
    for positions, velocities in (
        (trajectory.qpos[:, :3], trajectory.root_lin_vel),
        (trajectory.qpos[:, 7:], trajectory.joint_vel),
        (trajectory.object_pos, trajectory.object_lin_vel),
    ):
        np.testing.assert_allclose(np.diff(positions[::2], axis=0), simpson(velocities, step), atol=1e-9)
    for quats, velocities in (
        (trajectory.qpos[:, 3:7], trajectory.root_ang_vel),
        (trajectory.object_quat, trajectory.object_ang_vel),
    ):
        turned = se3.quat_multiply(se3.exp(simpson(velocities, step)), quats[:-2:2])
        assert se3.angle_between(turned, quats[2::2]).max() < 1e-6


@LAWS
@given(yaw=st.floats(-3.0, 3.0), tilt=st.floats(-1.0, 1.0), seed=st.integers(0, 10**6))
def test_moving_the_world_moves_the_export(yaw, tilt, seed):
    motion = smooth_motion(G1, objects=2, seed=seed)
    turn, shift = se3.exp(np.array([tilt, 0.0, yaw])), np.array([1.0, -2.0, 0.3])
    root = [se3.rotate(turn, motion.qpos[:, :3]) + shift, se3.quat_multiply(turn, motion.qpos[:, 3:7])]
    moved = replace(
        motion.with_qpos(np.concatenate([*root, motion.qpos[:, 7:]], axis=1)),
        object_pos=se3.rotate(turn, motion.object_pos) + shift,
        object_quat=se3.quat_multiply(turn, motion.object_quat),
    )
    plain, other = resample(motion, G1, 50.0), resample(moved, G1, 50.0)
    a, b = link_states(plain), link_states(other)
    np.testing.assert_allclose(b.pos, se3.rotate(turn, a.pos) + shift, atol=1e-10)
    assert se3.angle_between(b.quat, se3.quat_multiply(turn, a.quat)).max() < 1e-7
    for name in ("lin_vel", "com_lin_vel", "ang_vel"):
        np.testing.assert_allclose(getattr(b, name), se3.rotate(turn, getattr(a, name)), atol=1e-9)
    np.testing.assert_allclose(other.object_ang_vel, se3.rotate(turn, plain.object_ang_vel), atol=1e-9)


def in_a_mirror(motion: Motion) -> Motion:
    """Return a G1's motion as seen in a mirror at y = 0: left limbs do what right ones did."""
    swap = {"left": "right", "right": "left"}
    names = motion.joint_names
    columns = [
        names.index(swap.get(name.split("_")[0], name.split("_")[0]) + name[name.index("_") :]) for name in names
    ]
    signs = np.array([-1.0 if "roll" in name or "yaw" in name else 1.0 for name in names])
    root, joints = motion.qpos[:, :7], motion.qpos[:, 7:]
    place = root[:, :3] * np.array([1.0, -1.0, 1.0])
    turn = root[:, 3:7] * np.array([1.0, -1.0, 1.0, -1.0])
    return motion.with_qpos(np.concatenate([place, turn, signs * joints[:, columns]], axis=1))


def test_a_mirror_image_is_exported_as_one():
    motion = smooth_motion(G1, seed=8)
    plain = link_states(resample(motion, G1, 50.0))
    other = link_states(resample(in_a_mirror(motion), G1, 50.0))
    swap = {"left": "right", "right": "left"}
    bodies = [
        plain.names.index(swap.get(name.split("_")[0], name.split("_")[0]) + name[len(name.split("_")[0]) :])
        for name in plain.names
    ]
    # The maker's numbers of the two sides differ in the fifth digit.
    flip = np.array([1.0, -1.0, 1.0])
    np.testing.assert_allclose(other.pos, plain.pos[:, bodies] * flip, atol=2e-4)
    np.testing.assert_allclose(other.lin_vel, plain.lin_vel[:, bodies] * flip, atol=2e-3)
    np.testing.assert_allclose(other.ang_vel, -plain.ang_vel[:, bodies] * flip, atol=2e-3)


# limits


def test_joints_stay_in_their_ranges_and_stand_still_where_they_are_held():
    motion = smooth_motion(G1, frames=12)
    joints = motion.qpos[:, 7:].copy()
    joints[:, 3] = np.where(np.arange(12) < 6, G1.upper[3] - 0.4, G1.upper[3])
    motion = motion.with_qpos(np.concatenate([motion.qpos[:, :7], joints], axis=1))
    dense = np.linspace(0, 11, 1000)
    assert CubicSpline(np.arange(12), joints)(dense).max(axis=0)[3] > G1.upper[3] + 0.01, "nothing overshoots"
    trajectory = resample(motion, G1, 600.0)
    assert (trajectory.qpos[:, 7:] <= G1.upper + 1e-12).all() and (trajectory.qpos[:, 7:] >= G1.lower - 1e-12).all()
    knee, speed = trajectory.qpos[:, 10], trajectory.joint_vel[:, 3]
    held = (knee == G1.upper[3]) & (np.arange(len(knee)) % 20 != 0)
    assert held.sum() > 10 and not speed[held].any()
    # Where a joint reaches its limit its velocity jumps: there alone the integral is off by part of a step.
    ends = np.diff(knee[::2]) - simpson(speed, 1 / 600.0)
    assert (np.abs(ends) > 1e-9).sum() <= 6 and abs(ends.sum()) < 0.01


def test_what_lies_beyond_a_limit_in_the_motion_itself_stays():
    motion = smooth_motion(G1)
    joints = motion.qpos[:, 7:].copy()
    joints[20, 0] = G1.upper[0] + 0.2
    motion = motion.with_qpos(np.concatenate([motion.qpos[:, :7], joints], axis=1))
    assert resample(motion, G1, 60.0).qpos[40, 7] == pytest.approx(G1.upper[0] + 0.2, abs=1e-12)


@pytest.mark.parametrize("fps", [0.0, -30.0, float("nan"), float("inf"), 5000.0])
def test_rates_that_are_none_are_refused(fps):
    with pytest.raises(ArgumentError, match="--fps"):
        resample(smooth_motion(G1), G1, fps)


def test_a_single_frame_has_no_velocity():
    with pytest.raises(ClipError, match="one frame"):
        resample(smooth_motion(G1, frames=1), G1)


# contacts


def touching(flags: list[int], objects: list[int], heights: list[float]) -> Motion:
    """Return a motion whose first link touches objects at the given heights."""
    frames = len(flags)
    motion = smooth_motion(G1, frames=frames, objects=2)
    active = np.zeros((frames, 4), dtype=bool)
    active[:, 0] = flags
    points = np.full((frames, 4, 3), np.nan)
    points[:, 0, :2], points[:, 0, 2] = 0.0, heights
    return replace(
        motion,
        contact_flags=active,
        contact_object=np.where(active, np.array(objects)[:, None], -1),
        contact_points=np.where(active[:, :, None], points, np.nan),
    )


def test_flags_are_those_of_the_nearest_frame_and_points_lie_between_frames_of_one_contact():
    motion = touching([0, 1, 1, 1, 0], [0, 0, 0, 1, 0], [0.0, 1.0, 2.0, 5.0, 0.0])
    trajectory = resample(motion, G1, 120.0)
    #            frame 0        1        2        3        4, and three quarters between each
    expected_flags = [0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0]
    expected_object = [-1, -1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, -1, -1, -1]
    heights = [1.0, 1.0, 1.0, 1.25, 1.5, 1.75, 2.0, 2.0, 5.0, 5.0, 5.0, 5.0]
    np.testing.assert_array_equal(trajectory.contact_flags[:, 0], expected_flags)
    np.testing.assert_array_equal(trajectory.contact_object[:, 0], expected_object)
    np.testing.assert_allclose(trajectory.contact_points[2:14, 0, 2], heights, atol=1e-9)


@LAWS
@given(target=rates, seed=st.integers(0, 10**6))
def test_a_point_is_there_exactly_where_there_is_a_contact(target, seed):
    rng = np.random.default_rng(seed)
    flags = rng.random(20) < 0.5
    motion = touching(list(flags), list(rng.integers(0, 2, 20)), list(rng.normal(size=20)))
    trajectory = resample(motion, G1, target)
    np.testing.assert_array_equal(np.isfinite(trajectory.contact_points).all(axis=2), trajectory.contact_flags)
    np.testing.assert_array_equal(trajectory.contact_object >= 0, trajectory.contact_flags)


# bodies


@every_robot
def test_bodies_move_as_in_mujoco(model: RobotModel):
    trajectory = resample(smooth_motion(model, seed=5), model, 50.0)
    links = link_states(trajectory)
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    data, twist = mujoco.MjData(compiled), np.zeros(6)
    kinds = {"lin_vel": mujoco.mjtObj.mjOBJ_XBODY, "com_lin_vel": mujoco.mjtObj.mjOBJ_BODY}
    for frame in range(0, trajectory.frames, 9):
        data.qpos[:] = trajectory.qpos[frame]
        in_root = se3.rotate_inverse(trajectory.qpos[frame, 3:7], trajectory.root_ang_vel[frame])
        data.qvel[:] = np.concatenate([trajectory.root_lin_vel[frame], in_root, trajectory.joint_vel[frame]])
        mujoco.mj_forward(compiled, data)
        for column, name in enumerate(links.names):
            body = compiled.body(name).id
            np.testing.assert_allclose(links.pos[frame, column], data.xpos[body], atol=1e-9)
            assert abs(links.quat[frame, column] @ data.xquat[body]) > 1 - 1e-12
            for speed, kind in kinds.items():
                mujoco.mj_objectVelocity(compiled, data, kind, body, twist, 0)
                np.testing.assert_allclose(getattr(links, speed)[frame, column], twist[3:], atol=1e-9)
                np.testing.assert_allclose(links.ang_vel[frame, column], twist[:3], atol=1e-9)


@every_robot
def test_no_body_of_the_mjcf_is_left_out(model):
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    names = tuple(compiled.body(body).name for body in range(1, compiled.nbody))
    assert link_states(resample(smooth_motion(model), model)).names == names


@every_robot
def test_breadth_first_goes_down_the_tree_level_by_level(model):
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))

    def depth(name: str) -> int:
        body, count = compiled.body(name).id, 0
        while body:
            body, count = compiled.body_parentid[body], count + 1
        return count

    bodies, joints = breadth_first(model)
    assert sorted(bodies) == list(range(len(model.body_names))) and sorted(joints) == list(range(model.n))
    depths = [depth(model.body_names[body]) for body in bodies]
    assert depths == sorted(depths)
    moved = [compiled.body(int(compiled.joint(model.joint_names[joint]).bodyid[0])).name for joint in joints]
    assert moved == [model.body_names[body] for body in bodies][1:], "each joint moves the body after the root"
