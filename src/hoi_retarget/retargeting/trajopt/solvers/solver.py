"""The interface of solvers, and the options of each; nothing heavy is imported before a problem is solved."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from hoi_retarget.errors import ArgumentError

if TYPE_CHECKING:
    import numpy as np

    from hoi_retarget.retargeting.trajopt.problem import Problem
    from hoi_retarget.retargeting.trajopt.solvers.solver_result import SolverResult


@dataclass(frozen=True)
class Effort:
    """The accuracy and the time that one solve is worth, relative to the options of its solver."""

    tolerance_factor: float = 1.0  # Multiplies the solver's tolerance.
    max_iterations: int | None = None  # Limit of iterations where it is below the solver's own.
    restarts: bool = True  # Whether a solve that ends unsolved may begin again in another way.
    kinks: bool = False  # Whether costs have kinks, as distances between surfaces do; such a solve never begins again.
    start_margin: float = 3e-2
    """Share of a joint's range by which a start is moved away from its ends: little, where it is near a solution."""


@runtime_checkable
class Solver(Protocol):
    """A frozen value with its options as fields."""

    def solve(self, problem: "Problem", qpos: "np.ndarray", effort: Effort = Effort()) -> "SolverResult":
        """Return a result from a starting trajectory; failure is a status, never an exception."""
        ...


@dataclass(frozen=True)
class BandedInteriorPoint:
    """The options of the interior-point Gauss-Newton solver."""

    max_iterations: int = 200  # Iterations after which the solve stops.
    tolerance: float = 3e-4  # Predicted decrease and complementarity gap, relative to the cost, at which it is solved.
    step_tolerance: float = 10.0
    """Largest last step of any coordinate [m, rad] with which it is solved before the last iteration: where costs stay
    large, a small relative decrease can still be a large step. Ten is no limit."""
    fraction_to_boundary: float = 0.995  # Largest part of the way to a bound taken in one step.

    def __post_init__(self) -> None:
        if self.max_iterations < 1:
            raise ArgumentError(f"max-iterations is {self.max_iterations}; it must be at least 1.")
        for name in ("tolerance", "step_tolerance"):
            if not (isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ArgumentError(f"{name.replace('_', '-')} is {getattr(self, name)}; it must be positive.")
        if not 0 < self.fraction_to_boundary < 1:
            raise ArgumentError(f"fraction-to-boundary is {self.fraction_to_boundary}; it must lie between 0 and 1.")

    def solve(self, problem: "Problem", qpos: "np.ndarray", effort: Effort = Effort()) -> "SolverResult":
        """Return the result from a starting trajectory; joints outside their range are moved in."""
        from hoi_retarget.retargeting.trajopt.solvers.interior_point import solve  # noqa: PLC0415  # scipy is slow to load

        limit = self.max_iterations if effort.max_iterations is None else effort.max_iterations
        options = replace(
            self, tolerance=effort.tolerance_factor * self.tolerance, max_iterations=min(self.max_iterations, limit)
        )
        return solve(options, problem, qpos, effort)


@dataclass(frozen=True)
class KeepStart:
    """The solver that keeps its start: the pipeline around a solver is tested with it in milliseconds."""

    def solve(self, problem: "Problem", qpos: "np.ndarray", effort: Effort = Effort()) -> "SolverResult":
        """Return the starting trajectory as solved."""
        from hoi_retarget.retargeting.trajopt.solvers.solver_result import keep_start  # noqa: PLC0415  # scipy, as above

        return keep_start(problem, qpos)


SOLVERS: Mapping[str, type[Solver]] = MappingProxyType(
    {solver.__name__: solver for solver in (BandedInteriorPoint, KeepStart)}
)
"""Solvers that a table can name."""
