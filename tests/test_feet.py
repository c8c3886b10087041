"""Feet: flat and on the floor in stance, never under it, anchored to one place, and as captured everywhere else."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget import Config, retarget
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import closed_and_opened, seconds_to_frames, smooth, smooth_quats
from hoi_retarget.retargeting.config import Scaling
from hoi_retarget.retargeting.feet import (
    LARGEST_TILT,
    RAMP_SECONDS,
    Foot,
    anchor,
    anchor_weights,
    plant,
    resting_height,
    resting_tilt,
)
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.robots.spec import SIDES
from synthetic import make
from trajectories import MODELS

LAWS = settings(max_examples=40, deadline=None, derandomize=True, database=None)
FPS = 30.0
RAMP = seconds_to_frames(RAMP_SECONDS, FPS)
FEET = {(name, side): Foot.of(model, side) for name, model in MODELS.items() for side in SIDES}
every_foot = pytest.mark.parametrize("foot", FEET.values(), ids=["-".join(key) for key in FEET])


def turns(*, yaw: np.ndarray | float = 0.0, pitch: np.ndarray | float = 0.0, roll: np.ndarray | float = 0.0):
    """Return rotations by yaw, then pitch, then roll about the foot's own axes [rad]."""
    yaw, pitch, roll = np.broadcast_arrays(*np.atleast_1d(yaw, pitch, roll))
    zero = np.zeros_like(yaw, dtype=float)
    about = [np.stack([zero, zero, yaw], axis=-1), np.stack([zero, pitch, zero], -1), np.stack([roll, zero, zero], -1)]
    z, y, x = (se3.exp(vector) for vector in about)
    return se3.quat_multiply(z, se3.quat_multiply(y, x))


def walk(seed: int, frames: int = 90, *, flat: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return toe path, rotations and stance flags of a foot that stands, swings and stands again."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 1.0, frames)
    swing = np.clip((time - 0.35) / 0.3, 0.0, 1.0)
    toes = np.column_stack([0.6 * swing, 0.1 * np.sin(3 * time), 0.03 + 0.3 * np.sin(np.pi * swing) ** 2])
    toes += rng.normal(size=3) * np.array([1.0, 1.0, 0.01])
    pitch = 0.0 if flat else 0.02 + 0.8 * np.sin(2 * np.pi * swing)
    roll = 0.0 if flat else 0.05 * rng.normal()
    return toes, turns(yaw=rng.uniform(-3, 3) + 0.3 * time, pitch=pitch, roll=roll), (swing == 0) | (swing == 1)


def lowest_corner(foot: Foot, positions: np.ndarray, quats: np.ndarray) -> np.ndarray:
    corners = positions[:, None] + se3.rotate(quats[:, None], foot.corners[None])
    return corners[..., 2].min(axis=1)


@every_foot
@LAWS
@given(seed=st.integers(0, 1000), flat=st.booleans())
def test_the_lowest_corner_is_on_the_floor_in_stance_and_never_under_it(foot, seed, flat):
    toes, quats, stands = walk(seed, flat=flat)
    positions, rotations = plant(foot, toes, quats, stands, FPS)
    height = lowest_corner(foot, positions, rotations)
    assert np.abs(height[stands]).max() < 1e-9
    assert height.min() > -1e-9
    assert height.max() > 0.05, "the swing must not be flattened"


@every_foot
@LAWS
@given(seed=st.integers(0, 1000))
def test_a_flat_foot_has_all_corners_of_its_sole_plane_on_the_floor(foot, seed):
    toes, quats, stands = walk(seed, flat=True)
    positions, rotations = plant(foot, toes, quats, stands, FPS)
    corners = positions[:, None] + se3.rotate(rotations[:, None], foot.corners[None])
    sole = foot.corners[:, 2] - foot.corners[:, 2].min()
    np.testing.assert_allclose(corners[stands, :, 2], np.broadcast_to(sole, (stands.sum(), 4)), atol=1e-9)


@every_foot
@LAWS
@given(seed=st.integers(0, 1000))
def test_far_from_stance_the_smoothed_path_is_kept(foot, seed):
    """The site is where toe and rotation put it once the ramps are over."""
    toes, quats, stands = walk(seed, frames=180)
    toes[:, 2] += 0.2  # Above the floor in every pose.
    positions, rotations = plant(foot, toes, quats, stands, FPS)
    away = np.abs(np.arange(len(toes))[:, None] - np.flatnonzero(stands)[None]).min(axis=1) > RAMP
    assert away.sum() > 10
    assert se3.angle_between(rotations[away], smooth_quats(quats, FPS)[away]).max() < 1e-9
    toe = positions + se3.rotate(rotations, foot.toe[None])
    np.testing.assert_allclose(toe[away], smooth(toes, FPS)[away], atol=1e-9)
    np.testing.assert_allclose(
        toe[:, :2], smooth(toes, FPS)[:, :2], atol=1e-9, err_msg="sideways the toe is never moved"
    )


@every_foot
@LAWS
@given(seed=st.integers(0, 1000), yaw=st.floats(-3.0, 3.0), x=st.floats(-2.0, 2.0))
def test_planting_does_not_depend_on_place_and_heading(foot, seed, yaw, x):
    toes, quats, stands = walk(seed)
    turn, shift = turns(yaw=yaw), np.array([x, -x, 0.0])
    positions, rotations = plant(foot, toes, quats, stands, FPS)
    moved = plant(foot, se3.rotate(turn, toes) + shift, se3.quat_multiply(turn, quats), stands, FPS)
    np.testing.assert_allclose(moved[0], se3.rotate(turn, positions) + shift, atol=1e-9)
    assert se3.angle_between(moved[1], se3.quat_multiply(turn, rotations)).max() < 1e-7


@pytest.mark.parametrize("model", MODELS.values(), ids=list(MODELS))
@LAWS
@given(seed=st.integers(0, 1000))
def test_left_and_right_are_mirror_images(model, seed):
    left, right = (Foot.of(model, side) for side in SIDES)
    mirror = np.array([1.0, -1.0, 1.0])
    np.testing.assert_allclose(sorted(map(tuple, left.corners)), sorted(map(tuple, right.corners * mirror)), atol=1e-6)
    toes, quats, stands = walk(seed)
    reflected = quats * np.array([1.0, -1.0, 1.0, -1.0])
    positions, rotations = plant(left, toes, quats, stands, FPS)
    mirrored = plant(right, toes * mirror, reflected, stands, FPS)
    np.testing.assert_allclose(mirrored[0], positions * mirror, atol=1e-6)
    assert se3.angle_between(mirrored[1], rotations * np.array([1.0, -1.0, 1.0, -1.0])).max() < 1e-6


@every_foot
def test_a_tiptoe_stance_keeps_its_pitch_and_touches_with_the_toes(foot):
    toes, quats, stands = walk(0, flat=True)
    steep = se3.quat_multiply(quats, turns(pitch=0.5))
    positions, rotations = plant(foot, toes, steep, stands, FPS)
    assert se3.angle_between(rotations[stands], steep[stands]).max() < 0.02
    assert np.abs(lowest_corner(foot, positions, rotations)[stands]).max() < 1e-9


@every_foot
@pytest.mark.parametrize("stands", [np.zeros(30, dtype=bool), np.ones(30, dtype=bool)], ids=["never", "always"])
def test_feet_that_never_or_always_stand(foot, stands):
    toes, quats, _ = walk(3, frames=30)
    positions, rotations = plant(foot, toes, quats, stands, FPS)
    height = lowest_corner(foot, positions, rotations)
    assert height.min() > -1e-9
    assert (np.abs(height).max() < 1e-9) == stands.all()


@every_foot
def test_short_clips_are_planted(foot):
    for frames in (1, 2, 4, 5):
        toes, quats, _ = walk(1, frames=frames)
        positions, rotations = plant(foot, toes, quats, np.ones(frames, dtype=bool), FPS)
        assert np.abs(lowest_corner(foot, positions, rotations)).max() < 1e-9


@every_foot
def test_the_toe_height_is_that_of_a_flat_foot(foot):
    positions = np.array([[0.0, 0.0, foot.toe_height]]) - foot.toe[None]
    assert lowest_corner(foot, positions, turns()) == pytest.approx(0.0, abs=1e-12)


# What a standing foot looks like


@LAWS
@given(pitch=st.floats(-0.25, 0.25), roll=st.floats(-0.25, 0.25), yaw=st.floats(-3.0, 3.0), share=st.floats(0.3, 1.0))
def test_a_constant_tilt_is_levelled(pitch, roll, yaw, share):
    """Whatever the foot does while it does not stand."""
    tilted = turns(yaw=yaw + np.linspace(0.0, 1.0, 40), pitch=pitch, roll=roll)
    stands = np.arange(40) < 40 * share
    tilted[~stands] = se3.exp(np.random.default_rng(0).normal(size=(40, 3)))[~stands]
    levelled = se3.quat_multiply(tilted, resting_tilt(tilted, stands)[None])[stands]
    up = se3.quat_to_matrix(levelled)[:, 2, 2]
    # Two angles about two axes are one rotation up to their product.
    assert np.degrees(np.arccos(np.clip(up, -1, 1))).max() < 0.3 + 57.3 * abs(pitch * roll) * 0.2


@LAWS
@given(pitch=st.floats(-1.2, 1.2), roll=st.floats(-1.2, 1.2))
def test_no_more_than_a_habit_is_levelled_and_no_heading_is_changed(pitch, roll):
    tilted = turns(yaw=np.zeros(5), pitch=pitch, roll=roll)
    vector = se3.log(resting_tilt(tilted, np.ones(5, dtype=bool)))
    assert np.abs(vector[:2]).max() <= LARGEST_TILT + 1e-9
    assert vector[2] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("axis", ["pitch", "roll"])
def test_a_foot_on_its_edge_is_levelled_by_a_habit(axis, sign):
    """Rounding makes the components of some unit vectors larger than one."""
    steep = turns(yaw=np.linspace(-3.0, 3.0, 600), **{axis: sign * np.pi / 2})
    vectors = np.array([se3.log(resting_tilt(quat[None], np.array([True]))) for quat in steep])
    expected = -sign * LARGEST_TILT * np.array([axis == "roll", axis == "pitch", 0.0])
    np.testing.assert_allclose(vectors, np.broadcast_to(expected, vectors.shape), atol=1e-9)


def test_a_foot_that_never_stands_is_not_levelled_and_rests_at_its_lowest():
    tilted, never = turns(pitch=np.full(5, 0.2)), np.zeros(5, dtype=bool)
    np.testing.assert_array_equal(resting_tilt(tilted, never), se3.IDENTITY_QUAT)
    assert resting_height(np.array([0.3, 0.1, 0.2]), never[:3]) == 0.1


def test_resting_height_is_the_median_of_stance():
    heights, stands = np.array([0.02, 0.03, 9.0, 0.9, 0.04]), np.array([1, 1, 1, 0, 1], dtype=bool)
    assert resting_height(heights, stands) == pytest.approx(0.035)


# Flicker


def runs(flags: np.ndarray) -> list[tuple[bool, int, int]]:
    edges = [0, *(np.flatnonzero(np.diff(flags.astype(int))) + 1), len(flags)]
    return [(bool(flags[a]), int(a), int(b)) for a, b in pairwise(edges)]


def steady_stance(flags: np.ndarray, shortest: int) -> np.ndarray:
    return closed_and_opened(flags, gap=shortest - 1, shortest=shortest)


flag_lists = st.lists(st.booleans(), min_size=1, max_size=60).map(np.array)


@LAWS
@given(flags=flag_lists, shortest=st.integers(1, 6))
def test_no_short_run_is_left_inside(flags, shortest):
    before = flags.copy()
    steady = steady_stance(flags, shortest)
    assert all(b - a >= shortest for _, a, b in runs(steady)[1:-1])
    np.testing.assert_array_equal(flags, before, err_msg="the input is left alone")
    np.testing.assert_array_equal(steady_stance(steady, shortest), steady)


@LAWS
@given(flags=flag_lists, shortest=st.integers(1, 6))
def test_long_runs_and_cut_ones_are_kept(flags, shortest):
    steady = steady_stance(flags, shortest)
    for state, first, stop in runs(flags):
        if state and stop - first >= shortest:
            assert steady[first:stop].all()
    if all(stop - first >= shortest for _, first, stop in runs(flags)[1:-1]):
        np.testing.assert_array_equal(steady, flags)
    np.testing.assert_array_equal(steady_stance(flags, 1), flags)


def test_gaps_are_closed_before_runs_are_dropped():
    flags = np.array([0, 0, 0, 0, 1, 1, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0], dtype=bool)
    expected = np.array([0, 0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0], dtype=bool)
    np.testing.assert_array_equal(steady_stance(flags, 3), expected)


@every_foot
@LAWS
@given(seed=st.integers(0, 1000), frame=st.integers(0, 89))
def test_one_flickering_label_moves_no_foot(foot, seed, frame):
    toes, quats, stands = walk(seed)
    flicker = stands.copy()
    flicker[frame] = ~flicker[frame]
    edge = np.flatnonzero(np.diff(stands.astype(int)))
    if np.abs(edge - frame).min() <= 3 or frame in (0, 89):
        return  # At an end of a run a switch is a later or an earlier step, not flicker.
    positions, rotations = plant(foot, toes, quats, stands, FPS)
    again = plant(foot, toes, quats, flicker, FPS)
    np.testing.assert_array_equal(again[0], positions)
    np.testing.assert_array_equal(again[1], rotations)


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
