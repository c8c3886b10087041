"""A solver that keeps its start: programs around a solver can be tried with it in milliseconds."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.retarget.trajopt.bounds import Bounds
from hoi_retarget.retarget.trajopt.problem import Problem, cost_by_term
from hoi_retarget.retarget.trajopt.solvers.base import Solution, Status


@dataclass(frozen=True)
class KeepStart:
    """A solver without options."""

    def solve(self, problem: Problem, qpos: Float[np.ndarray, "T nq"]) -> Solution:
        """Return the start, within the bounds or not, as a solution."""
        by_term = cost_by_term(problem.linearize(problem.model.forward(qpos)))
        return Solution(
            qpos=qpos.copy(),
            multipliers=np.zeros_like(Bounds.of(problem).values(qpos[:, 7:])),
            status=Status.SOLVED if np.isfinite(sum(by_term.values())) else Status.FAILED,
            iterations=0,
            cost=sum(by_term.values()),
            cost_by_term=by_term,
        )
