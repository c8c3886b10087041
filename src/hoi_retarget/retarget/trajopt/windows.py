"""Solving a clip in overlapping windows: per frame, windowed and whole are three settings of it.

Each window pins its first frames to what earlier windows found (paper Eq. 2d) and solves the rest
again; with more overlap than pinned frames a window looks ahead of what it keeps.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ArgumentError, SolveError
from hoi_retarget.retarget.trajopt.problem import Problem
from hoi_retarget.retarget.trajopt.solvers.base import Optimality, Solution, Solver, Status, optimality

SHORTEST_WINDOW = 20  # Of those that pin frames.
PINNED = 3  # The reach of a third difference.
LARGEST_VIOLATION = 1e-6  # [rad]
LOOK_AHEAD = 15  # Shared frames with which seams can no longer be seen.
CATCH_UP = 15  # Frames over which a window's start bends from what is solved to what was given.
SHORTEST_TAIL = 5  # Fewer new frames than these join the last window, which then reaches further back.


@dataclass(frozen=True)
class Horizon:
    """How many frames are solved at once."""

    length: int = 1000
    """Frames in a window; a clip that is no longer is solved whole."""
    overlap: int = 60
    """Frames that a window shares with the one before."""
    pinned: int = PINNED
    """Leading frames of a window that keep what the one before found; three carry the jerk over."""

    def __post_init__(self) -> None:
        if not 0 <= self.pinned <= self.overlap < self.length:
            raise ArgumentError(
                f"horizon: length {self.length}, overlap {self.overlap}, pinned {self.pinned}; "
                "they must satisfy 0 <= pinned <= overlap < length."
            )

    def windows(self, frames: int) -> tuple[tuple[int, int, int], ...]:
        """Return (start, stop, pinned) of every window over a clip."""
        found = [(0, min(self.length, frames), 0)]
        while found[-1][1] < frames:
            start = found[-1][1] - self.overlap
            stop = min(start + self.length, frames)
            if stop - found[-1][1] < SHORTEST_TAIL < self.length:
                start = max(0, stop - self.length)
            found.append((start, stop, self.pinned))
        return tuple(found)


def parse_horizon(text: str) -> Horizon:
    """Return the horizon for `auto`, `whole`, `per-frame` or `windowed:LENGTH[:OVERLAP]`.

    Raises `ArgumentError` for anything else.
    """
    kind, *numbers = text.split(":")
    # One new frame cannot pay for a third difference: with three pinned frames it would extrapolate. A window
    # of two has no such row, and each frame follows its predecessor through the speed limits alone.
    presets = {"auto": Horizon(), "whole": Horizon(length=10**9), "per-frame": Horizon(2, 1, 1)}
    if not numbers and kind in presets:
        return presets[kind]
    if kind == "windowed" and 1 <= len(numbers) <= 2 and all(n.isascii() and n.isdecimal() for n in numbers):
        length, overlap = int(numbers[0]), int(numbers[1]) if len(numbers) == 2 else LOOK_AHEAD
        if length >= SHORTEST_WINDOW and PINNED <= overlap < length:
            return Horizon(length, overlap, PINNED)
        raise ArgumentError(
            f"horizon {text!r}: LENGTH must be at least {SHORTEST_WINDOW} frames, for shorter windows extrapolate the "
            f"jerk of the {PINNED} frames they keep; OVERLAP at least {PINNED} and less than LENGTH."
        )
    raise ArgumentError(f"horizon {text!r}: expected auto, whole, per-frame or windowed:LENGTH[:OVERLAP].")


@dataclass(frozen=True)
class WindowReport:
    """How one window was solved."""

    start: int
    stop: int
    status: Status
    iterations: int
    cost: float
    cost_by_term: dict[str, float]
    optimality: Optimality


def solve_windows(
    problem_of: Callable[[int, int, int], Problem],
    start: Float[np.ndarray, "T nq"],
    horizon: Horizon,
    solver: Solver,
) -> tuple[Float[np.ndarray, "T nq"], tuple[WindowReport, ...]]:
    """Return the trajectory found by solving `problem_of(start, stop, pinned)` window by window.

    Raises `SolveError` when a window fails or its trajectory breaks a joint range or a joint speed.
    """
    qpos, solved = start.copy(), 0
    reports = []
    for first, stop, pinned in horizon.windows(len(start)):
        _catch_up(qpos, start, solved, stop)
        problem = problem_of(first, stop, pinned)
        solution = solver.solve(problem, qpos[first:stop])
        qpos[first:stop], solved = solution.qpos, stop
        reports.append(report_window(first, stop, problem, solution))
    return qpos, tuple(reports)


def report_window(first: int, stop: int, problem: Problem, solution: Solution) -> WindowReport:
    """Return how a window was solved.

    Raises `SolveError` when it failed or its trajectory breaks a joint range or a joint speed.
    """
    quality = optimality(problem, solution)
    _check(first, stop, solution.status, quality)
    return WindowReport(
        first, stop, solution.status, solution.iterations, solution.cost, solution.cost_by_term, quality
    )


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
        raise SolveError(f"frames {first} to {stop - 1}: {status.value}.")
    if quality.violation > LARGEST_VIOLATION:
        raise SolveError(
            f"frames {first} to {stop - 1}: {status.value}; a joint range or speed is exceeded by "
            f"{quality.violation:.2g} rad, so nothing is kept. Try --horizon whole."
        )
