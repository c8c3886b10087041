"""Solving a clip in overlapping windows: per frame, windowed and whole are three settings of it.

Each window pins its first frames to what earlier windows found (paper Eq. 2d) and solves the rest
again; with more overlap than pinned frames a window looks ahead of what it keeps.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import SolveError
from hoi_retarget.motion.motion_report import Optimality, Status, Window
from hoi_retarget.retargeting.config import PINNED, Horizon
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.solvers.solver import Effort, Solver
from hoi_retarget.retargeting.trajopt.solvers.solver_result import SolverResult, optimality

MAX_VIOLATION_RAD = 1e-6  # [rad]
CATCH_UP_FRAMES = 15  # A window's start bends from the solved frames to the given ones over so many.
MIN_TAIL_FRAMES = 5  # Fewer new frames than these join the last window, which then reaches further back.


@dataclass(frozen=True)
class FrameRange:
    """Consecutive frames that are solved at once, between pinned ones."""

    first: int
    stop: int  # One past the last frame.
    pinned: int = 0  # Leading frames that stay as they are.
    pinned_after: int = 0  # Trailing frames that do.

    @classmethod
    def within(cls, first: int, stop: int, frames: int) -> "FrameRange":
        """Return a range of a clip that joins the frames around it without a seam."""
        return cls(first, stop, PINNED if first > 0 else 0, PINNED if stop < frames else 0)

    @property
    def alone(self) -> "FrameRange":
        """The same range counted from its own first frame."""
        return FrameRange(0, self.stop - self.first, self.pinned, self.pinned_after)


ProblemOf = Callable[[FrameRange], Problem]


def windows_of(horizon: Horizon, frames: int) -> tuple[FrameRange, ...]:
    """Return the windows over a clip of so many frames."""
    found = [FrameRange(0, min(horizon.length, frames))]
    while found[-1].stop < frames:
        first = found[-1].stop - horizon.overlap
        stop = min(first + horizon.length, frames)
        if stop - found[-1].stop < MIN_TAIL_FRAMES < horizon.length:
            first = max(0, stop - horizon.length)
        found.append(FrameRange(first, stop, horizon.pinned))
    return tuple(found)


def solve_windows(  # noqa: PLR0913  # the parts of a solve
    problem_of: ProblemOf,
    start: Float[np.ndarray, "T nq"],
    windows: Sequence[FrameRange],
    solver: Solver,
    effort: Effort = Effort(),
    *,
    first_frame: int = 0,
    reported: bool = True,
) -> tuple[Float[np.ndarray, "T nq"], tuple[Window, ...]]:
    """Return the trajectory [m, rad, quaternion] of windows solved one after the other, and their reports.

    Raises `SolveError` where a window fails, or its trajectory breaks a joint range or a joint speed.

    Args: `problem_of`: makes the problem of a window; `start`: the trajectory to start from; `windows`: in order of
    time, over all frames; `solver`: solves each window; `effort`: of each solve; `first_frame`: frame of the clip in
    which the trajectory starts, for messages; `reported`: whether windows are reported and checked; otherwise another
    solve goes on from the trajectory.
    """
    qpos, solved = start.copy(), 0
    reports = []
    for window in windows:
        _catch_up(qpos, start, solved, window.stop)
        problem = problem_of(window)
        result = solver.solve(problem, qpos[window.first : window.stop], effort)
        qpos[window.first : window.stop], solved = result.qpos, window.stop
        if reported:
            place = first_frame + window.first, first_frame + window.stop
            reports.append(report_window(*place, problem, result))
    return qpos, tuple(reports)


def report_window(first: int, stop: int, problem: Problem, result: SolverResult) -> Window:
    """Return a window's report; raises `SolveError` when it failed or its trajectory breaks joint ranges or speeds."""
    quality = optimality(problem, result)
    _check(first, stop, result.status, quality)
    return Window(first, stop, result.status, result.iterations, result.cost, result.cost_by_term, quality)


def _catch_up(qpos: np.ndarray, start: np.ndarray, solved: int, stop: int) -> None:
    """Bend the start of a window's new frames towards where the solved frames end, in place."""
    if solved == 0:
        return
    share = np.maximum(0.0, 1.0 - np.arange(1, stop - solved + 1) / CATCH_UP_FRAMES)[:, None]
    for columns in (slice(0, 3), slice(7, None)):
        offset = qpos[solved - 1, columns] - start[solved - 1, columns]
        qpos[solved:stop, columns] = start[solved:stop, columns] + share * offset


def _check(first: int, stop: int, status: Status, quality: Optimality) -> None:
    if status is Status.FAILED:
        raise SolveError(f"frames {first} to {stop - 1}: {status.message}.")
    if quality.violation > MAX_VIOLATION_RAD:
        raise SolveError(
            f"frames {first} to {stop - 1}: {status.message}; a joint range or speed is exceeded by "
            f"{quality.violation:.2g} rad, so nothing is kept. Try --horizon whole."
        )
