"""Solving a clip in overlapping windows: per frame, windowed and whole are three settings of it.

Each window pins its first frames to what earlier windows found (paper Eq. 2d) and solves the rest
again; with more overlap than pinned frames a window looks ahead of what it keeps.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import SolveError
from hoi_retarget.motion.report import Optimality, Status, Window
from hoi_retarget.retargeting.config import Horizon, Solver
from hoi_retarget.retargeting.trajopt.problem import Problem
from hoi_retarget.retargeting.trajopt.solvers.base import Solution, optimality

LARGEST_VIOLATION = 1e-6  # [rad]
CATCH_UP = 15  # Frames over which a window's start bends from what is solved to what was given.
SHORTEST_TAIL = 5  # Fewer new frames than these join the last window, which then reaches further back.


def windows_of(horizon: Horizon, frames: int) -> tuple[tuple[int, int, int], ...]:
    """Return (start, stop, pinned) of every window over a clip."""
    found = [(0, min(horizon.length, frames), 0)]
    while found[-1][1] < frames:
        start = found[-1][1] - horizon.overlap
        stop = min(start + horizon.length, frames)
        if stop - found[-1][1] < SHORTEST_TAIL < horizon.length:
            start = max(0, stop - horizon.length)
        found.append((start, stop, horizon.pinned))
    return tuple(found)


def solve_windows(
    problem_of: Callable[[int, int, int], Problem],
    start: Float[np.ndarray, "T nq"],
    horizon: Horizon,
    solver: Solver,
    *,
    reported: bool = True,
) -> tuple[Float[np.ndarray, "T nq"], tuple[Window, ...]]:
    """Return the trajectory found by solving `problem_of(start, stop, pinned)` window by window, and their reports.

    Without reports nothing is checked: another solve goes on from there.

    Raises `SolveError` when a window fails or its trajectory breaks a joint range or a joint speed.
    """
    qpos, solved = start.copy(), 0
    reports = []
    for first, stop, pinned in windows_of(horizon, len(start)):
        _catch_up(qpos, start, solved, stop)
        problem = problem_of(first, stop, pinned)
        solution = solver.solve(problem, qpos[first:stop])
        qpos[first:stop], solved = solution.qpos, stop
        if reported:
            reports.append(report_window(first, stop, problem, solution))
    return qpos, tuple(reports)


def report_window(first: int, stop: int, problem: Problem, solution: Solution) -> Window:
    """Return how a window was solved.

    Raises `SolveError` when it failed or its trajectory breaks a joint range or a joint speed.
    """
    quality = optimality(problem, solution)
    _check(first, stop, solution.status, quality)
    return Window(first, stop, solution.status, solution.iterations, solution.cost, solution.cost_by_term, quality)


def _catch_up(qpos: np.ndarray, start: np.ndarray, solved: int, stop: int) -> None:
    """Bend the start of a window's new frames towards where the solved frames end, in place."""
    if solved == 0:
        return
    share = np.maximum(0.0, 1.0 - np.arange(1, stop - solved + 1) / CATCH_UP)[:, None]
    for columns in (slice(0, 3), slice(7, None)):
        offset = qpos[solved - 1, columns] - start[solved - 1, columns]
        qpos[solved:stop, columns] = start[solved:stop, columns] + share * offset


def _check(first: int, stop: int, status: Status, quality: Optimality) -> None:
    if status is Status.FAILED:
        raise SolveError(f"frames {first} to {stop - 1}: {status.message}.")
    if quality.violation > LARGEST_VIOLATION:
        raise SolveError(
            f"frames {first} to {stop - 1}: {status.message}; a joint range or speed is exceeded by "
            f"{quality.violation:.2g} rad, so nothing is kept. Try --horizon whole."
        )
