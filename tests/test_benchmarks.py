"""The benchmarks run, and the package's problems and optima are those of an independent statement in CasADi."""

import importlib
import importlib.util
import json
import subprocess
import sys
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.readers import readers
from hoi_retarget.retargeting.trajopt.problem import Problem, cost_by_term
from recordings import WRITERS, format_of
from trajectories import MODELS, all_terms, sunk_qpos, term_classes, terms_by_class

FOLDER = Path(__file__).parents[1] / "benchmarks"
MODEL = MODELS["unitree_g1"]
FRAMES = 6

needs_casadi = pytest.mark.skipif(
    importlib.util.find_spec("casadi") is None, reason="casadi is not installed: pip install hoi-retarget[benchmark]"
)


def run(script: str, *arguments: str) -> str:
    """Return what a benchmark prints."""
    command = [sys.executable, str(FOLDER / script), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def casadi_problem(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Of the compiled module's wrapper.
        return importlib.import_module("casadi_problem")


def random_problem(seed: int) -> tuple[Problem, np.ndarray, np.ndarray]:
    """Return a problem with terms of every kind, a reference and unknowns away from it."""
    rng = np.random.default_rng(seed)
    terms = all_terms(MODEL, FRAMES, rng)
    reference = sunk_qpos(MODEL, FRAMES, rng)
    away = 0.3 * rng.normal(size=(MODEL.nv, FRAMES))
    away[3:6, 0] = 3.0 * np.array([0.6, 0.0, 0.8])  # Nearly half a turn: the series must be exact there too.
    return Problem(MODEL, terms, 30.0), reference, away


@needs_casadi
@pytest.mark.parametrize("name", term_classes())
def test_every_stated_term_costs_the_same_in_casadi(casadi_problem, name):
    term = next(iter(terms_by_class(MODEL, FRAMES, np.random.default_rng(3)).get(name, ())), None)
    if term is None or not casadi_problem.stated([term]):
        pytest.skip("not stated in CasADi")
    _, reference, away = random_problem(3)
    if name == "Differences":
        away[3:6] *= 0.1  # Neighbours stay in one hemisphere, as the package makes them.
    problem = Problem(MODEL, (term,), 30.0)
    unknowns = casadi_problem.start_of(reference) + away
    program = casadi_problem.Statement(problem, FRAMES).program()
    cost = casadi_problem.ca.Function("cost", [program["x"], program["p"]], [program["f"]])
    theirs = float(cost(unknowns.reshape(-1, order="F"), casadi_problem.parameters_of(problem, reference)))
    qpos = casadi_problem.trajectory_of(unknowns, reference)
    (ours,) = cost_by_term(problem.linearize(MODEL.forward(qpos))).values()
    assert theirs == pytest.approx(ours, rel=1e-10)


@needs_casadi
def test_hessian_in_blocks_is_the_one_of_automatic_differentiation(casadi_problem):
    problem, reference, away = random_problem(5)
    problem = replace(problem, terms=casadi_problem.stated(problem.terms))
    statement = casadi_problem.Statement(problem, FRAMES)
    program = statement.program()
    solver = casadi_problem.ca.nlpsol("solver", "ipopt", program, {"ipopt": {"print_level": 0}})
    place = (casadi_problem.start_of(reference) + away).reshape(-1, order="F")
    inputs = (place, casadi_problem.parameters_of(problem, reference), 1.3, np.zeros(MODEL.n * (FRAMES - 1)))
    by_hand = np.array(statement.hessian()(*inputs).full())
    automatic = np.array(solver.get_function("nlp_hess_l")(*inputs).full())
    np.testing.assert_allclose(by_hand, automatic, rtol=1e-9, atol=1e-9 * np.abs(automatic).max())


@needs_casadi
def test_a_term_without_translation_is_left_out_and_named(casadi_problem, capsys):
    @dataclass(frozen=True)
    class Unstated:
        name: str

        def rows(self, kinematics):
            return ()

    problem, *_ = random_problem(0)
    paper = {
        "Posture",
        "SitePosition",
        "RelativeRotation",
        "ObjectContact",
        "SiteRotation",
        "SiteHeight",
        "Differences",
    }
    assert paper <= {type(term).__name__ for term in casadi_problem.stated(problem.terms)}
    terms = (*problem.terms, Unstated("clearance"))
    assert casadi_problem.stated(terms) == casadi_problem.stated(problem.terms)
    assert casadi_problem.left_out(terms) == (*casadi_problem.left_out(problem.terms), "clearance")
    casadi_problem.show_left_out(terms)
    assert "clearance" in capsys.readouterr().out
    with pytest.raises(TypeError, match="states no object"):
        casadi_problem.translate(object())


@needs_casadi
@pytest.mark.slow
def test_ipopt_finds_the_same_optimum(tmp_path):
    path = tmp_path / "ipopt.json"
    output = run("ipopt.py", "--synthetic", "push_table", "--frames", "66", "--repeats", "1",
                 "--ways", "blocks", "--json", str(path))  # fmt: skip
    assert "The optima agree." in output
    result = json.loads(path.read_text())
    assert result["frames"] == 66
    for horizon in ("whole", "windowed"):
        costs = [solver["cost"] for solver in result[horizon]]
        assert len(costs) == 2
        assert costs == pytest.approx([costs[0]] * 2, rel=1e-3)
        assert all(solver["violation"] < 1e-6 for solver in result[horizon])
    assert all(abs(decrease) < 1e-3 for decrease in result["polish"].values())


@pytest.mark.slow
def test_stages_run(tmp_path):
    path = tmp_path / "stages.json"
    run("stages.py", "--robots", "unitree_g1", "--synthetic", "carry_box", "--frames", "12", "--json", str(path))
    (result,) = json.loads(path.read_text())["results"]["unitree_g1, synthetic"]
    assert result["frames"] == 12
    assert set(result["seconds"]) == {"read", "targets", "ik", "trajectory", "metrics", "write"}


@pytest.mark.slow
def test_scaling_runs(tmp_path):
    path = tmp_path / "scaling.json"
    run("scaling.py", "--frames", "20", "--sizes", "12", "30", "--horizons", "whole", "--json", str(path))
    results = json.loads(path.read_text())["results"]["whole"]
    assert [result["frames"] for result in results] == [12, 30]
    assert all(result["megabytes"] < 300 for result in results)


@pytest.mark.slow
def test_lengths_that_need_more_memory_than_they_may_have_are_named(tmp_path):
    path = tmp_path / "scaling.json"
    output = run("scaling.py", "--frames", "20", "--sizes", "12", "12000", "--horizons", "whole",
                 "--memory-limit", "0.8", "--json", str(path))  # fmt: skip
    short, long = json.loads(path.read_text())["results"]["whole"]
    assert short["megabytes"] < 300
    assert long["failed"] == "out of memory" in output


@pytest.mark.slow
def test_horizons_run(tmp_path):
    path = tmp_path / "horizon.json"
    output = run("horizon.py", "--synthetic", "carry_box", "--frames", "36", "--clearance", "300",
                 "--horizons", "windowed:20:10", "whole", "--json", str(path))  # fmt: skip
    results = json.loads(path.read_text())["results"]
    assert [(result["horizon"], result["clearance"]) for result in results] == [
        (horizon, clearance) for horizon in ("windowed:20:10", "whole") for clearance in (0, 300)
    ]
    windowed, *_, whole, _ = results
    assert windowed["windows"] > whole["windows"] == 1
    assert windowed["jerk_at_seams"] > 0
    assert all(result["solved"] == 1 and result["figures"]["joint_jerk_radps3"] > 0 for result in results)
    assert "Medians over the 1 clips that all solved" in output
    assert "87/130" in output


@pytest.mark.slow
def test_clips_of_every_format_are_there_to_be_measured(tmp_path):
    for kind, write in WRITERS.items():
        folder = tmp_path / kind
        folder.mkdir()
        clip = write(folder, 60).read()
        assert (clip.frames, clip.source.format) == (60, format_of(kind))
    assert {format_of(kind) for kind in WRITERS} == {reader.format for reader in readers()}


@pytest.mark.slow
def test_readers_run(tmp_path):
    path = tmp_path / "readers.json"
    run("readers.py", "--formats", "behave", "--frames", "60", "120", "--repeats", "1", "--json", str(path))
    short, long = json.loads(path.read_text())["results"]
    assert (short["format"], short["frames"], long["frames"]) == ("behave", 60, 120)
    assert long["clip"] == 2 * short["clip"]
    assert all(result["seconds"] > 0 and result["peak"] > result["clip"] for result in (short, long))


@pytest.mark.slow
def test_single_operations_run(tmp_path):
    path = tmp_path / "operations.json"
    run(
        "operations.py", "--frames", "20", "--subdivisions", "2", "--points", "5", "--repeats", "1", "--json", str(path)
    )
    results = json.loads(path.read_text())["results"]
    assert len(results) == 4 and all(seconds > 0 for seconds in results.values())
    assert {"mesh of 320 triangles", "5 closest points on them", "curves of 20 frames"} < set(results)


@needs_casadi
@pytest.mark.slow
def test_agreement_runs(tmp_path):
    path = tmp_path / "agreement.json"
    run("agreement.py", "--synthetic", "carry_box", "--frames", "12", "--json", str(path))
    stages = json.loads(path.read_text())["results"]["carry_box"]
    assert set(stages) == {"ik", "trajectory"}
    assert all(abs(result["decrease"]) < 1e-3 for result in stages.values())
