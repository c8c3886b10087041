"""The nonlinear least-squares problem over the frames of one window (paper Eq. 2).

Residuals of a cost term and their Jacobians are for all frames at once; time is the last axis. A term's cost is the
sum over its rows of `weight * residual**2`, with the weights of the paper's table. Four kinds of rows exist, so that a
solver can use their structure.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.robots.frames import Frame
from hoi_retarget.robots.model import Kinematics, RobotModel


@dataclass(frozen=True, eq=False)
class FrameRows:
    """Residuals that depend on the pose of one frame fixed to a node: Jacobians with respect to its world twist."""

    frame: Frame
    residual: Float[np.ndarray, "m rows"]
    by_linear: Float[np.ndarray, "m 3 rows"] | None
    """By the linear velocity of its origin in world axes [m]; None where the residual does not depend on it."""
    by_angular: Float[np.ndarray, "m 3 rows"] | None  # By its angular velocity in world axes [rad]; None likewise.
    weight: float | Float[np.ndarray, "rows"]
    frames: Int[np.ndarray, "rows"] | None = None
    """Frames of the trajectory, each at most once, that the rows belong to; None for all of them."""


@dataclass(frozen=True, eq=False)
class PairRows:
    """Residuals that depend on the pose of one frame seen from another link.

    Their Jacobians are by the twist of the one frame, less the twist that it would have if it were fixed to the other.
    """

    of: FrameRows
    other: Frame

    @property
    def residual(self) -> Float[np.ndarray, "m rows"]:
        """Residuals of the rows, in their unit."""
        return self.of.residual

    @property
    def weight(self) -> float | Float[np.ndarray, "rows"]:
        """Weight of the rows: one over the square of their unit."""
        return self.of.weight


@dataclass(frozen=True, eq=False)
class StencilRows:
    """Linear differences over time of single tangent coordinates with constant coefficients.

    Residual `[:, i]` belongs to frame `i + len(coefficients) - 1`; its derivative by coordinate
    `columns[k]` of frame `i + o` is `coefficients[o]`.
    """

    columns: slice
    coefficients: tuple[float, ...]
    residual: Float[np.ndarray, "k rows"]
    weight: float


@dataclass(frozen=True, eq=False)
class TangentRows:
    """Residuals that depend on a few tangent coordinates of a few consecutive frames.

    `jacobian[o]` is the derivative by frame `i + o` for residual `[:, i]`; columns are in ascending order.
    """

    columns: tuple[int, ...]
    residual: Float[np.ndarray, "m rows"]
    jacobian: Float[np.ndarray, "span m k rows"]
    weight: float


Rows = FrameRows | PairRows | StencilRows | TangentRows


def cost(rows: Rows) -> float:
    """Return the weighted sum of squares [unitless]."""
    return float(np.sum(rows.weight * np.einsum("mt,mt->t", rows.residual, rows.residual)))


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
    pinned: int = 0  # Leading frames that stay as they are given to the solver (paper Eq. 2d).
    pinned_after: int = 0  # Trailing frames that do: a piece out of the middle of a clip is then solved without a seam.

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
    """Return the cost [unitless] of every term."""
    return {name: sum(cost(rows) for rows in parts) for name, parts in linearization.items()}
