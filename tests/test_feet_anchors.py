"""Feet keep one place while they stand, wherever the clip begins, and move from and to it smoothly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget import Config, retarget
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import seconds_to_frames
from hoi_retarget.retargeting.config import Scaling
from hoi_retarget.retargeting.feet import RAMP_SECONDS, Foot, anchor, anchor_weights, plant
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.synthetic import make
from test_feet import FPS, every_foot, lowest_corner, turns, walk
from trajectories import MODELS

LAWS = settings(max_examples=25, deadline=None, derandomize=True, database=None)
RAMP = seconds_to_frames(RAMP_SECONDS, FPS)
FOOT = Foot.of(MODELS["unitree_g1"], "left")


def planted(foot: Foot, seed: int, **how: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a planted foot that stands, swings and stands again, and its stance flags."""
    toes, quats, stands = walk(seed, **how)
    return *plant(foot, toes, quats, stands, FPS), stands


def standing(foot: Foot, yaw: np.ndarray, pitch: np.ndarray, ball: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the contact site of a foot on the floor that never leaves it."""
    quats = turns(yaw=yaw, pitch=pitch)
    positions = np.column_stack([ball, np.zeros(len(ball))]) - se3.rotate(quats, foot.toe)
    positions[:, 2] = -foot.lowest(se3.quat_to_matrix(quats))
    return anchor(foot, positions, quats, np.ones(len(ball), bool), FPS)


@every_foot
@LAWS
@given(seed=st.integers(0, 1000))
def test_a_standing_foot_has_one_place_and_a_flat_sole(foot, seed):
    positions, quats, stands = planted(foot, seed)
    held, turned = anchor(foot, positions, quats, stands, FPS)
    sole = foot.corners[:, 2] - foot.corners[:, 2].min()
    for run in np.split(np.flatnonzero(stands), np.flatnonzero(np.diff(np.flatnonzero(stands)) > 1) + 1):
        assert np.ptp(held[run], axis=0).max() < 1e-9
        corners = held[run, None] + se3.rotate(turned[run, None], foot.corners[None])
        np.testing.assert_allclose(corners[..., 2], np.broadcast_to(sole, corners.shape[:2]), atol=1e-9)
        assert np.linalg.norm(held[run, :2] - positions[run, :2], axis=1).min() < 0.02


@every_foot
@LAWS
@given(seed=st.integers(0, 1000))
def test_the_lowest_corner_keeps_its_height(foot, seed):
    positions, quats, stands = planted(foot, seed)
    held, turned = anchor(foot, positions, quats, stands, FPS)
    np.testing.assert_allclose(lowest_corner(foot, held, turned), lowest_corner(foot, positions, quats), atol=1e-9)


@LAWS
@given(seed=st.integers(0, 1000), first=st.integers(1, 40))
def test_it_does_not_matter_where_the_clip_begins_within_a_swing(seed, first):
    positions, quats, stands = planted(FOOT, seed)
    stands[:45] = False
    whole = anchor(FOOT, positions, quats, stands, FPS)
    cut = anchor(FOOT, positions[first:], quats[first:], stands[first:], FPS)
    for one, other in zip(whole, cut, strict=True):
        np.testing.assert_allclose(other, one[first:], atol=1e-12)


@LAWS
@given(seed=st.integers(0, 1000))
def test_backwards_in_time_and_in_a_mirror_the_same_happens(seed):
    positions, quats, stands = planted(FOOT, seed)
    held, turned = anchor(FOOT, positions, quats, stands, FPS)
    back, turned_back = anchor(FOOT, positions[::-1], quats[::-1], stands[::-1], FPS)
    np.testing.assert_allclose(back[::-1], held, atol=1e-12)
    np.testing.assert_allclose(se3.angle_between(turned_back[::-1], turned), 0.0, atol=1e-6)
    flip = np.array([1.0, -1.0, 1.0])
    mirrored_foot = Foot(FOOT.toe * flip, FOOT.corners * flip)
    mirror, turned_mirror = anchor(mirrored_foot, positions * flip, se3.quat_mirrored(quats), stands, FPS)
    np.testing.assert_allclose(mirror * flip, held, atol=1e-12)
    np.testing.assert_allclose(se3.angle_between(se3.quat_mirrored(turned_mirror), turned), 0.0, atol=1e-6)


@LAWS
@given(seed=st.integers(0, 1000))
def test_far_from_its_stance_a_foot_moves_as_before_and_leaves_it_at_rest(seed):
    positions, quats, stands = planted(FOOT, seed)
    stands[45:] = False
    held, _ = anchor(FOOT, positions, quats, stands, FPS)
    last = np.flatnonzero(stands)[-1]
    np.testing.assert_array_equal(held[last + RAMP + 1 :, :2], positions[last + RAMP + 1 :, :2])
    before, after = (np.linalg.norm(path[last + 1, :2] - path[last, :2]) for path in (positions, held))
    assert after < 0.25 * before + 1e-4


def test_a_foot_that_pivots_turns_about_its_ball():
    yaw = np.linspace(0.0, np.pi / 2, 60)
    held, turned = standing(FOOT, yaw, np.zeros(60), np.zeros((60, 2)))
    np.testing.assert_allclose(se3.angle_between(turned, turns(yaw=yaw)), 0.0, atol=1e-6)
    np.testing.assert_allclose((held + se3.rotate(turned, FOOT.toe))[:, :2], 0.0, atol=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["heel", "toes"])
def test_a_foot_that_rises_far_stands_on_the_edge_of_its_sole(sign):
    pitch = sign * np.radians(50.0) * np.sin(np.linspace(0.0, np.pi, 60)) ** 2
    held, turned = standing(FOOT, np.zeros(60), pitch, np.zeros((60, 2)))
    ahead = FOOT.corners[:, 0] == (FOOT.corners[:, 0].max() if sign > 0 else FOOT.corners[:, 0].min())
    edge = held[:, None] + se3.rotate(turned[:, None], FOOT.corners[None, ahead])
    assert np.ptp(edge, axis=0).max() < 1e-9
    assert np.ptp(held[:, 2]) > 0.02, "it rises"


def test_a_foot_that_is_dragged_is_followed():
    ball = np.column_stack([np.linspace(0.0, 0.5, 60), np.zeros(60)])
    held, turned = standing(FOOT, np.zeros(60), np.zeros(60), ball)
    np.testing.assert_allclose((held + se3.rotate(turned, FOOT.toe))[:, :2], ball, atol=1e-9)


def test_weights_are_full_within_a_stance_and_fade_towards_its_ends_alone():
    stands = np.zeros(90, bool)
    stands[30:70] = True
    weights = anchor_weights(stands, FPS)
    assert (weights[~stands] == 0).all()
    assert (weights[36:64] == 1).all()
    assert 0 < weights[30] < weights[31] < weights[33] < 1
    assert (anchor_weights(np.ones(9, bool), FPS) == 1).all(), "a clip's ends are no ends of a stance"


@pytest.mark.slow
def test_robots_feet_stand_and_those_of_landmark_contact_are_left_alone():
    clip, model = make("carry_box"), MODELS["unitree_g1"]
    surface, landmark = (retarget(clip, model, Config(contact=kind)).report.figures for kind in ("surface", "landmark"))
    assert landmark["stance_slide_mps"] > 0.02
    assert surface["stance_slide_mps"] < 0.01
    assert surface["stance_sole_height_abs_m"] < 0.0005
    assert not make_targets(clip, model, Scaling(), contact="landmark").anchor_weights.any()
