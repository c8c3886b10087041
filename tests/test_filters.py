"""Fading, smoothing, and what is nearest in time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import (
    nearest_active,
    savitzky_golay,
    seconds_to_frames,
    smooth,
    smooth_quats,
    smoothstep_around,
)

FPS, WINDOW = 30.0, 11  # At 30 frames a second the filter sees 11 frames.

LAWS = settings(max_examples=60, deadline=None, derandomize=True, database=None)
flags = st.lists(st.booleans(), min_size=1, max_size=40).map(np.array)
active_flags = flags.filter(lambda active: active.any())


def distance(active: np.ndarray) -> np.ndarray:
    """Return how far the nearest active frame is, by trying all."""
    frames = np.flatnonzero(active)
    return np.abs(np.arange(len(active))[:, None] - frames[None]).min(axis=1)


@LAWS
@given(active=active_flags)
def test_nearest_active_is_active_nearest_and_the_earlier_of_two(active):
    nearest = nearest_active(active)
    assert active[nearest].all()
    time = np.arange(len(active))
    np.testing.assert_array_equal(np.abs(nearest - time), distance(active))
    other = 2 * time - nearest  # As far away on the other side.
    later = nearest > time
    earlier = other[later & (other >= 0)]
    assert not active[earlier].any()


@LAWS
@given(active=active_flags, ramp=st.integers(0, 15))
def test_fade_is_one_inside_and_falls_to_zero_with_the_distance(active, ramp):
    weights, away = smoothstep_around(active, ramp), distance(active)
    assert ((weights >= 0) & (weights <= 1)).all()
    np.testing.assert_array_equal(weights[active], 1.0)
    np.testing.assert_allclose(weights[away > ramp], 0.0, atol=1e-15)
    assert (weights[away <= ramp] > 0).all(), "the ramp uses all its frames"
    order = np.argsort(away, kind="stable")
    assert (np.diff(weights[order]) <= 0).all()
    between = (away > 0) & (away <= ramp)
    assert (weights[between] < 1).all()


@LAWS
@given(active=active_flags, ramp=st.integers(0, 15), before=st.integers(0, 20), after=st.integers(0, 20))
def test_fade_is_the_same_backwards_and_depends_on_nothing_far_away(active, ramp, before, after):
    np.testing.assert_allclose(smoothstep_around(active[::-1], ramp)[::-1], smoothstep_around(active, ramp), atol=1e-15)
    # Other contacts further away than two ramps change nothing near these.
    room = 2 * ramp + 1
    longer = np.concatenate([np.ones(before), np.zeros(room), active, np.zeros(room), np.ones(after)]).astype(bool)
    inner = slice(before + room, before + room + len(active))
    near = distance(active) <= ramp
    np.testing.assert_allclose(
        smoothstep_around(longer, ramp)[inner][near], smoothstep_around(active, ramp)[near], atol=1e-15
    )


def test_fade_halves_in_the_middle_of_its_ramp():
    active = np.zeros(9, dtype=bool)
    active[0] = True
    np.testing.assert_allclose(
        smoothstep_around(active, 3)[:5], [1.0, 0.5 + 0.25 * np.sqrt(2), 0.5, 0.5 - 0.25 * np.sqrt(2), 0.0]
    )


@pytest.mark.parametrize("frames", [1, 5])
def test_fade_without_contact_is_zero(frames):
    np.testing.assert_array_equal(smoothstep_around(np.zeros(frames, dtype=bool), 3), 0.0)


@LAWS
@given(frames=st.integers(5, 60), seed=st.integers(0, 1000))
def test_smoothing_leaves_cubic_polynomials_unchanged(frames, seed):
    time = np.linspace(-1.0, 1.0, frames)
    path = np.polynomial.polynomial.polyval(time, np.random.default_rng(seed).normal(size=(4, 3))).T
    np.testing.assert_allclose(smooth(path, FPS), path, atol=1e-10)


@LAWS
@given(frames=st.integers(WINDOW, 60), seed=st.integers(0, 1000))
def test_smoothing_is_linear_local_and_blind_to_direction(frames, seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, frames, 2))
    np.testing.assert_allclose(smooth(2.0 * a - b, FPS), 2.0 * smooth(a, FPS) - smooth(b, FPS), atol=1e-10)
    np.testing.assert_allclose(smooth(a[::-1], FPS)[::-1], smooth(a, FPS), atol=1e-10)
    bump = a.copy()
    bump[0] += 1.0
    np.testing.assert_allclose(smooth(bump, FPS)[WINDOW:], smooth(a, FPS)[WINDOW:], atol=1e-12)


def test_smoothing_removes_most_of_white_noise():
    noise = np.random.default_rng(0).normal(size=(500, 1))
    assert smooth(noise, FPS)[20:-20].std() < 0.6 * noise.std()


@pytest.mark.parametrize("frames", [1, 2, 3, 4])
def test_paths_too_short_for_the_filter_stay_and_are_copied(frames):
    path = np.random.default_rng(0).normal(size=(frames, 3))
    smoothed = smooth(path, FPS)
    np.testing.assert_array_equal(smoothed, path)
    assert not np.shares_memory(smoothed, path)


@LAWS
@given(seed=st.integers(0, 1000), frames=st.integers(1, 40))
def test_smoothed_rotations_are_unit_and_blind_to_signs_and_to_the_world(seed, frames):
    rng = np.random.default_rng(seed)
    quats = se3.exp(rng.normal(size=3) + np.cumsum(0.05 * rng.normal(size=(frames, 3)), axis=0))
    smoothed = smooth_quats(quats, FPS)
    np.testing.assert_allclose(np.linalg.norm(smoothed, axis=1), 1.0, atol=1e-12)
    flipped = quats * rng.choice([-1.0, 1.0], size=(frames, 1))
    assert se3.angle_between(smooth_quats(flipped, FPS), smoothed).max() < 1e-7
    turn = se3.exp(rng.normal(size=3))[None]
    turned = smooth_quats(se3.quat_multiply(turn, quats), FPS)
    assert se3.angle_between(turned, se3.quat_multiply(turn, smoothed)).max() < 1e-7


def test_a_constant_turn_is_not_smoothed_away():
    quats = se3.exp(np.linspace(0.0, 2.0, 60)[:, None] * np.array([0.0, 0.6, 0.8]))
    assert se3.angle_between(smooth_quats(quats, FPS), quats).max() < 1e-4


@pytest.mark.parametrize(
    ("seconds", "fps", "frames"),
    [(0.4, 30.0, 12), (1 / 30, 30.0, 1), (0.4, 120.0, 48), (0.0, 30.0, 1), (0.01, 25.0, 1)],
)
def test_durations_take_at_least_one_frame(seconds, fps, frames):
    assert seconds_to_frames(seconds, fps) == frames


@LAWS
@given(seed=st.integers(0, 10_000), half=st.integers(1, 8), derivative=st.integers(0, 2))
def test_the_filter_is_that_of_scipy(seed, half, derivative):
    rng = np.random.default_rng(seed)
    window = 2 * half + 1
    order = int(rng.integers(derivative, min(window, 5)))
    path = rng.normal(size=(window + int(rng.integers(0, 30)), 3))
    expected = savgol_filter(path, window, order, deriv=derivative, delta=0.1, axis=0)
    np.testing.assert_allclose(savitzky_golay(path, window, order, derivative, 0.1), expected, atol=1e-7)
