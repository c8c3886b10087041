"""Primal-dual interior-point Gauss-Newton method on a banded normal matrix.

The inequalities get slacks `s` and multipliers `z`; Newton's equations for

    J^T W r - A^T z = 0,   s z = mu,   c(theta) - s = 0

are reduced to the tangent coordinates, where the inequalities add only to the diagonal and to one
off-diagonal of the band. A predictor step sets how far `mu` falls (Mehrotra, SIAM J. Optim. 2,
1992); a backtracking line search on a merit function makes the method converge from far away.

Costs of distances between surfaces have kinks, and hold solutions against bounds. With these, `mu` falls no faster
than the decrease that a step predicts, or bounds would cut all steps short; and a step that the line search refuses
adds curvature (`kink_curvature`), where it would add damping. At an edge the gradient changes far more along a step
than `J^T W J` says. What it changes beyond that is added as a matrix of rank one in each frame, so that the next step
goes along the kink (structured secant updates; Dennis, Gay and Welsch, ACM Trans. Math. Softw. 7, 1981).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import get_blas_funcs

from hoi_retarget.motion.motion_report import Status
from hoi_retarget.retargeting.trajopt.bounds import Bounds
from hoi_retarget.retargeting.trajopt.normal import assemble
from hoi_retarget.retargeting.trajopt.problem import Problem, Rows, cost_by_term
from hoi_retarget.retargeting.trajopt.solvers.solver import BandedInteriorPoint, Effort
from hoi_retarget.retargeting.trajopt.solvers.solver_result import FACTOR, SOLVE, SolverResult, optimality
from hoi_retarget.robots.model import Kinematics

_ROUNDING = 1e-12
_FEASIBLE = 1e-7  # [rad]
_START_GAP = 0.1  # Complementarity gap at the start, relative to the cost.
_LEAST_SLACK = 1e-3  # Of a bound's interval: less than this counts as outside.
# Levenberg-Marquardt damping, relative to the diagonal: it grows when steps are cut short.
_LONGEST_SEARCH = 8  # Halvings of a step.
_LEAST_DAMPING, _FIRST_DAMPING, _LARGEST_DAMPING = 1e-9, 1e-3, 1e3
_CURVATURE_LEFT = 0.1  # Of that of kinks, after a step that the line search takes at once.
_SMALLEST_COST = 1e-9  # What accuracies relative to the cost are measured against when it vanishes.


@dataclass(frozen=True, eq=False)
class Refused:
    """A trajectory that a line search refused."""

    kinematics: Kinematics
    rows: list[Rows]
    step: Float[np.ndarray, "U nv"]  # That leads to it, in tangent coordinates [m, rad].


def solve(
    options: BandedInteriorPoint, problem: Problem, qpos: Float[np.ndarray, "T nq"], effort: Effort
) -> SolverResult:
    """Return the result from a starting trajectory; joints outside their range are moved in.

    A solve that ends unsolved begins again, without damping steps that bounds alone cut short. Where costs have kinks,
    bounds never damp, and nothing begins again.

    `options`: tolerances and limits; `problem`: of the trajectory's frames; `qpos`: the start [m, rad]; `effort`:
    whether it begins again, has kinks, and how far inside the bounds it starts.
    """
    result = _solve_once(options, problem, qpos, effort, bounds_damp=not effort.kinks)
    if effort.kinks or not effort.restarts or result.status in {Status.SOLVED, Status.FAILED}:
        return result
    second = _solve_once(options, problem, qpos, effort, bounds_damp=False)
    return second if second.status is Status.SOLVED else result


def _solve_once(
    options: BandedInteriorPoint,
    problem: Problem,
    qpos: Float[np.ndarray, "T nq"],
    effort: Effort,
    *,
    bounds_damp: bool,
) -> SolverResult:
    """Return the result at the end of the iteration.

    A step that a bound cuts short says nothing against the model that it is from. Damped all the same, a solve that
    many bounds hold up creeps: the damping outweighs all but jerk. Other solves need 4 % fewer iterations with it.
    """
    bounds, kinks = Bounds.of(problem), effort.kinks
    state = _start(problem, bounds, qpos, effort.start_margin)
    if not np.isfinite(state.point.half_cost):
        return state.solution(Status.FAILED, 0)
    for iteration in range(1, options.max_iterations + 1):
        step = _newton_step(options, problem, bounds, state, kinks=kinks)
        moved, refused = None, None
        if step is not None:
            state = replace(state, curvature=step.curvature, refused=None)
            moved, refused = _line_search(problem, bounds, state, step, bounds_damp=bounds_damp)
        if step is None or moved is None:
            if state.damping > _LARGEST_DAMPING:
                return _ended(options, problem, state.solution(Status.STALLED, iteration))
            damping = max(10.0 * state.damping, _FIRST_DAMPING)
            state = replace(state, damping=damping, refused=refused if kinks else None)
            continue
        state = _past_kinks(moved, state, refused) if kinks else moved
        if _solved(options, state, step):
            return state.solution(Status.SOLVED, iteration)
    return _ended(options, problem, state.solution(Status.MAX_ITERATIONS, options.max_iterations))


def _past_kinks(moved: "_Iterate", before: "_Iterate", refused: Refused | None) -> "_Iterate":
    """Return where a step led, with the curvature of the kinks beside it in place of damping."""
    curvature = before.curvature
    if curvature is not None and refused is None:
        curvature = _CURVATURE_LEFT * curvature
    return replace(moved, damping=_next_damping(before.damping, 1.0), curvature=curvature, refused=refused)


def _ended(options: BandedInteriorPoint, problem: Problem, solution: SolverResult) -> SolverResult:
    """Return a solution that cannot be improved further: solved, where it is optimal to the tolerance all the same.

    Along directions that hardly cost anything, such as those of a stretched knee, steps stay long and damped.
    """
    quality = optimality(problem, solution)
    reached = quality.stationarity < options.tolerance and quality.complementarity < 10 * options.tolerance
    return replace(solution, status=Status.SOLVED) if reached and quality.violation < _FEASIBLE else solution


def _solved(options: BandedInteriorPoint, state: "_Iterate", step: "_Step") -> bool:
    accuracy = options.tolerance * max(state.point.half_cost, _SMALLEST_COST)
    return (
        step.predicted_decrease < accuracy
        and step.primal_length * float(np.abs(step.tangent).max(initial=0.0)) < options.step_tolerance
        and float(np.sum(state.slack * state.multiplier)) < 10 * accuracy
        and state.damping < _FIRST_DAMPING
        and float(np.abs(state.slack - state.point.values).max(initial=0.0)) < _FEASIBLE
    )


@dataclass(frozen=True, eq=False)
class _Point:
    """A trajectory with everything that is computed from it once."""

    kinematics: Kinematics
    rows: list[Rows]
    half_cost: float
    by_term: dict[str, float]
    values: np.ndarray  # Slacks of the inequalities.

    @classmethod
    def at(cls, problem: Problem, bounds: Bounds, qpos: np.ndarray) -> "_Point":
        kinematics = problem.model.forward(qpos)
        linearization = problem.linearize(kinematics)
        by_term = cost_by_term(linearization)
        rows = [part for parts in linearization.values() for part in parts]
        return cls(kinematics, rows, 0.5 * sum(by_term.values()), by_term, bounds.values(qpos[:, 7:]))


@dataclass(frozen=True, eq=False)
class _Iterate:
    """Where the iteration stands."""

    point: _Point
    slack: np.ndarray
    multiplier: np.ndarray
    damping: float
    curvature: np.ndarray | None = None  # (U, nv, nv): of kinks.
    refused: Refused | None = None  # Of the last line search, where it tells of a kink.

    def solution(self, status: Status, iterations: int) -> SolverResult:
        return SolverResult(
            qpos=self.point.kinematics.qpos,
            multipliers=self.multiplier,
            status=status,
            iterations=iterations,
            cost=2.0 * self.point.half_cost,
            cost_by_term=self.point.by_term,
        )


@dataclass(frozen=True, eq=False)
class _Step:
    tangent: np.ndarray  # (U, nv): of the frames that are not pinned.
    slack: np.ndarray
    multiplier: np.ndarray
    primal_length: float
    dual_length: float
    barrier: float
    slope: float  # Derivative of the half cost and its barrier along the step.
    curvature: np.ndarray | None

    @property
    def predicted_decrease(self) -> float:
        """Of the half cost and its barrier along the step [unitless]."""
        return abs(self.slope)


def _start(problem: Problem, bounds: Bounds, qpos: np.ndarray, start_margin: float) -> _Iterate:
    """Return the start, with unknown joint angles well inside their ranges."""
    model = problem.model
    margin = start_margin * (model.upper - model.lower)
    inside = qpos.copy()
    unknown = inside[problem.unknown(len(inside)), 7:]
    np.clip(unknown, model.lower + margin, model.upper - margin, out=unknown)
    point = _Point.at(problem, bounds, inside)
    slack = np.maximum(point.values, _LEAST_SLACK * bounds.widths(len(point.values)))
    multiplier = max(_START_GAP * point.half_cost / slack.size, _SMALLEST_COST) / slack
    return _Iterate(point, slack, multiplier, _LEAST_DAMPING)


def _newton_step(
    options: BandedInteriorPoint, problem: Problem, bounds: Bounds, state: _Iterate, *, kinks: bool
) -> _Step | None:
    """Return the predictor-corrector step, or None where the matrix is not positive definite."""
    point, slack, multiplier = state.point, state.slack, state.multiplier
    normal = assemble(point.kinematics, point.rows, least_width=bounds.width)
    unknown = problem.unknown(len(normal.band))
    band, gradient = normal.band[unknown], normal.gradient[unknown]
    curvature = add_known_kinks(band, gradient, unknown, state.curvature, state.refused)
    band[:, :, 0] *= 1.0 + state.damping
    ratio = multiplier / slack
    bounds.add_normal(band, ratio)
    factor, info = FACTOR(band.reshape(gradient.size, -1).T, lower=1, overwrite_ab=1)
    if info != 0:
        return None
    infeasible = point.values - slack

    def direction(centre: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        force = -gradient
        force[:, 6:] += bounds.apply_transposed(centre / slack - ratio * infeasible)
        tangent = SOLVE(factor, force.reshape(-1), lower=1)[0].reshape(force.shape)
        slack_step = bounds.apply(tangent[:, 6:]) + infeasible
        return tangent, slack_step, centre / slack - multiplier - ratio * slack_step

    mean = float(np.mean(slack * multiplier))
    affine, slack_step, multiplier_step = direction(0.0)
    primal, dual = _length(slack, slack_step, 1.0), _length(multiplier, multiplier_step, 1.0)
    reached = float(np.mean((slack + primal * slack_step) * (multiplier + dual * multiplier_step)))
    # Below the gap of the tolerance, slacks would drown in rounding and multipliers with them.
    least = 0.1 * options.tolerance * max(point.half_cost, _SMALLEST_COST)
    if kinks:
        least = max(least, min(abs(float(np.sum(gradient * affine))), point.half_cost))
    barrier = max(mean * min(1.0, reached / mean) ** 3, least / slack.size)
    tangent, slack_step, multiplier_step = direction(barrier - slack_step * multiplier_step)
    return _Step(
        tangent=tangent,
        slack=slack_step,
        multiplier=multiplier_step,
        primal_length=_length(slack, slack_step, options.fraction_to_boundary),
        dual_length=_length(multiplier, multiplier_step, options.fraction_to_boundary),
        barrier=barrier,
        slope=float(np.sum(gradient * tangent)) - barrier * float(np.sum(slack_step / slack)),
        curvature=curvature,
    )


def _line_search(
    problem: Problem, bounds: Bounds, state: _Iterate, step: _Step, *, bounds_damp: bool
) -> tuple[_Iterate | None, Refused | None]:
    """Return the state after the longest acceptable step, or None, and what was refused last, seen from there."""
    penalty = 2.0 * float(np.abs(step.multiplier).max(initial=0.0))

    def merit(point: _Point, slack: np.ndarray) -> float:
        infeasible = float(np.abs(point.values - slack).sum())
        return point.half_cost - step.barrier * float(np.log(slack).sum()) + penalty * infeasible

    start, slope = merit(state.point, state.slack), min(step.slope, 0.0)
    qpos = state.point.kinematics.qpos
    unknown = problem.unknown(len(qpos))
    length, refused = step.primal_length, None
    for _ in range(_LONGEST_SEARCH):
        moved = qpos.copy()
        moved[unknown] = problem.model.integrate(qpos[unknown], length * step.tangent)
        trial = _Point.at(problem, bounds, moved)
        slack = state.slack + length * step.slack
        # Once a slack has met its inequality the two are the same number: no drift by rounding.
        met = (np.abs(slack - trial.values) < _ROUNDING) & (trial.values > 0)
        slack = np.where(met, trial.values, slack)
        if trial.half_cost < np.inf and merit(trial, slack) <= start + 1e-4 * length * slope:
            multiplier = state.multiplier + step.dual_length * step.multiplier
            taken = length if bounds_damp else length / step.primal_length
            moved = _Iterate(trial, slack, multiplier, _next_damping(state.damping, taken))
            return moved, None if refused is None else Refused(refused.kinematics, refused.rows, length * step.tangent)
        refused = trial
        length *= 0.5
    return None, None if refused is None else Refused(refused.kinematics, refused.rows, 2.0 * length * step.tangent)


def _next_damping(damping: float, length: float) -> float:
    if length < 0.25:
        return max(10.0 * damping, _FIRST_DAMPING)
    return max(0.1 * damping, _LEAST_DAMPING) if length > 0.75 else damping


def _length(values: np.ndarray, change: np.ndarray, fraction: float) -> float:
    """Return the longest step up to 1 that leaves each value at least `1 - fraction` of itself."""
    ratio = float((change / values).min(initial=0.0))
    return min(1.0, -fraction / ratio) if ratio < 0 else 1.0


_LEAST_SHARE = 0.05
"""Of a frame's change of gradient that is along the step: with less, the change is not of a kink across the step."""

(_MULTIPLY,) = get_blas_funcs(("sbmv",), dtype=np.float64)


def add_known_kinks(
    band: Float[np.ndarray, "U nv width"],
    gradient: Float[np.ndarray, "U nv"],
    unknown: slice,
    known: Float[np.ndarray, "U nv nv"] | None,
    refused: Refused | None,
) -> Float[np.ndarray, "U nv nv"] | None:
    """Return the curvature [1/m^2, 1/rad^2] of all kinks that are known, and add it to a band in place.

    Args: `band`: of the normal equations; `gradient`: of half the cost; `unknown`: frames that are not pinned; `known`:
    curvature that was found before; `refused`: tells of a further kink.
    """
    if known is not None:
        add_curvature(band, known)
    if refused is None:
        return known
    beyond = assemble(refused.kinematics, refused.rows).gradient[unknown]
    found = kink_curvature(band, refused.step, beyond - gradient)
    add_curvature(band, found)
    return found if known is None else known + found


def kink_curvature(
    band: Float[np.ndarray, "U nv width"], step: Float[np.ndarray, "U nv"], change: Float[np.ndarray, "U nv"]
) -> Float[np.ndarray, "U nv nv"]:
    """Return the curvature of each frame that explains a gradient's change along a step; zero where it is not positive.

    The band has the known curvature; the step is in tangent coordinates [m, rad].
    """
    flat = band.reshape(step.size, -1).T
    excess = change - _MULTIPLY(len(flat) - 1, 1.0, flat, step.reshape(-1), lower=1).reshape(step.shape)
    along = np.einsum("ti,ti->t", excess, step)
    clear = along > _LEAST_SHARE * np.linalg.norm(excess, axis=1) * np.linalg.norm(step, axis=1)
    share = np.divide(1.0, along, out=np.zeros_like(along), where=clear)
    return np.einsum("t,ti,tj->tij", share, excess, excess)


def add_curvature(band: Float[np.ndarray, "U nv width"], curvature: Float[np.ndarray, "U nv nv"]) -> None:
    """Add the curvature of each frame to a band in place."""
    row, column = np.tril_indices(curvature.shape[1])
    band[:, column, row - column] += curvature[:, row, column]
