"""Dots where a robot is inside something, as deep as it is, on the surface; and arrows of forces."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from hoi_retarget.cli import main
from hoi_retarget.errors import ClipError
from hoi_retarget.evaluation.penetration import self_depths
from hoi_retarget.motion.motion import ContactForces, Stage
from hoi_retarget.motion.result_file import load, save
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.robots.link_depths import RigidPoses
from hoi_retarget.robots.skin import link_heights, skin_of
from hoi_retarget.simulation.tracking_result import simulated_motion
from hoi_retarget.studio.scene.curves import curves_of
from hoi_retarget.studio.scene.marks import ARROW_LENGTH, LEVELS, force_arrows, inside_marks
from hoi_retarget.studio.scene.scene import FORCES, REFERENCE, SceneItem, make_scene
from plain_motions import plain_motion, standing_qpos
from synthetic import make
from test_certificate import stood
from test_scene import G1, motion_of
from trajectories import random_qpos

CLIP = make("carry_box", seconds=0.5, fps=10.0)
GEOMETRY = CLIP.objects[0].geometry
SIDE = float(GEOMETRY.points[:, 1].min())  # Of the box, next to the left hand when that is at its right [m].


def placed(palm_to_box, *, height: float = 1.0):
    """A robot that stands high above the floor, with its left palm at a place of an unturned box."""
    motion = motion_of(CLIP, 0)
    qpos = np.tile(G1.home_qpos, (motion.frames, 1))
    qpos[:, 2] += height
    motion = motion.with_qpos(qpos)
    palm = G1.forward(qpos).site_position("left_palm")
    upright = np.tile(se3.IDENTITY_QUAT, (motion.frames, 1, 1))
    box = palm - np.asarray(palm_to_box)
    return replace(motion, object_pos=box[:, None], object_quat=upright, object_scale=np.ones(1))


def seen(motion, frame=0) -> np.ndarray:
    parts = inside_marks(motion, G1, (GEOMETRY,))
    return np.concatenate([np.zeros((0, 3)), *(part.positions[frame][part.visible[frame]] for part in parts)])


def test_nothing_is_marked_where_nothing_is_inside():
    motion = placed((0.0, 3.0, 0.0))
    assert inside_marks(motion, G1, (GEOMETRY,)) == ()
    assert inside_marks(motion, G1, None) == ()


@pytest.mark.parametrize(("x", "z", "depth"), [(0.0, 0.0, 0.001), (0.1, -0.05, 0.03), (-0.1, 0.03, -0.01)])
def test_dots_lie_on_the_surface_that_the_hand_is_under(x, z, depth):
    motion = placed((x, SIDE + depth, z))
    dots = seen(motion) - motion.object_pos[0, 0]
    assert len(dots), "the back of the hand is behind the palm's site"
    assert surface_of(GEOMETRY).distances(dots).max() < 1e-5
    assert np.abs(dots[:, [0, 2]] - [x, z]).max() < 0.25, "by the hand"


def test_deeper_places_have_deeper_colours():
    shallow, deep = (inside_marks(placed((0.0, SIDE + depth, 0.0)), G1, (GEOMETRY,)) for depth in (-0.02, 0.06))

    def share_of_deepest(parts) -> float:
        counts = {tuple(part.colours[0].tolist()): part.visible[0].sum() for part in parts}
        return counts.get(LEVELS[-1][1], 0) / sum(counts.values())

    assert share_of_deepest(deep) > share_of_deepest(shallow)


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), height=st.sampled_from([0.3, 5.0]))
def test_the_deepest_colour_is_of_the_depth_that_figures_say(seed, height):
    rng = np.random.default_rng(seed)
    motion = placed(rng.uniform(-0.4, 0.4, 3))
    qpos = random_qpos(G1, motion.frames, rng)
    qpos[:, 2] = height
    motion = replace(motion.with_qpos(qpos), object_pos=qpos[:, None, :3] + rng.uniform(-0.4, 0.4, 3))
    parts = inside_marks(motion, G1, (GEOMETRY,))
    (curve,) = (curve for curve in curves_of(motion, G1, (GEOMETRY,)) if curve.group == "inside object")
    kinematics = G1.forward(qpos)
    in_floor = -link_heights(kinematics).min(axis=0)
    deepest = np.max([1e-3 * curve.values, self_depths(kinematics)[0], in_floor], axis=0)
    bounds = [*(least for least, _ in LEVELS), np.inf]
    for frame, depth in enumerate(deepest):
        seen = {tuple(part.colours[0].tolist()) for part in parts if part.visible[frame].any()}
        for (least, colour), most in zip(LEVELS, bounds[1:], strict=True):
            if least <= depth < most:
                assert colour in seen, "the deepest place has its colour"
            if depth < least:
                assert colour not in seen, "and none is deeper"


def test_a_hand_in_the_thigh_is_marked_on_the_thigh():
    motion = placed((0.0, 3.0, 0.0))
    assert inside_marks(motion, G1, None) == (), "nothing at home"
    qpos = motion.qpos.copy()
    bent = {"left_shoulder_roll_joint": -0.5, "left_shoulder_pitch_joint": 0.3, "left_elbow_joint": 1.5}
    for joint, angle in bent.items():
        qpos[1:, 7 + G1.joint_names.index(joint)] = angle
    motion = motion.with_qpos(qpos)
    assert not len(seen(motion, 0)) and len(seen(motion, 1))
    poses = [(skin, RigidPoses.of_link(G1.forward(qpos[1:2]), skin)) for skin in skin_of(G1).links]
    skins = [skin.points @ pose.rotations[0].T + pose.positions[0] for skin, pose in poses]
    assert KDTree(np.concatenate(skins)).query(seen(motion, 1))[0].max() < 1e-5


@pytest.mark.parametrize(("lower", "marked"), [(0.0, False), (0.05, True)])
def test_the_floor_counts(lower, marked):
    motion = placed((0.0, 3.0, 0.0))
    qpos = motion.qpos.copy()
    soles = [f"{side}_sole_{end}" for side in ("left", "right") for end in ("heel_inner", "toe_inner")]
    lowest = min(G1.forward(qpos).site_position(sole)[:, 2].min() for sole in soles)
    qpos[:, 2] -= lowest + lower - 0.005
    dots = seen(motion.with_qpos(qpos))
    assert bool(len(dots)) is marked
    assert not dots[:, 2].any(), "they lie on the floor"


@pytest.mark.parametrize("off", [-0.02, 0.0, 0.03])
def test_the_curve_of_a_hand_is_its_distance_from_the_surface(off):
    """The hand reaches over a side of the box by its thickness, which moves with it."""
    flags = np.zeros((CLIP.frames, 4), dtype=bool)
    gaps = []
    for depth in (0.0, off):
        motion = placed((0.0, SIDE - 0.2 + depth, 0.0))
        active = flags.copy()
        active[1:, motion.contact_links.index("left_palm")] = True
        points = np.where(active[..., None], np.zeros(3), np.nan)
        motion = replace(motion, contact_flags=active, contact_object=np.where(active, 0, -1), contact_points=points)
        curves = curves_of(motion, G1, (GEOMETRY,))
        (curve,) = (curve for curve in curves if curve.group == "surface gap")
        assert (curve.name, curve.unit) == ("left_hand", "mm")
        assert np.isnan(curve.values[0]) and np.isfinite(curve.values[1:]).all()
        gaps.append(curve.values[1])
    assert gaps[0] > 100.0
    assert gaps[0] - gaps[1] == pytest.approx(1e3 * off, abs=1.0)


def test_the_curve_of_depth_is_that_of_the_deepest_dot():
    motion = placed((0.0, SIDE + 0.02, 0.0))
    (curve,) = (curve for curve in curves_of(motion, G1, (GEOMETRY,)) if curve.group == "inside object")
    assert (curve.values > 15.0).all()
    (away,) = (curve for curve in curves_of(placed((0.0, 3.0, 0.0)), G1, (GEOMETRY,)) if curve.group == "inside object")
    assert not away.values.any()


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
