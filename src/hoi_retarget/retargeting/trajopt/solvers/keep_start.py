"""The trivial solver: a start is its own solution."""

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.report import Status
from hoi_retarget.retargeting.trajopt.bounds import Bounds
from hoi_retarget.retargeting.trajopt.problem import Problem, cost_by_term
from hoi_retarget.retargeting.trajopt.solvers.base import Solution


def solve(problem: Problem, qpos: Float[np.ndarray, "T nq"]) -> Solution:
    """Return the starting trajectory as solved, with its cost; joint ranges and speeds stay broken where they are."""
    by_term = cost_by_term(problem.linearize(problem.model.forward(qpos)))
    cost = sum(by_term.values())
    multipliers = np.zeros_like(Bounds.of(problem).values(qpos[:, 7:]))
    status = Status.SOLVED if np.isfinite(cost) else Status.FAILED
    return Solution(qpos.copy(), multipliers, status, 0, cost, by_term)
