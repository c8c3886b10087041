"""Primal-dual interior-point Gauss-Newton method on a banded normal matrix.

The inequalities get slacks `s` and multipliers `z`; Newton's equations for

    J^T W r - A^T z = 0,   s z = mu,   c(theta) - s = 0

are reduced to the tangent coordinates, where the inequalities add only to the diagonal and to one
off-diagonal of the band. A predictor step sets how far `mu` falls (Mehrotra, SIAM J. Optim. 2,
1992); a backtracking line search on a merit function makes the method converge from far away.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import lapack

from hoi_retarget.robots.model import Kinematics
from hoi_retarget.trajopt.bounds import Bounds
from hoi_retarget.trajopt.normal import assemble, reach_of
from hoi_retarget.trajopt.problem import Problem, cost_by_term
from hoi_retarget.trajopt.rows import Rows
from hoi_retarget.trajopt.solvers.base import Solution, Status

_ROUNDING = 1e-12
_FEASIBLE = 1e-7  # [rad]
_START_GAP = 0.1  # Complementarity gap at the start, relative to the cost.
_START_MARGIN = 3e-2  # Of a joint's range: a start is moved that far away from its ends.
_LEAST_SLACK = 1e-3  # Of a bound's interval: less than this counts as outside.
# Levenberg-Marquardt damping, relative to the diagonal: it grows when steps are cut short.
_LEAST_DAMPING, _FIRST_DAMPING, _LARGEST_DAMPING = 1e-9, 1e-3, 1e3
_SMALLEST_COST = 1e-9  # What accuracies relative to the cost are measured against when it vanishes.


@dataclass(frozen=True)
class BandedInteriorPoint:
    """The solver's options."""

    max_iterations: int = 60
    """Iterations after which the solve stops."""
    tolerance: float = 1e-4
    """Predicted decrease and complementarity gap, relative to the cost, at which it is solved."""
    fraction_to_boundary: float = 0.995
    """Largest part of the way to a bound taken in one step."""

    def solve(self, problem: Problem, qpos: Float[np.ndarray, "T nq"]) -> Solution:
        """Return the solution from a starting trajectory; joints outside their range are moved in."""
        bounds = Bounds.of(problem)
        point = _Point.at(problem, bounds, _inside(problem, qpos))
        slack = np.maximum(point.values, _LEAST_SLACK * bounds.widths(len(point.values)))
        multiplier = max(_START_GAP * point.half_cost / slack.size, _SMALLEST_COST) / slack
        if not np.isfinite(point.half_cost):
            return _solution(point, Status.FAILED, 0, multiplier)
        damping = _LEAST_DAMPING
        for iteration in range(1, self.max_iterations + 1):
            step = _NewtonStep.compute(self, problem, bounds, point, slack, multiplier, damping)
            moved = None if step is None else _line_search(problem, bounds, point, slack, step)
            if step is None or moved is None:
                if damping > _LARGEST_DAMPING:
                    return _solution(point, Status.STALLED, iteration, multiplier)
                damping = max(10.0 * damping, _FIRST_DAMPING)
                continue
            point, slack, length = moved
            multiplier = multiplier + step.dual_length * step.multiplier
            damping = _next_damping(damping, length)
            accuracy = self.tolerance * max(point.half_cost, _SMALLEST_COST)
            optimal = step.predicted_decrease < accuracy and float(np.sum(slack * multiplier)) < 10 * accuracy
            if optimal and damping < _FIRST_DAMPING and np.abs(slack - point.values).max() < _FEASIBLE:
                return _solution(point, Status.SOLVED, iteration, multiplier)
        return _solution(point, Status.MAX_ITERATIONS, self.max_iterations, multiplier)


def _next_damping(damping: float, length: float) -> float:
    if length < 0.25:
        return max(10.0 * damping, _FIRST_DAMPING)
    return max(0.1 * damping, _LEAST_DAMPING) if length > 0.75 else damping


@dataclass(frozen=True, eq=False)
class _Point:
    """A trajectory with everything that is computed from it once."""

    kinematics: Kinematics
    rows: list[Rows]
    half_cost: float
    by_term: dict[str, float]
    values: np.ndarray
    """Slacks of the inequalities."""

    @classmethod
    def at(cls, problem: Problem, bounds: Bounds, qpos: np.ndarray) -> "_Point":
        kinematics = problem.model.forward(qpos)
        linearization = problem.linearize(kinematics)
        by_term = cost_by_term(linearization)
        rows = [part for parts in linearization.values() for part in parts]
        return cls(kinematics, rows, 0.5 * sum(by_term.values()), by_term, bounds.values(qpos[:, 7:]))


@dataclass(frozen=True, eq=False)
class _NewtonStep:
    tangent: np.ndarray
    """(T, nv), zero in pinned frames."""
    slack: np.ndarray
    multiplier: np.ndarray
    primal_length: float
    dual_length: float
    barrier: float
    directional: float
    """Derivative of the half cost along the step."""
    predicted_decrease: float
    """Of the half cost with its barrier, by the quadratic model."""

    @classmethod
    def compute(
        cls,
        options: BandedInteriorPoint,
        problem: Problem,
        bounds: Bounds,
        point: _Point,
        slack: np.ndarray,
        multiplier: np.ndarray,
        damping: float,
    ) -> "_NewtonStep | None":
        pinned = problem.pinned
        normal = assemble(point.kinematics, point.rows, reach=max(reach_of(point.rows), 1))
        band, gradient = normal.band[pinned:], normal.gradient[pinned:]
        band[:, :, 0] *= 1.0 + damping
        ratio = multiplier / slack
        bounds.add_normal(band, ratio)
        size = band.shape[0] * band.shape[1]
        factor, info = lapack.dpbtrf(band.reshape(size, -1).T, lower=1, overwrite_ab=1)
        if info != 0:
            return None
        infeasible = point.values - slack

        def direction(centre: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            force = -gradient
            force[:, 6:] += bounds.apply_transposed(centre / slack - ratio * infeasible)
            tangent = lapack.dpbtrs(factor, force.reshape(-1), lower=1)[0].reshape(force.shape)
            slack_step = bounds.apply(tangent[:, 6:]) + infeasible
            return tangent, slack_step, centre / slack - multiplier - ratio * slack_step

        complementarity = slack * multiplier
        mean = float(complementarity.mean())
        _, slack_step, multiplier_step = direction(0.0)
        reached = (slack + _length(slack, slack_step, 1.0) * slack_step) * (
            multiplier + _length(multiplier, multiplier_step, 1.0) * multiplier_step
        )
        # Below the gap that is asked for, slacks would drown in rounding and multipliers with them.
        least = 0.1 * options.tolerance * max(point.half_cost, _SMALLEST_COST) / slack.size
        barrier = max(mean * min(1.0, float(reached.mean()) / mean) ** 3, least)
        tangent, slack_step, multiplier_step = direction(barrier - slack_step * multiplier_step)
        fraction = options.fraction_to_boundary
        full = np.concatenate([np.zeros((pinned, tangent.shape[1])), tangent])
        directional = float(np.sum(gradient * tangent))
        barrier_slope = -barrier * float(np.sum(slack_step / slack))
        return cls(
            tangent=full,
            slack=slack_step,
            multiplier=multiplier_step,
            primal_length=_length(slack, slack_step, fraction),
            dual_length=_length(multiplier, multiplier_step, fraction),
            barrier=barrier,
            directional=directional,
            predicted_decrease=abs(directional + barrier_slope),
        )


def _line_search(
    problem: Problem, bounds: Bounds, point: _Point, slack: np.ndarray, step: _NewtonStep
) -> tuple[_Point, np.ndarray, float] | None:
    """Return the point and slacks after the longest acceptable step and its length, or None."""
    penalty = 2.0 * float(np.abs(step.multiplier).max(initial=0.0))

    def merit(half_cost: float, slacks: np.ndarray, values: np.ndarray) -> float:
        infeasible = float(np.abs(values - slacks).sum())
        return half_cost - step.barrier * float(np.log(slacks).sum()) + penalty * infeasible

    start = merit(point.half_cost, slack, point.values)
    slope = min(step.directional - step.barrier * float(np.sum(step.slack / slack)), 0.0)
    length = step.primal_length
    for _ in range(8):
        qpos = problem.model.integrate(point.kinematics.qpos, length * step.tangent)
        trial = _Point.at(problem, bounds, qpos)
        slacks = slack + length * step.slack
        # Once a slack has met its inequality the two are the same number: no drift by rounding.
        met = (np.abs(slacks - trial.values) < _ROUNDING) & (trial.values > 0)
        slacks = np.where(met, trial.values, slacks)
        if trial.half_cost < np.inf and merit(trial.half_cost, slacks, trial.values) <= start + 1e-4 * length * slope:
            return trial, slacks, length
        length *= 0.5
    return None


def _inside(problem: Problem, qpos: np.ndarray) -> np.ndarray:
    """Return the start with unknown joint angles well inside their ranges; no step gets longer by it."""
    model = problem.model
    margin = _START_MARGIN * (model.upper - model.lower)
    start = qpos.copy()
    unknown = start[problem.pinned :, 7:]
    np.clip(unknown, model.lower + margin, model.upper - margin, out=unknown)
    return start


def _length(values: np.ndarray, change: np.ndarray, fraction: float) -> float:
    """Return the longest step up to 1 that keeps `fraction` of the distance to zero."""
    ratio = float((change / values).min(initial=0.0))
    return min(1.0, -fraction / ratio) if ratio < 0 else 1.0


def _solution(point: _Point, status: Status, iterations: int, multiplier: np.ndarray) -> Solution:
    return Solution(
        qpos=point.kinematics.qpos,
        multipliers=multiplier,
        status=status,
        iterations=iterations,
        cost=2.0 * point.half_cost,
        cost_by_term=point.by_term,
    )

