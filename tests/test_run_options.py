"""The words that ask for a `run` again ask for the same one."""

from pathlib import Path

import tyro
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.cli.commands import AnyCommand, Run
from hoi_retarget.cli.run_options import arguments_of, config_of, to_argv
from hoi_retarget.retargeting.config import Scaling

PATHS = st.sampled_from(["a.pt", "it's one.pt", "builtin:carry_box", "folder/ü b.pt"]).map(Path)
SCALES = st.sampled_from(["auto", 0.75, 1.0])
SETTINGS = {
    "clips": st.lists(PATHS, min_size=1, max_size=3).map(tuple),
    "out": PATHS,
    "robot": st.sampled_from(["unitree_g1", "unitree_h2"]),
    "objects": st.none() | PATHS,
    "object_name": st.none() | st.sampled_from(["box", "a b"]),
    "edits": st.none() | PATHS,
    "scaling": st.builds(Scaling, SCALES, SCALES, st.sampled_from([0.5, 1.0])),
    "horizon": st.sampled_from(["auto", "whole", "windowed:60:15"]),
}


@settings(max_examples=10, deadline=None)
@given(st.fixed_dictionaries(SETTINGS))
def test_words_parse_to_the_run_they_are_of(asked):
    run = Run(**asked)
    words = to_argv(arguments_of(run), config_of(run).as_json())
    assert tyro.cli(AnyCommand, args=words, config=(tyro.conf.OmitSubcommandPrefixes,)) == run


def test_only_names_of_paths_are_shown_where_that_is_asked_for():
    run = Run(clips=(Path("/home/jane/a.pt"),), out=Path("/data/out"), objects=Path("/home/jane/objects"))
    words = to_argv(arguments_of(run), shown=lambda path: Path(path).name)
    assert words == ["run", "a.pt", "--objects", "objects", "--out", "out"]


def test_settings_of_another_version_are_left_out():
    assert to_argv({"clips": "no list", "nonsense": 1}) == ["run"]
