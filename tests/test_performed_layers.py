"""Laws of what viewers show of performed motions: references stay, arrows are as long as forces are large."""

from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.cli import main
from hoi_retarget.errors import ClipError
from hoi_retarget.motion.motion import ContactForces, Stage
from hoi_retarget.motion.result_file import load, save
from hoi_retarget.simulation.tracking_result import simulated_motion
from hoi_retarget.studio.scene.marks import ARROW_LENGTH, force_arrows
from hoi_retarget.studio.scene.scene import FORCES, REFERENCE, SceneItem, make_scene
from plain_motions import plain_motion, standing_qpos
from test_certificate import stood
from test_rollout import G1


def some_forces(frames=5):
    random = np.random.default_rng(3)
    forces, points = random.normal(0.0, 100.0, (frames, 2, 3)), random.normal(0.0, 1.0, (frames, 2, 3))
    forces[0, 0], forces[1, 1] = 0.0, [0.0, 0.0, 150.0]
    return ContactForces(("left_foot", "box"), forces, points)


def layers_of(motion):
    (subject,) = make_scene([SceneItem("a", motion, G1)]).subjects
    return {layer.name: layer for layer in subject.layers}


def test_simulated_feet_carry_the_weight_and_files_keep_it(tmp_path):
    motion, scene, rollout, _ = stood()
    performed = simulated_motion(motion, scene, rollout)
    forces = performed.stages[-1].forces
    weight = 9.81 * G1.inertias.masses.sum()
    robot = [name != scene.objects[0].body_name for name in forces.bodies]
    np.testing.assert_allclose(forces.forces[40, robot].sum(axis=0), [0.0, 0.0, weight], atol=0.02 * weight)
    assert np.abs(forces.points[40, robot, 2]).max() < 0.01  # On the floor.
    (box,) = np.flatnonzero(np.logical_not(robot))
    assert forces.forces[40, box, 2] == pytest.approx(9.81 * scene.objects[0].body.mass, rel=0.05)
    save(performed, tmp_path / "a.npz")
    again = load(tmp_path / "a.npz").stages[-1].forces
    assert again.bodies == forces.bodies
    assert again.forces.tobytes() == forces.forces.tobytes() and again.points.tobytes() == forces.points.tobytes()


def test_an_arrow_is_as_long_as_its_force_is_large():
    forces = some_forces()
    (lines,) = force_arrows(forces)
    shafts, sizes = lines.ends[:, :2] - lines.starts[:, :2], np.linalg.norm(forces.forces, axis=2)
    np.testing.assert_allclose(shafts, ARROW_LENGTH * forces.forces, atol=1e-6)
    np.testing.assert_allclose(lines.starts[:, :2], forces.points, atol=1e-6)
    np.testing.assert_array_equal(lines.visible[:, :2], sizes > 0.0)
    np.testing.assert_array_equal(lines.starts[:, 2:4], lines.ends[:, :2])  # Heads begin where shafts end.
    heads = np.linalg.norm(lines.ends[:, 2:] - lines.starts[:, 2:], axis=2)[lines.visible[:, 2:]]
    assert (heads > 0.0).all() and heads.max() < 0.06
    assert force_arrows(ContactForces((), np.zeros((3, 0, 3)), np.zeros((3, 0, 3)))) == ()


def test_what_was_performed_has_layers_of_its_own_and_other_motions_have_none():
    motion = plain_motion(G1, standing_qpos(G1, 5))
    assert not {REFERENCE, FORCES} & set(layers_of(motion))
    before = np.concatenate([motion.object_pos + np.array([0.0, 0.5, 0.0]), motion.object_quat], axis=2)
    stages = (replace(motion.stages[0], objects=before), Stage("physics", motion.qpos, forces=some_forces()))
    layers = layers_of(replace(motion, stages=stages))
    assert not layers[REFERENCE].shown and layers[REFERENCE].opacity < 1.0 and layers[FORCES].shown
    *_, ghost = layers[REFERENCE].parts
    (solid,) = layers["object"].parts
    np.testing.assert_allclose(ghost.positions, solid.positions + np.array([0.0, 0.5, 0.0]), atol=1e-6)


def test_forces_have_a_row_for_every_frame():
    motion = plain_motion(G1, standing_qpos(G1, 4))
    with pytest.raises(ClipError, match="forces of 5 frames of 4"):
        replace(motion, stages=(Stage("physics", motion.qpos, forces=some_forces()),))
    with pytest.raises(ClipError, match="finite"):
        replace(some_forces(), forces=np.full((5, 2, 3), np.inf))


def test_layers_of_what_was_not_performed_are_refused(tmp_path, capsys):
    save(plain_motion(G1, standing_qpos(G1, 4)), tmp_path / "a.npz")
    assert main(["render", str(tmp_path / "a.npz"), "--out", str(tmp_path / "a.png"), "--also", "forces"]) == 2
    assert "was not performed in simulation" in capsys.readouterr().err
