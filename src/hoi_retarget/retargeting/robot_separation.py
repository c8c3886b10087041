"""Robots of one world outside each other: where they meet, each is solved again among the others, and gives way.

A robot alone knows nothing of the others. Where links of two robots then are in each other, the frames around are
solved again between pinned ones, one robot after the other, with the others as obstacles that move as they last did.
The first would make all the room that is needed: the others are shown half of its way, and make the rest. So all
plan around each other; from there each is solved once more, with every direction open.
Frames without a meeting stay as they are, to the bit.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.motion.motion_report import Window
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Config, Horizon
from hoi_retarget.retargeting.local_resolve import pieces_around
from hoi_retarget.retargeting.solve import Solution, on_surfaces, one_thread
from hoi_retarget.retargeting.surfaces.passes import FINAL, SurfaceProblems
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.terms.robot_clearance import RobotClearance, robot_clearance_terms
from hoi_retarget.retargeting.trajopt.terms.self_clearance import self_clearance_terms
from hoi_retarget.retargeting.trajopt.trajectory_terms import trajectory_terms
from hoi_retarget.retargeting.trajopt.windows import FrameRange, report_window, windows_of
from hoi_retarget.robots.link_depths import robot_depths
from hoi_retarget.robots.model import Kinematics

MIN_SEPARATED_DEPTH_M = 1e-3  # [m]; robots that are less deep in each other stay as they are.


def separate_robots(solutions: Sequence[Solution], config: Config) -> tuple[Solution, ...]:
    """Return the solutions of all people of a clip with their robots outside each other, as far as they can be.

    With contact at landmarks, motions stay as they are.

    Raises `SolveError` when the frames around a meeting end without a usable trajectory.
    """
    if config.contact != "surface":
        return tuple(solutions)
    clock, moved = time.process_time(), tuple(solutions)
    with one_thread():
        for first, stop in pieces_around(_penetrating_frames(solutions), solutions[0].targets.fps):
            for window in windows_of(Horizon(), stop - first):
                moved = _make_room(moved, config, first + window.first, first + window.stop)
        share = (time.process_time() - clock) / len(solutions)
        return tuple(now if now is before else _timed(now, share) for now, before in zip(moved, solutions, strict=True))


def _timed(solution: Solution, seconds: float) -> Solution:
    report = solution.motion.report
    motion = solution.motion.with_report(cpu_seconds={**report.cpu_seconds, "apart": seconds})
    return Solution.of(solution.clip, solution.person, solution.targets, motion, solution.model)


def _penetrating_frames(solutions: Sequence[Solution]) -> Bool[np.ndarray, "T"]:
    """Return in which frames any two robots are in each other."""
    meeting = np.zeros(solutions[0].motion.frames, dtype=bool)
    for one, other in combinations((solution.kinematics for solution in solutions), 2):
        meeting |= robot_depths(one, other)[0].max(axis=0, initial=0.0) > MIN_SEPARATED_DEPTH_M
    return meeting


def _make_room(solutions: Sequence[Solution], config: Config, first: int, stop: int) -> tuple[Solution, ...]:
    """Return the solutions with some frames solved again, each robot among the others."""
    starts = [solution.model.forward(solution.motion.qpos[first:stop]) for solution in solutions]
    moving, solved, people, fps = starts.copy(), list(solutions), range(len(solutions)), solutions[0].targets.fps

    def problem_of(person: int, *, passing: bool) -> Problem | None:
        others = [*moving[:person], *moving[person + 1 :]]
        clearances = tuple(
            robot_clearance_terms(config.weights, moving[person], others, passing_at=fps if passing else None)
        )
        if not clearances and moving[person] is starts[person]:
            return None
        return _problem(solutions[person], config, clearances, moving[person], first, stop)

    def plan_around_others(person: int, *, share: float) -> None:
        moving[person] = starts[person]
        problem = problem_of(person, passing=True)
        if problem is not None:
            found = config.solver.solve(problem, starts[person].qpos, FINAL)
            moving[person] = starts[person].model.forward(_between(starts[person].qpos, found.qpos, share))

    for person in people[:-1]:
        plan_around_others(person, share=0.5)
    for person in reversed(people):
        plan_around_others(person, share=1.0)
    for person in reversed(people):
        problem = problem_of(person, passing=False)
        if problem is not None:
            result = config.solver.solve(problem, moving[person].qpos, FINAL)
            moving[person] = starts[person].model.forward(result.qpos)
            solved[person] = _with_frames(solutions[person], report_window(first, stop, problem, result), result.qpos)
    return tuple(solved)


def _problem(  # noqa: PLR0913, PLR0917  # the parts of a problem
    solution: Solution, config: Config, clearances: Sequence[RobotClearance], start: Kinematics, first: int, stop: int
) -> Problem:
    """Return the problem of some frames between pinned ones."""
    targets, reference = solution.targets.window(first, stop), solution.stages[0].qpos[first:stop]
    window = FrameRange.within(first, stop, solution.targets.frames).alone
    if on_surfaces(targets, config):
        problem_of = SurfaceProblems.of(start.model, targets, reference, config).last(start.qpos)
        problem = problem_of(window)
        return replace(problem, terms=(*problem.terms, *clearances))
    table = trajectory_terms(config.weights, targets, start.model.forward(reference), gives_way=True)
    terms = (*table, *self_clearance_terms(config.weights, start), *clearances)
    return Problem(start.model, terms, targets.fps, window.pinned, window.pinned_after)


def _with_frames(solution: Solution, window: Window, found: Float[np.ndarray, "F nq"]) -> Solution:
    """Return a solution with other frames and the report of their window in its last stage."""
    motion, qpos = solution.motion, solution.motion.qpos.copy()
    qpos[window.start : window.stop] = found
    stage = replace(motion.stages[-1], qpos=qpos, windows=(*motion.stages[-1].windows, window))
    motion = replace(motion, stages=(*motion.stages[:-1], stage))
    return replace(solution, motion=motion, kinematics=solution.model.forward(qpos))


def _between(
    one: Float[np.ndarray, "F nq"], other: Float[np.ndarray, "F nq"], share: float
) -> Float[np.ndarray, "F nq"]:
    """Return the configurations on the way from one trajectory to another."""
    turn = se3.log(se3.quat_multiply(se3.quat_conjugate(one[:, 3:7]), other[:, 3:7]))
    between = (1.0 - share) * one + share * other
    between[:, 3:7] = se3.quat_multiply(one[:, 3:7], se3.exp(share * turn))
    return between
