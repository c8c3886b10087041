"""Residuals of a cost term and their Jacobians, for all frames of a trajectory at once.

Time is the last axis. A term's cost is the sum over its rows of `weight * residual**2`, with the
weights of the paper's table. Four kinds of rows exist, so that a solver can use their structure.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.robots.parts import Frame


@dataclass(frozen=True, eq=False)
class FrameRows:
    """Residuals that depend on the pose of one frame fixed to a node: Jacobians with respect to its world twist."""

    frame: Frame
    residual: Float[np.ndarray, "m rows"]
    by_linear: Float[np.ndarray, "m 3 rows"] | None
    """By the linear velocity of its origin in world axes [m]; None where the residual does not depend on it."""
    by_angular: Float[np.ndarray, "m 3 rows"] | None
    """By its angular velocity in world axes [rad]; None likewise."""
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
        """Residuals of the rows."""
        return self.of.residual

    @property
    def weight(self) -> float | Float[np.ndarray, "rows"]:
        """Weight of the rows."""
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

    `jacobian[o]` is the derivative by frame `i + o` for residual `[:, i]`.
    """

    columns: tuple[int, ...]
    residual: Float[np.ndarray, "m rows"]
    jacobian: Float[np.ndarray, "span m k rows"]
    weight: float


Rows = FrameRows | PairRows | StencilRows | TangentRows


def cost(rows: Rows) -> float:
    """Return the weighted sum of squares."""
    return float(np.sum(rows.weight * np.einsum("mt,mt->t", rows.residual, rows.residual)))
