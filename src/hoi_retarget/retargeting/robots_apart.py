"""Robots of one world outside each other: where they meet, each is solved again among the others, and gives way.

A robot alone knows nothing of the others. Where links of two robots then are in each other, the frames around are
solved again between pinned ones, one robot after the other, with the others as obstacles that move as they last did.
The first would make all the room that is needed: the others are shown half of its way, and make the rest. So all
find a way around each other; from there each is solved once more, with every way out open.
What is apart already stays as it is, to the bit.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_dilation

from hoi_retarget.evaluation import inter_robot_hand_errors, inter_robot_penetrations, robot_depths
from hoi_retarget.motion.report import Window
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import frames_in
from hoi_retarget.retargeting.config import PINNED, Config, Horizon
from hoi_retarget.retargeting.local_resolve import MARGIN_SECONDS, Draft
from hoi_retarget.retargeting.pipeline import on_surfaces, one_thread, scored
from hoi_retarget.retargeting.surfaces.solve import SurfaceProblems, to_the_end
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.table import trajectory_terms
from hoi_retarget.retargeting.trajopt.terms.robot_clearance import RobotClearance, robot_clearance_terms
from hoi_retarget.retargeting.trajopt.terms.self_clearance import self_clearance_terms
from hoi_retarget.retargeting.trajopt.windows import report_window, windows_of
from hoi_retarget.robots.model import Kinematics, RobotModel

MEETING = 1e-3
"""[m]; robots that are less deep in each other stay as they are."""


def kept_apart(drafts: Sequence[Draft], models: Sequence[RobotModel], config: Config) -> tuple[Draft, ...]:
    """Return the drafts of all people of a clip, with robots outside each other as far as they can be.

    Reports tell how deep they still are in each other, and how their hands are placed on what they hold together.
    With contact at landmarks, motions stay as they are.

    Raises:
        SolveError: The frames around a meeting end without a usable trajectory.
    """
    if config.contact == "surface":
        drafts = _apart(drafts, models, config)
    motions = [draft.motion for draft in drafts]
    errors = inter_robot_hand_errors(motions, models)
    met, depths = inter_robot_penetrations(motions, models)
    told = []
    for draft, depth in zip(drafts, depths, strict=True):
        figures = {**draft.motion.report.figures, "robot_penetration_max_m": depth}
        report = replace(
            draft.motion.report, figures=figures, inter_robot_hand_errors=errors, inter_robot_penetrations=met
        )
        told.append(replace(draft, motion=replace(draft.motion, report=report)))
    return tuple(told)


def _apart(drafts: Sequence[Draft], models: Sequence[RobotModel], config: Config) -> tuple[Draft, ...]:
    clock, moved = time.process_time(), tuple(drafts)
    margin = frames_in(MARGIN_SECONDS, drafts[0].targets.fps) + PINNED
    with one_thread():
        for first, stop in runs(binary_dilation(_meeting(drafts, models), np.ones(2 * margin + 1))):
            for start, end, _ in windows_of(Horizon(), stop - first):
                moved = _with_room(moved, models, config, first + start, first + end)
        share = (time.process_time() - clock) / len(drafts)
        return tuple(
            now if now is before else _scored(now, model, share)
            for now, before, model in zip(moved, drafts, models, strict=True)
        )


def _scored(draft: Draft, model: RobotModel, seconds: float) -> Draft:
    report = replace(draft.motion.report, cpu_seconds={**draft.motion.report.cpu_seconds, "apart": seconds})
    motion = replace(draft.motion, report=report)
    return replace(draft, motion=scored(motion, draft.targets, draft.clip, model, draft.person))


def _meeting(drafts: Sequence[Draft], models: Sequence[RobotModel]) -> Bool[np.ndarray, "T"]:
    """Return in which frames any two robots are in each other."""
    moving = [model.forward(draft.motion.qpos) for draft, model in zip(drafts, models, strict=True)]
    meeting = np.zeros(drafts[0].motion.frames, dtype=bool)
    for one, other in combinations(moving, 2):
        meeting |= robot_depths(one, other)[0].max(axis=0, initial=0.0) > MEETING
    return meeting


def _with_room(
    drafts: Sequence[Draft], models: Sequence[RobotModel], config: Config, first: int, stop: int
) -> tuple[Draft, ...]:
    """Return the drafts with some frames solved again, each robot among the others."""
    begun = [model.forward(draft.motion.qpos[first:stop]) for draft, model in zip(drafts, models, strict=True)]
    moving, solved, people, fps = begun.copy(), list(drafts), range(len(drafts)), drafts[0].targets.fps

    def problem_of(person: int, *, passing: bool) -> Problem | None:
        others = [*moving[:person], *moving[person + 1 :]]
        clearances = tuple(
            robot_clearance_terms(config.weights, moving[person], others, passing_at=fps if passing else None)
        )
        if not clearances and moving[person] is begun[person]:
            return None
        return _problem(drafts[person], config, clearances, moving[person], first, stop)

    def pass_others(person: int, *, share: float) -> None:
        moving[person] = begun[person]
        problem = problem_of(person, passing=True)
        if problem is not None:
            found = to_the_end(config.solver).solve(problem, begun[person].qpos)
            moving[person] = models[person].forward(_between(begun[person].qpos, found.qpos, share))

    for person in people[:-1]:
        pass_others(person, share=0.5)
    for person in reversed(people):
        pass_others(person, share=1.0)
    for person in reversed(people):
        problem = problem_of(person, passing=False)
        if problem is not None:
            solution = to_the_end(config.solver).solve(problem, moving[person].qpos)
            moving[person] = models[person].forward(solution.qpos)
            solved[person] = _with_frames(drafts[person], report_window(first, stop, problem, solution), solution.qpos)
    return tuple(solved)


def _problem(  # noqa: PLR0913, PLR0917 - what a problem is made of
    draft: Draft,
    config: Config,
    clearances: Sequence[RobotClearance],
    start: Kinematics,
    first: int,
    stop: int,
) -> Problem:
    """Return the problem of some frames between pinned ones."""
    targets, reference = draft.targets.window(first, stop), draft.motion.stages[0].qpos[first:stop]
    pinned, pinned_after = (PINNED if first > 0 else 0), (PINNED if stop < draft.targets.frames else 0)
    if on_surfaces(targets, config):
        problem_of = SurfaceProblems.of(start.model, targets, reference, config).last(start.qpos)
        terms = problem_of(0, stop - first, pinned).terms
    else:
        table = trajectory_terms(config.weights, targets, start.model.forward(reference), gives_way=True)
        terms = (*table, *self_clearance_terms(config.weights, targets, start))
    return Problem(start.model, (*terms, *clearances), targets.fps, pinned, pinned_after)


def _with_frames(draft: Draft, window: Window, found: Float[np.ndarray, "F nq"]) -> Draft:
    """Return a draft with other frames, and how they were solved, in its last stage."""
    motion, qpos = draft.motion, draft.motion.qpos.copy()
    qpos[window.start : window.stop] = found
    stage = replace(motion.stages[-1], qpos=qpos, windows=(*motion.stages[-1].windows, window))
    return replace(draft, motion=replace(motion, stages=(*motion.stages[:-1], stage)))


def _between(
    one: Float[np.ndarray, "F nq"], other: Float[np.ndarray, "F nq"], share: float
) -> Float[np.ndarray, "F nq"]:
    """Return the configurations on the way from one trajectory to another."""
    turn = se3.log(se3.quat_multiply(se3.quat_conjugate(one[:, 3:7]), other[:, 3:7]))
    between = (1.0 - share) * one + share * other
    between[:, 3:7] = se3.quat_multiply(one[:, 3:7], se3.exp(share * turn))
    return between
