"""Laws of simulated tracking: references are the motion, the same is the same, feedback keeps a robot on its feet."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.dynamics.contact_forces import forces_of
from hoi_retarget.dynamics.physics_scene import compiled, scene_of
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.simulation.control import feedback_gains
from hoi_retarget.simulation.rollout import (
    TICK,
    base_errors_deg,
    drive_targets,
    object_errors,
    reference_of,
    tilt_deg,
    track,
)
from plain_motions import FPS, plain_motion, standing_qpos, tracks_of
from trajectories import MODELS

G1 = MODELS["unitree_g1"]
CORNERS = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (-0.2, 0.2)])


def staged(qpos, **changes):
    """A scene with a box that stands a metre beside the robot, and the reference."""
    place = np.tile([0.0, 2.0, 0.2], (len(qpos), 1, 1))
    motion = plain_motion(G1, qpos, **{"object_pos": place, **changes})
    geometries = (ObjectGeometry(CORNERS),)
    scene = scene_of(motion, G1, tracks_of(motion, geometries))
    return motion, scene, reference_of(scene, motion, forces_of(motion, G1, geometries))


@pytest.fixture(scope="module")
def standing():
    """A robot that stands still for four seconds."""
    return staged(standing_qpos(G1, 120))


@settings(deadline=None, max_examples=10)
@given(speed=st.tuples(*[st.floats(-1.0, 1.0)] * 3), turn=st.floats(-2.0, 2.0))
def test_a_reference_is_the_motion_at_a_controllers_ticks(speed, turn):
    def path(times):
        qpos = np.repeat(standing_qpos(G1, 1), len(times), axis=0)
        qpos[:, :3] += times[:, None] * np.array(speed)
        qpos[:, 3:7] = se3.exp(np.array([0.0, 0.0, turn]) * times[:, None])
        qpos[:, 20] += times
        return qpos

    _, scene, reference = staged(path(np.arange(30) / FPS))
    ticks = TICK * np.arange(len(reference.qpos))
    assert reference.seconds == pytest.approx(29 / FPS, abs=TICK)
    expected = path(ticks)
    np.testing.assert_allclose(reference.qpos[:, :7], expected[:, :7], atol=2e-3)
    np.testing.assert_allclose(reference.qpos[:, 7 : 7 + G1.n], expected[:, 7:], atol=1e-6)
    np.testing.assert_allclose(reference.qvel[:, :3], np.tile(speed, (len(ticks), 1)), atol=1e-6)
    np.testing.assert_allclose(reference.qvel[:, 5], turn, atol=2e-2)
    assert reference.qpos.shape[1] == compiled(scene).nq


def test_drives_on_the_reference_give_the_feedforward_torques(standing):
    _, scene, reference = standing
    targets, drives = drive_targets(scene, reference), scene.actuators
    given_torques = drives.stiffness * (targets - reference.qpos[:, 7 : 7 + G1.n]) - drives.damping * 0.0
    np.testing.assert_allclose(given_torques, reference.torques, atol=1e-6)
    assert np.array_equal(drive_targets(scene, reference, feedforward=False), reference.qpos[:, 7 : 7 + G1.n])


def test_the_same_rollout_has_the_same_bytes(standing):
    _, scene, reference = standing
    targets = drive_targets(scene, reference)
    first, second = (track(compiled(scene), reference, targets) for _ in range(2))
    assert first.qpos.tobytes() == second.qpos.tobytes() and first.fell_after == second.fell_after
    none = np.zeros((len(targets), G1.n, 2 * compiled(scene).nv))
    assert track(compiled(scene), reference, targets, none).qpos.tobytes() == first.qpos.tobytes()


def test_feedback_keeps_a_robot_on_its_feet_that_falls_without_it(standing):
    _, scene, reference = standing
    simulated, targets = compiled(scene), drive_targets(scene, reference)
    pushed = reference.qvel.copy()
    pushed[0, 0] = 0.15
    off = replace(reference, qvel=pushed)
    alone = track(simulated, off, targets)
    assert alone.fell_after is not None and alone.seconds < reference.seconds
    held = track(simulated, off, targets, feedback_gains(scene, simulated, reference))
    assert held.fell_after is None and held.seconds == pytest.approx(reference.seconds)
    assert np.linalg.norm(held.qpos[-1, :3] - reference.qpos[-1, :3]) < 0.02
    assert base_errors_deg(held, reference)[-1] < 2.0
    assert object_errors(held, reference, G1.n).max() < 0.005


@given(angle=st.floats(0.0, 3.1), yaw=st.floats(-3.0, 3.0), heading=st.floats(-3.0, 3.0))
def test_tilt_is_the_angle_from_upright_and_knows_no_heading(angle, yaw, heading):
    axis = np.array([np.cos(heading), np.sin(heading), 0.0])
    tilted = se3.quat_multiply(se3.exp(angle * axis), se3.exp(np.array([0.0, 0.0, yaw])))
    assert tilt_deg(tilted, se3.IDENTITY_QUAT) == pytest.approx(np.degrees(angle), abs=1e-5)


def test_what_a_simulator_cannot_continue_counts_as_a_fall(standing, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, scene, reference = standing
    simulated = compiled(scene)
    wild = np.full((len(reference.qpos), G1.n, 2 * simulated.nv), 1e12)
    rollout = track(simulated, reference, drive_targets(scene, reference), wild)
    assert rollout.fell_after is not None
    assert len(rollout.qpos) == len(rollout.qvel) == len(rollout.targets) == round(rollout.fell_after / TICK)
    assert np.isfinite(rollout.qpos).all()
    assert not list(tmp_path.iterdir())
