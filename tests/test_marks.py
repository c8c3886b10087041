"""Dots where a robot is inside something: as deep as it is, on the surface, and none where it is not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from hoi_retarget.evaluation.comparison import RigidPoses
from hoi_retarget.evaluation.penetration import self_depths
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.robots.skin import link_heights, skin_of
from hoi_retarget.studio.scene.curves import curves_of
from hoi_retarget.studio.scene.marks import LEVELS, inside_marks
from hoi_retarget.synthetic import make
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
