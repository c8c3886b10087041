"""The solver against the optimality conditions of the problem, and windows against the whole."""

from dataclasses import FrozenInstanceError, dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.errors import ArgumentError
from hoi_retarget.motion.motion_report import Status
from hoi_retarget.retargeting.config import Horizon, parse_horizon
from hoi_retarget.retargeting.trajopt.bounds import Bounds
from hoi_retarget.retargeting.trajopt.problem import FrameRows, Problem, cost_by_term
from hoi_retarget.retargeting.trajopt.solvers.interior_point import add_curvature, kink_curvature
from hoi_retarget.retargeting.trajopt.solvers.solver import SOLVERS, BandedInteriorPoint, Effort, Solver
from hoi_retarget.retargeting.trajopt.solvers.solver_result import optimality
from hoi_retarget.retargeting.trajopt.terms.differences import Differences
from hoi_retarget.retargeting.trajopt.terms.posture import Posture
from hoi_retarget.retargeting.trajopt.terms.site_pose import SitePosition, SiteRotation
from hoi_retarget.retargeting.trajopt.windows import (
    CATCH_UP_FRAMES,
    MIN_TAIL_FRAMES,
    FrameRange,
    _catch_up,
    solve_windows,
    windows_of,
)
from trajectories import MODELS, random_qpos

MODEL = MODELS["unitree_g1"]
SOLVER = BandedInteriorPoint(tolerance=1e-9, max_iterations=100)
SITES = ("pelvis", "left_palm", "right_palm", "left_foot", "right_foot", "head")


def tracking(goal: np.ndarray, first: int, stop: int, pinned: int = 0, *, jerk: float = 10.0) -> Problem:
    """Return the problem of following a trajectory's sites, smoothly and near a posture."""
    kinematics = MODEL.forward(goal[first:stop])
    terms = [SitePosition(f"{site}_p", site, kinematics.point(site), 100.0) for site in SITES]
    terms += [SiteRotation(f"{site}_r", site, kinematics.orientation(site), 5.0) for site in SITES]
    home = np.repeat(MODEL.home_qpos[7:, None], stop - first, axis=1)
    return Problem(MODEL, (*terms, Posture("posture", home, 0.1), Differences("jerk", 3, jerk)), 30.0, pinned)


def beyond_bounds(frames: int) -> Problem:
    """Return a convex problem whose optimum lies on joint ranges and on joint speeds."""
    wave = np.sign(np.sin(np.arange(frames) * 0.7))
    reach = (MODEL.upper + 0.5)[:, None] * (wave > 0) + (MODEL.lower - 0.5)[:, None] * (wave <= 0)
    pelvis = np.tile([[0.0], [0.0], [0.8]], frames)
    upright = np.repeat(np.eye(3)[:, :, None], frames, axis=2)
    terms = (
        Posture("posture", reach, 1.0),
        SitePosition("pelvis", "pelvis", pelvis, 1.0),
        SiteRotation("upright", "pelvis", upright, 1.0),
        Differences("jerk", 3, 0.01),
    )
    return Problem(MODEL, terms, 30.0)


def standing(frames: int) -> np.ndarray:
    return np.tile(MODEL.home_qpos, (frames, 1))


GOAL = random_qpos(MODEL, 12, np.random.default_rng(6), wander=0.01)
PROBLEMS = {
    "tracking": (tracking(GOAL, 0, 12), standing(12)),
    "no jerk": (tracking(GOAL, 0, 2), standing(2)),
    "bounds": (beyond_bounds(12), standing(12)),
    "pinned": (tracking(GOAL, 0, 12, pinned=3), GOAL),
    "pinned on both sides": (replace(tracking(GOAL, 0, 12, pinned=3), pinned_after=2), GOAL),
    "start outside the bounds": (tracking(GOAL, 0, 12), GOAL + np.r_[np.zeros(7), np.ones(MODEL.n)]),
}
"""Problems with a start of each."""


NOT_FOR = {("KeepStart", "start outside the bounds")}


def test_solvers_are_frozen_values():
    assert all(isinstance(solver(), Solver) and solver() == solver() for solver in SOLVERS.values())
    with pytest.raises(FrozenInstanceError):
        BandedInteriorPoint().tolerance = 1.0


@pytest.mark.parametrize(("name", "case"), [(a, b) for a in SOLVERS for b in PROBLEMS if (a, b) not in NOT_FOR])
def test_contract_of_a_solver(name, case):
    problem, start = PROBLEMS[case]
    given = start.copy()
    solution = SOLVERS[name]().solve(problem, start)
    assert solution.status in {Status.SOLVED, Status.STALLED, Status.MAX_ITERATIONS} and solution.iterations >= 0
    np.testing.assert_array_equal(start, given)
    assert solution.qpos.shape == start.shape and solution.qpos is not start
    kept = np.ones(len(start), dtype=bool)
    kept[problem.unknown(len(start))] = False
    np.testing.assert_array_equal(solution.qpos[kept], start[kept])
    slack = Bounds.of(problem).values(solution.qpos[:, 7:])
    assert slack.min() > -1e-9
    assert solution.multipliers.shape == slack.shape and (solution.multipliers >= 0).all()
    costs = cost_by_term(problem.linearize(MODEL.forward(solution.qpos)))
    assert solution.cost_by_term == pytest.approx(costs) and solution.cost == pytest.approx(sum(costs.values()))
    if case != "start outside the bounds":
        at_start = cost_by_term(problem.linearize(MODEL.forward(start)))
        assert solution.cost <= sum(at_start.values()) * (1 + 1e-9)


@pytest.mark.parametrize("case", PROBLEMS)
def test_steps_are_newtons_so_that_few_suffice(case):
    problem, start = PROBLEMS[case]
    solution = SOLVER.solve(problem, start)
    assert solution.status is Status.SOLVED
    assert solution.iterations <= (60 if case == "start outside the bounds" else 20)


@pytest.mark.parametrize("name", SOLVERS)
def test_failure_is_a_status(name):
    problem, start = PROBLEMS["tracking"]
    endless = SitePosition("endless", "head", np.full((3, len(start)), np.inf), 1.0)
    with np.errstate(invalid="ignore", over="ignore"):
        solution = SOLVERS[name]().solve(replace(problem, terms=(*problem.terms, endless)), start)
    assert solution.status is Status.FAILED


def test_optimality_conditions_hold_where_bounds_are_active():
    problem = beyond_bounds(20)
    start = np.tile(MODEL.home_qpos, (20, 1))
    solution = SOLVER.solve(problem, start)
    assert solution.status is Status.SOLVED
    quality = optimality(problem, solution)
    assert quality.violation < 1e-9
    assert quality.stationarity < 1e-9
    assert quality.complementarity < 1e-6
    assert (solution.multipliers >= 0).all()
    slack = Bounds.of(problem).values(solution.qpos[:, 7:])
    at_range, at_speed = np.split(slack < 1e-4, [2 * 20])
    assert at_range.sum() > 20 and at_speed.sum() > 20, "both kinds of bounds must be active for this to be a test"


def test_a_perturbed_solution_is_not_optimal():
    problem = beyond_bounds(8)
    solution = SOLVER.solve(problem, np.tile(MODEL.home_qpos, (8, 1)))
    moved = solution.qpos.copy()
    moved[3, 0] += 0.01
    assert optimality(problem, replace(solution, qpos=moved)).stationarity > 1e-7


def test_what_breaks_a_bound_is_a_violation_of_that_size():
    problem, joint = PROBLEMS["tracking"][0], 3
    solution = SOLVERS["KeepStart"]().solve(problem, standing(12))
    assert solution.iterations == 0 and optimality(problem, solution).violation == 0.0
    for beyond in (0.25, 0.5):
        for value in (MODEL.upper[joint] + beyond, MODEL.lower[joint] - beyond):
            qpos = solution.qpos.copy()
            qpos[:, 7 + joint] = value
            assert optimality(problem, replace(solution, qpos=qpos)).violation == pytest.approx(beyond)
    fast = solution.qpos.copy()
    fast[5:, 7 + joint] += MODEL.speed_limits[joint] / 30.0 + 0.1
    fast = np.clip(
        fast, *(np.r_[np.full(7, sign * np.inf), end] for sign, end in ((-1, MODEL.lower), (1, MODEL.upper)))
    )
    step = float(np.abs(np.diff(fast[:, 7 + joint])).max()) - MODEL.speed_limits[joint] / 30.0
    assert step > 0.05
    assert optimality(problem, replace(solution, qpos=fast)).violation == pytest.approx(step)


def out_of_reach(seed: int, frames: int) -> Problem:
    """Return the problem of following sites whose joints swing half as far again as their ranges, smoothly."""
    rng, seconds = np.random.default_rng(seed), np.arange(frames)[:, None] / 30.0
    turns = rng.uniform(0.2, 0.6, MODEL.n) * seconds + rng.uniform(0.0, 1.0, MODEL.n)
    goal = standing(frames)
    goal[:, 7:] = 0.5 * (MODEL.lower + MODEL.upper) + 0.75 * (MODEL.upper - MODEL.lower) * np.sin(2 * np.pi * turns)
    return tracking(goal, 0, frames, jerk=810.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_a_solve_that_bounds_hold_up_converges_when_it_is_begun_again(seed):
    problem, start, solver = out_of_reach(seed, 40), standing(40), BandedInteriorPoint()
    once = solver.solve(problem, start, Effort(restarts=False))
    assert once.status is Status.MAX_ITERATIONS, "for this to be a test"
    twice = solver.solve(problem, start)
    assert twice.status is Status.SOLVED and twice.cost < once.cost
    assert optimality(problem, twice).stationarity < 10 * solver.tolerance
    # What does not converge either way is where the first way ended.
    short = replace(solver, max_iterations=50)
    first = short.solve(problem, start, Effort(restarts=False))
    np.testing.assert_array_equal(short.solve(problem, start).qpos, first.qpos)


def test_a_start_at_the_stops_stays_near_them_where_little_margin_is_asked_for():
    problem = beyond_bounds(12)
    solved = SOLVER.solve(problem, standing(12))
    once = replace(SOLVER, max_iterations=1)
    costs = [
        once.solve(problem, solved.qpos, Effort(restarts=False, start_margin=margin)).cost for margin in (3e-3, 0.3)
    ]
    near, far = (cost - solved.cost for cost in costs)
    assert 0.0 < near < 0.5 * far, (near, far)


@dataclass(frozen=True)
class Gutter:
    """A cost whose gradient jumps where a palm passes a height, in three frames."""

    height: float
    name: str = "gutter"

    def rows(self, kinematics):
        frame, frames = kinematics.frame("left_palm"), np.arange(6, 9)
        above = kinematics.point(frame)[2:3, frames] - self.height
        by_linear = np.sign(above)[:, None] * np.array([[[0.0], [0.0], [1.0]]])
        return (FrameRows(frame, 0.1 + np.abs(above), by_linear, None, 100.0, frames),)


@pytest.mark.parametrize("seed", range(4))
def test_a_solve_ends_where_costs_have_kinks(seed):
    rng = np.random.default_rng(seed)
    goal = random_qpos(MODEL, 15, rng, wander=0.03)
    problem, solver = tracking(goal, 0, 15), BandedInteriorPoint()
    gutter = Gutter(float(MODEL.forward(goal).point("left_palm")[2].mean()))
    problem = replace(problem, terms=(*problem.terms, gutter))
    found = solver.solve(problem, goal, Effort(kinks=True))
    assert found.status is Status.SOLVED and found.iterations < 50
    smooth = solver.solve(problem, goal, Effort(restarts=False))
    assert smooth.status is not Status.SOLVED, "for this to be a test"
    assert found.cost < smooth.cost
    for size in (1e-5, 1e-4, 1e-3):
        for _ in range(20):
            moved = MODEL.integrate(found.qpos, size * rng.normal(size=(15, MODEL.nv)))
            costs = cost_by_term(problem.linearize(MODEL.forward(moved)))
            assert sum(costs.values()) > found.cost * (1 - solver.tolerance)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(seed=st.integers(0, 99), frames=st.integers(1, 5))
def test_curvature_of_kinks_explains_the_gradients_change_along_a_step(seed, frames):
    rng, nv = np.random.default_rng(seed), 4
    square = rng.normal(size=(frames * nv, frames * nv))
    dense = square @ square.T
    band = np.zeros((frames, nv, frames * nv))
    for row, column in zip(*np.tril_indices(frames * nv), strict=True):
        band[column // nv, column % nv, row - column] = dense[row, column]
    step = rng.normal(size=(frames, nv))
    # Half of the frames get stiffer along the step, the others softer.
    excess = np.where(rng.random((frames, 1)) < 0.5, 1.0, -1.0) * (step + 0.1 * rng.normal(size=step.shape))
    known = (dense @ step.ravel()).reshape(step.shape)
    found = kink_curvature(band, step, known + excess)
    stiffer = np.einsum("ti,ti->t", excess, step) > 0
    np.testing.assert_allclose(np.einsum("tij,tj->ti", found, step), excess * stiffer[:, None], atol=1e-9)
    assert np.linalg.eigvalsh(found).min() > -1e-9
    before = band.copy()
    add_curvature(band, found)
    row, column = np.tril_indices(nv)
    added = (band - before)[:, column, row - column]
    np.testing.assert_allclose(added, found[:, row, column], atol=1e-12)


def test_solution_does_not_depend_on_the_start():
    rng = np.random.default_rng(0)
    goal = random_qpos(MODEL, 25, rng, wander=0.03)
    problem = tracking(goal, 0, 25)
    first = SOLVER.solve(problem, goal)
    shaken = MODEL.integrate(goal, 0.2 * rng.normal(size=(25, MODEL.nv)))
    second = SOLVER.solve(problem, shaken)
    assert first.cost == pytest.approx(second.cost, rel=1e-6)
    np.testing.assert_allclose(first.qpos[:, 7:], second.qpos[:, 7:], atol=1e-4)


def test_a_start_outside_the_bounds_ends_inside():
    rng = np.random.default_rng(1)
    goal = random_qpos(MODEL, 15, rng, wander=0.03)
    start = goal.copy()
    start[:, 7:] += 1.0 * rng.normal(size=(15, MODEL.n))
    solution = SOLVER.solve(tracking(goal, 0, 15), start)
    assert solution.status is Status.SOLVED
    assert Bounds.of(tracking(goal, 0, 15)).values(solution.qpos[:, 7:]).min() > -1e-9


def test_pinned_frames_stay_and_the_rest_respects_them():
    goal = random_qpos(MODEL, 12, np.random.default_rng(2), wander=0.03)
    start = goal.copy()
    start[:3, 7:] = MODEL.home_qpos[7:]
    problem = tracking(goal, 0, 12, pinned=3)
    solution = SOLVER.solve(problem, start)
    np.testing.assert_array_equal(solution.qpos[:3], start[:3])
    assert np.abs(np.diff(solution.qpos[2:, 7:], axis=0)).max(initial=0) <= problem.step_limits.max()
    assert optimality(problem, solution).stationarity < 1e-7


def test_a_piece_between_pinned_frames_of_the_optimum_is_that_optimum():
    goal = random_qpos(MODEL, 40, np.random.default_rng(4), wander=0.03)
    whole = SOLVER.solve(tracking(goal, 0, 40), goal).qpos
    piece = replace(tracking(goal, 8, 33, pinned=3), pinned_after=3)
    disturbed = whole[8:33].copy()
    disturbed[3:-3, 7:] += 0.2
    solution = SOLVER.solve(piece, disturbed)
    np.testing.assert_array_equal(solution.qpos[[0, 1, 2, -3, -2, -1]], disturbed[[0, 1, 2, -3, -2, -1]])
    assert optimality(piece, solution).stationarity < 1e-7
    np.testing.assert_allclose(solution.qpos, whole[8:33], atol=2e-4)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(free=st.integers(1, 7), pinned=st.integers(0, 3), pinned_after=st.integers(0, 3), seed=st.integers(0, 99))
def test_bounds_transpose_and_normal_matrix_agree_with_their_definition(free, pinned, pinned_after, seed):
    problem, frames = Problem(MODEL, (), 30.0, pinned, pinned_after), pinned + free + pinned_after
    bounds, unknown = Bounds.of(problem), problem.unknown(frames)
    rng = np.random.default_rng(seed)
    change = rng.normal(size=(free, MODEL.n))
    rows = bounds.apply(change)
    weights = rng.normal(size=rows.shape)
    assert np.sum(rows * weights) == pytest.approx(np.sum(change * bounds.apply_transposed(weights)))
    band = np.zeros((free, MODEL.nv, 2 * MODEL.nv))
    bounds.add_normal(band, weights**2)
    quadratic = np.sum(band[:, 6:, 0] * change**2) + 2 * np.sum(band[:-1, 6:, MODEL.nv] * change[:-1] * change[1:])
    assert quadratic == pytest.approx(np.sum((weights * rows) ** 2))
    theta = rng.normal(size=(frames, MODEL.n))
    moved = theta.copy()
    moved[unknown] += change
    np.testing.assert_allclose(bounds.values(moved) - bounds.values(theta), rows, atol=1e-12)
    assert bounds.widths(len(rows)).shape == rows.shape


def test_windows_with_look_ahead_approach_the_whole():
    goal = random_qpos(MODEL, 60, np.random.default_rng(3), wander=0.03)

    def solve(horizon: Horizon) -> np.ndarray:
        windows = windows_of(horizon, len(goal))
        return solve_windows(lambda w: tracking(goal, w.first, w.stop, w.pinned), goal, windows, SOLVER)[0]

    whole = solve(parse_horizon("whole"))
    errors = [np.abs(solve(Horizon(30, overlap, 3)) - whole)[:, 7:].max() for overlap in (3, 8, 15)]
    assert errors[2] < errors[1] < errors[0]
    assert errors[2] < 0.1 * errors[0]
    np.testing.assert_array_equal(solve(Horizon(60, 3, 3)), whole)


@given(frames=st.integers(4, 300), length=st.integers(4, 80), overlap=st.integers(0, 40), pinned=st.integers(0, 5))
def test_windows_cover_every_frame_once_in_order(frames, length, overlap, pinned):
    overlap = min(overlap, length - 1)
    horizon = Horizon(length, overlap, min(pinned, overlap))
    windows = windows_of(horizon, frames)
    assert windows[0].first == 0 and windows[-1].stop == frames
    for before, window in pairwise(windows):
        assert before.stop < window.stop <= window.first + length
        assert window.first >= 0 and window.first + window.pinned <= before.stop, "no frame is skipped"


@pytest.mark.parametrize("text", ["", "windowed", "windowed:0", "windowed:3:3", "windowed:a", "whole:3", "hole"])
def test_bad_horizons_are_refused(text):
    with pytest.raises(ArgumentError, match="horizon"):
        parse_horizon(text)


def test_per_frame_is_a_window_of_one_new_frame():
    windows = windows_of(parse_horizon("per-frame"), 10)
    assert windows[1:] == tuple(FrameRange(t - 1, t + 1, 1) for t in range(2, 10))


@given(frames=st.integers(1, 200), length=st.integers(6, 60), share=st.floats(0.0, 0.9))
def test_a_window_with_few_new_frames_is_as_long_as_the_others(frames, length, share):
    horizon = Horizon(length, int(share * length), 0)
    windows = windows_of(horizon, frames)
    for before, window in pairwise(windows):
        full = window.stop - window.first == length
        assert full or window.stop - before.stop >= MIN_TAIL_FRAMES
        reach = before.stop - window.first
        assert reach == horizon.overlap or (full and window.stop - before.stop < MIN_TAIL_FRAMES)


def test_a_range_alone_begins_at_its_own_first_frame():
    assert FrameRange.within(7, 20, 30).alone == FrameRange(0, 13, 3, 3)
    assert FrameRange.within(0, 20, 20).alone == FrameRange(0, 20, 0, 0)


def test_a_start_bends_back_to_its_own_path_evenly():
    start, solved, stop = random_qpos(MODEL, 40, np.random.default_rng(0)), 10, 36
    qpos, offset = start.copy(), np.random.default_rng(1).normal(size=start.shape[1])
    qpos[:solved] += offset
    moved = qpos.copy()
    _catch_up(moved, start, solved, stop)
    shares = np.clip(1.0 - np.arange(1, stop - solved + 1) / CATCH_UP_FRAMES, 0.0, None)
    free = np.r_[0:3, 7 : start.shape[1]]
    np.testing.assert_allclose((moved - start)[solved:stop, free], np.outer(shares, offset[free]), atol=1e-12)
    for same in (slice(0, solved), slice(stop, None)):
        np.testing.assert_array_equal(moved[same], qpos[same])
    np.testing.assert_array_equal(moved[solved:, 3:7], start[solved:, 3:7])


@pytest.mark.parametrize("name", ["tolerance", "step_tolerance"])
def test_tolerances_are_positive_numbers(name):
    for value in (0.0, -0.5, np.inf, np.nan):
        with pytest.raises(ArgumentError, match=f"{name.replace('_', '-')} is {value}; it must be positive"):
            BandedInteriorPoint(**{name: value})
    assert getattr(BandedInteriorPoint(**{name: 1e-12}), name) == 1e-12
