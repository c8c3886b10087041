"""Results that are shown together have different names, and short ones where they can."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoi_retarget.clip.edits import ContactEdits, FixAll, apply
from hoi_retarget.motion.motion import Motion
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.studio.scene.subplots import titles_of
from hoi_retarget.synthetic import make
from trajectories import MODELS


@pytest.fixture(scope="module")
def motions() -> dict[str, Motion]:
    """One clip for two robots, and edited for one of them."""
    clip = make("carry_box", seconds=0.5)
    edited = apply(clip, ContactEdits.of(clip).adding(FixAll()))
    return {
        "G1": retarget(clip, MODELS["unitree_g1"], Config()),
        "H2": retarget(clip, MODELS["unitree_h2"], Config()),
        "edited": retarget(edited, MODELS["unitree_g1"], Config()),
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
