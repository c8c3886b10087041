"""One configuration: the same from Python, a table, the command line and a result; wrong ones are refused in words."""

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import get_args

import numpy as np
import pytest
import tyro
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.cli import main
from hoi_retarget.cli.commands import Run
from hoi_retarget.cli.run_options import config_of
from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.motion.result_file import load, save
from hoi_retarget.retargeting.config import (
    Config,
    ContactKind,
    Horizon,
    IkConfig,
    IkWeights,
    Scaling,
    Weights,
    parse_horizon,
)
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.retargeting.trajopt.solvers.solver import SOLVERS, BandedInteriorPoint, KeepStart
from hoi_retarget.robots import robot
from hoi_retarget.robots.model import load_model
from synthetic import make

positive = st.floats(1e-6, 1e6)
weights = st.builds(Weights, **{item.name: st.floats(0, 1e6) for item in fields(Weights)})
solvers = st.builds(
    BandedInteriorPoint,
    max_iterations=st.integers(1, 500),
    tolerance=positive,
    step_tolerance=positive,
    fraction_to_boundary=st.floats(0.01, 0.999),
)
horizons = st.integers(2, 10**9).flatmap(
    lambda length: st.integers(0, length - 1).flatmap(
        lambda overlap: st.builds(Horizon, st.just(length), st.just(overlap), st.integers(0, overlap))
    )
)
scalings = st.builds(
    Scaling, st.just("auto") | positive, st.just("auto") | positive, positive, st.just("root") | positive
)
configs = st.builds(
    Config,
    scalings,
    weights,
    st.builds(IkConfig, st.builds(IkWeights, st.floats(0, 100)), st.integers(1, 50), solvers),
    solvers | st.just(KeepStart()),
    horizons,
    st.sampled_from(get_args(ContactKind)),
)


@settings(deadline=None)
@given(configs)
def test_a_table_of_a_configuration_is_the_configuration(config):
    assert Config.from_table(config.as_json(), "it") == config


@settings(deadline=None)
@given(horizons)
def test_a_horizons_text_is_the_horizon(horizon):
    assert parse_horizon(horizon.text) == horizon


def leaves(value, place=""):
    """Yield every single setting of a configuration as its place and its value."""
    for item in fields(value):
        inner = getattr(value, item.name)
        if is_dataclass(inner):
            yield from leaves(inner, f"{place}{item.name}.")
        else:
            yield f"{place}{item.name}", inner


CHOICES = {"surface": "landmark", "all": "fast", "touch": "simulated", "free": "fixed"}


def changed(config, place):
    """Return a configuration of which one number is another one."""
    head, _, rest = place.partition(".")
    inner = getattr(config, head)
    if rest:
        return replace(config, **{head: changed(inner, rest)})
    if inner in CHOICES:
        return replace(config, **{head: CHOICES[inner]})
    other = (
        0.5
        if isinstance(inner, str) or inner == 0
        else inner * (0.9 if isinstance(inner, float) else 1) + isinstance(inner, int)
    )
    return replace(config, **{head: other})


SETTINGS = [place for place, _ in leaves(Config()) if not place.startswith("horizon")]


@pytest.mark.parametrize("place", SETTINGS)
def test_every_setting_is_an_option_and_a_key(place, tmp_path):
    config = changed(Config(), place)
    assert config != Config()
    value = dict(leaves(config))[place]
    option = "--" + place.removeprefix("scaling.").replace("_", "-")
    command = tyro.cli(Run, args=["clip.pt", "--out", "x", option, str(value)])
    assert config_of(command) == config
    *tables, key = place.split(".")
    file = tmp_path / "my.toml"
    header = f"[{'.'.join(tables)}]\n" if tables else ""
    file.write_text(f"{header}{key} = {value!r}\n")
    assert Config.from_table(__import__("tomllib").loads(file.read_text()), "it") == config


@pytest.mark.parametrize(
    ("table", "error", "words"),
    [
        ({"weihgts": {}}, ReadError, ["it: there is no 'weihgts'", "weights", "horizon"]),
        ({"weights": {"jrk": 1.0}}, ReadError, ["it: weights: there is no 'jrk'", "joint_position", "jerk"]),
        ({"weights": {"jerk": "much"}}, ReadError, ["it: weights: jerk holds 'much'", "expected a number"]),
        ({"weights": {"jerk": -1.0}}, ArgumentError, ["jerk is -1.0"]),
        ({"contact": "close"}, ReadError, ["it: contact is 'close'", "surface or landmark"]),
        ({"figures": "few"}, ReadError, ["it: figures is 'few'", "all or fast or none"]),
        ({"weights": 3}, ReadError, ["it: weights is 3; expected a table"]),
        ({"ik": {"solver": {"tol": 1}}}, ReadError, ["it: ik.solver: there is no 'tol'", "tolerance"]),
        (
            {"ik": {"solver": {"max_iterations": 1.5}}},
            ReadError,
            ["it: ik: solver.max_iterations holds 1.5", "a whole number"],
        ),
        ({"solver": {"name": "Ipopt"}}, ReadError, ["no solver 'Ipopt'", *SOLVERS]),
        ({"solver": "Ipopt"}, ReadError, ["no solver 'Ipopt'", *SOLVERS]),
        ({"horizon": "all"}, ArgumentError, ["horizon 'all'", "whole"]),
        ({"scaling": {"object_scale": "big"}}, ReadError, ["it: scaling: object_scale holds 'big'"]),
    ],
)
def test_a_wrong_table_is_one_error_that_says_what_exists(table, error, words):
    with pytest.raises(error) as raised:
        Config.from_table(table, "it")
    assert all(word in str(raised.value) for word in words), str(raised.value)


MODEL = load_model(robot("unitree_g1"))


@dataclass(frozen=True)
class Shifted:
    """A solver that nobody knows: it moves everything up by a little."""

    by: float = 0.01

    def solve(self, problem, qpos, effort):
        result = KeepStart().solve(problem, qpos)
        return replace(result, qpos=qpos + self.by * (np.arange(qpos.shape[1]) == 2))


def test_any_solver_can_be_passed_in():
    clip = make("carry_box", seconds=1.0)
    kept = retarget(clip, MODEL, Config(contact="landmark", solver=KeepStart()))
    ik, trajectory = kept.stages
    np.testing.assert_array_equal(ik.qpos, trajectory.qpos)
    shifted = retarget(clip, MODEL, Config(contact="landmark", solver=Shifted(0.02)))
    np.testing.assert_array_equal(shifted.qpos[:, 2], ik.qpos[:, 2] + 0.02)
    assert shifted.report.config["solver"] == {"name": "Shifted", "by": 0.02}


@pytest.mark.slow
def test_a_results_own_configuration_makes_it_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my.toml").write_text(
        'horizon = "windowed:60"\n[weights]\njerk = 2e-3\n[scaling]\nobject_scale = 1.0\n'
    )
    words = ["run", "builtin:push_table", "--out"]
    assert main([*words, "a", "--config", "my.toml", "--weights.head-position", "3"]) == 0
    assert main([*words, "b", "--config=a/push_table.npz"]) == 0
    assert main([*words, "c"]) == 0
    first, again, default = (load(tmp_path / folder / "push_table.npz") for folder in "abc")
    assert first.report.config == again.report.config != default.report.config
    assert first.report.config["weights"]["head_position"] == 3.0
    for name in ("object_pos", "contact_points"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    np.testing.assert_array_equal(first.qpos, again.qpos)
    assert (first.qpos != default.qpos).any()


def test_a_config_file_that_is_wrong_is_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.toml").write_text("[weights]\njrk = 1\n")
    save(retarget(make("carry_box", seconds=1.0), MODEL, Config(solver=KeepStart())), tmp_path / "kept.npz")
    for name, words in (("bad.toml", "there is no 'jrk'"), ("none.toml", "no such file"), ("kept.npz", "KeepStart")):
        assert main(["run", "builtin:carry_box", "--out", "out", "--config", name]) in (1, 2)
        err = capsys.readouterr().err
        assert err.count("\n") == 1 and words in err and name in err, err
    assert not (tmp_path / "out").exists()
