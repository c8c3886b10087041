"""The nonlinear least-squares problem over the frames of one window (paper Eq. 2)."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from hoi_retarget.retargeting.trajopt.rows import Rows, cost
from hoi_retarget.robots.model import Kinematics, RobotModel


@runtime_checkable
class Term(Protocol):
    """One row of the cost table: a residual and its Jacobian for all frames at once."""

    @property
    def name(self) -> str:
        """Name in reports and tables."""
        ...

    def rows(self, kinematics: Kinematics) -> tuple[Rows, ...]:
        """Return weighted residual rows at a trajectory."""
        ...


@dataclass(frozen=True, eq=False)
class Problem:
    """Minimize the sum of the terms' costs within joint ranges and joint speeds.

    The unknowns are the configurations of the frames that are not pinned.
    """

    model: RobotModel
    terms: tuple[Term, ...]
    fps: float
    pinned: int = 0
    """Leading frames that stay as they are given to the solver (paper Eq. 2d)."""
    pinned_after: int = 0
    """Trailing frames that do: a piece out of the middle of a clip is then solved without a seam."""

    @property
    def step_limits(self) -> Float[np.ndarray, "n"]:
        """Largest change of each joint between two frames [rad]."""
        return self.model.speed_limits / self.fps

    def unknown(self, frames: int) -> slice:
        """Return which of a window's frames are unknowns."""
        return slice(self.pinned, frames - self.pinned_after)

    def linearize(self, kinematics: Kinematics) -> dict[str, tuple[Rows, ...]]:
        """Return the rows of every term at a trajectory, by name."""
        return {term.name: term.rows(kinematics) for term in self.terms}


def cost_by_term(linearization: dict[str, tuple[Rows, ...]]) -> dict[str, float]:
    """Return the cost of every term."""
    return {name: sum(cost(rows) for rows in parts) for name, parts in linearization.items()}
