"""Results that are shown together have different names, and short ones where they can."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from export_motions import SOURCE, smooth_motion
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.motion_report import Report
from hoi_retarget.studio.scene.subplots import titles_of
from trajectories import MODELS


@pytest.fixture(scope="module")
def motions() -> dict[str, Motion]:
    """Motions of two robots, and an edited one of one of them."""
    edited = Report(source=replace(SOURCE, contact_edits="all contacts are fixed"))
    return {
        "G1": smooth_motion(MODELS["unitree_g1"]),
        "H2": smooth_motion(MODELS["unitree_h2"]),
        "edited": smooth_motion(MODELS["unitree_g1"], report=edited),
    }


@pytest.mark.parametrize(
    ("results", "titles"),
    [
        ([("a/one.npz", "G1"), ("a/two.npz", "G1")], ("one", "two")),
        ([("a/one.npz", "G1"), ("b/one.npz", "H2")], ("G1", "H2")),
        ([("a/one.npz", "G1"), ("b/one.npz", "edited")], ("as recorded", "edited")),
        ([("a/one.npz", "G1"), ("b/one.npz", "G1"), ("b/two.npz", "H2")], ("one, a", "one, b", "two")),
        ([("a/x/one.npz", "G1"), ("b/x/one.npz", "G1")], ("a/x/one.npz", "b/x/one.npz")),
    ],
)
def test_names_say_what_tells_results_apart(motions, results, titles):
    assert titles_of([(Path(path), motions[name]) for path, name in results]) == titles


PATHS = st.lists(st.sampled_from("abc"), min_size=2, max_size=3).map(lambda names: Path(*names).with_suffix(".npz"))


@given(st.lists(PATHS, min_size=1, max_size=6, unique=True), st.data())
def test_no_two_results_have_one_name(motions, paths, data):
    drawn = [motions[data.draw(st.sampled_from(sorted(motions)))] for _ in paths]
    titles = titles_of(list(zip(paths, drawn, strict=True)))
    assert len(set(titles)) == len(paths)
