"""Laws of runs, of evenly chosen indices and of the checks of arrays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoi_retarget.errors import ClipError
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import (
    REPEATED,
    check_finite,
    check_shape,
    describe_frames,
    evenly_spaced,
    repeated,
    runs,
    unit_quats,
)

flags = st.lists(st.booleans(), max_size=40).map(lambda values: np.array(values, dtype=bool))


@given(count=st.integers(2, 300), most=st.integers(2, 60))
def test_evenly_chosen_indices_go_from_the_first_to_the_last_in_equal_steps(count, most):
    chosen = evenly_spaced(count, most)
    assert chosen[0] == 0 and chosen[-1] == count - 1
    assert len(chosen) == min(count, most)
    assert np.ptp(np.diff(chosen)) <= 1


def test_one_index_of_many_is_the_first():
    assert evenly_spaced(7, 1).tolist() == evenly_spaced(1, 7).tolist() == [0]


@given(active=flags, shortest=st.integers(1, 5))
def test_runs_hold_all_active_frames_but_those_of_shorter_ones(active, shortest):
    found = runs(active, shortest)
    assert all(stop - first >= shortest and active[first:stop].all() for first, stop in found)
    ends = [(first - 1, stop) for first, stop in found]
    assert not any(active[end] for pair in ends for end in pair if 0 <= end < len(active))
    within = np.zeros(len(active), dtype=bool)
    for first, stop in found:
        within[first:stop] = True
    assert all(stop - first < shortest for first, stop in runs(active & ~within))


@pytest.mark.parametrize(
    ("frames", "text"), [([4], "1 frame (4)"), ([4, 7], "2 frames (4, 7)"), (range(5), "5 frames (0, 1, 2, 3, 4)")]
)
def test_frames_are_listed(frames, text):
    assert describe_frames(np.array(frames)) == text


def test_five_frames_of_many_are_listed():
    assert describe_frames(np.arange(3, 9)) == "6 frames (3, 4, 5, 6, 7, ...)"


def test_a_row_repeats_the_one_before_it_when_no_number_changes():
    steps = np.array([[0.0, 0.0], [0.5 * REPEATED, -0.5 * REPEATED], [2 * REPEATED, 0.0], [0.0, -2 * REPEATED]])
    np.testing.assert_array_equal(repeated(np.cumsum(steps, axis=0)), [True, False, False])


def test_arrays_of_wrong_shape_or_without_numbers_name_their_owner_and_frames():
    check_shape("a person", "positions", np.zeros((4, 3)), (4, 3))
    with pytest.raises(ClipError, match=r"a person: positions has shape \(4, 3\), expected \(4, 2\)"):
        check_shape("a person", "positions", np.zeros((4, 3)), (4, 2))
    good, bad = np.zeros((4, 3, 2)), np.zeros((4, 3, 2))
    check_finite("a person", {"positions": good})
    bad[1, 2, 0], bad[3, 0, 1] = np.nan, np.inf
    with pytest.raises(ClipError, match=r"a person: quats is not finite in 2 frames \(1, 3\)"):
        check_finite("a person", {"positions": good, "quats": bad})


@given(seed=st.integers(0, 1000), frame=st.integers(0, 9))
def test_rotations_of_almost_unit_length_get_it_and_others_are_refused(seed, frame):
    rng = np.random.default_rng(seed)
    exact = se3.exp(rng.normal(size=(10, 3)))
    lengths = rng.uniform(0.9901, 1.0099, (10, 1))
    np.testing.assert_allclose(unit_quats("a person", "quats", lengths * exact), exact, atol=1e-12)
    for factor in (0.98, 1.02):
        damaged = exact.copy()
        damaged[frame] *= factor
        with pytest.raises(ClipError, match=rf"a person: quats are not unit quaternions in 1 frame \({frame}\)"):
            unit_quats("a person", "quats", damaged)
