"""The result of a solver, its optimality recomputed from the problem, and the trivial solver."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import get_lapack_funcs

from hoi_retarget.motion.motion_report import Optimality, Status
from hoi_retarget.retargeting.trajopt.bounds import Bounds
from hoi_retarget.retargeting.trajopt.normal import assemble
from hoi_retarget.retargeting.trajopt.problem import Problem, cost_by_term

FACTOR, SOLVE = get_lapack_funcs(("pbtrf", "pbtrs"), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class SolverResult:
    """A trajectory, the bounds' multipliers and the end of the solve; solved trajectories are within the bounds."""

    qpos: Float[np.ndarray, "T nq"]
    multipliers: Float[np.ndarray, "rows n"]
    status: Status
    iterations: int
    cost: float  # Weighted sum of squares of all terms.
    cost_by_term: dict[str, float]


def optimality(problem: Problem, result: SolverResult) -> Optimality:
    """Return the residuals of the optimality conditions, computed from the problem."""
    bounds = Bounds.of(problem)
    kinematics = problem.model.forward(result.qpos)
    linearization = problem.linearize(kinematics)
    rows = [part for parts in linearization.values() for part in parts]
    unknown = problem.unknown(len(result.qpos))
    normal = assemble(kinematics, rows)
    gradient = normal.gradient[unknown].copy()
    gradient[:, 6:] -= bounds.apply_transposed(result.multipliers)
    slack = bounds.values(result.qpos[:, 7:])
    half_cost = 0.5 * sum(cost_by_term(linearization).values())
    return Optimality(
        stationarity=_newton_decrement(normal.band[unknown], gradient) / max(half_cost, 1e-12),
        complementarity=float(np.sum(np.abs(slack * result.multipliers))) / max(half_cost, 1e-12),
        violation=float(max(0.0, -slack.min(initial=0.0))),
    )


def _newton_decrement(band: np.ndarray, gradient: np.ndarray) -> float:
    """Return `g^T H^-1 g / 2`; infinite where H is not positive definite."""
    factor, info = FACTOR(band.reshape(gradient.size, -1).T, lower=1)
    if info != 0:
        return float("inf")
    step = SOLVE(factor, gradient.reshape(-1), lower=1)[0]
    return 0.5 * float(gradient.reshape(-1) @ step)


def keep_start(problem: Problem, qpos: Float[np.ndarray, "T nq"]) -> SolverResult:
    """Return the starting trajectory as solved, with its cost; joint ranges and speeds stay broken where they are."""
    by_term = cost_by_term(problem.linearize(problem.model.forward(qpos)))
    cost = sum(by_term.values())
    multipliers = np.zeros_like(Bounds.of(problem).values(qpos[:, 7:]))
    status = Status.SOLVED if np.isfinite(cost) else Status.FAILED
    return SolverResult(qpos.copy(), multipliers, status, 0, cost, by_term)
