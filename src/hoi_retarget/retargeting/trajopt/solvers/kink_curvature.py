"""Curvature that Gauss-Newton does not have: of kinks and edges, measured along steps that a line search refused.

The direction away from a surface turns sharply at an edge, and jumps between two samples of a distance. The gradient
then changes far more along a step than `J^T W J` says, and steps to and fro across the kink get nowhere. What it
changes beyond that is added as a matrix of rank one in each frame, so that the next step goes along the kink
(structured secant updates; Dennis, Gay and Welsch, ACM Trans. Math. Softw. 7, 1981).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import get_blas_funcs

from hoi_retarget.retargeting.trajopt.normal import assemble
from hoi_retarget.retargeting.trajopt.problem import Rows
from hoi_retarget.robots.model import Kinematics

_LEAST_SHARE = 0.05
"""Of a frame's change of gradient that is along the step: with less, the change is not of a kink across the step."""

(_MULTIPLY,) = get_blas_funcs(("sbmv",), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Refused:
    """A trajectory that a line search refused."""

    kinematics: Kinematics
    rows: list[Rows]
    step: Float[np.ndarray, "U nv"]
    """That leads to it, in tangent coordinates [m, rad]."""


def add_known_kinks(
    band: Float[np.ndarray, "U nv width"],
    gradient: Float[np.ndarray, "U nv"],
    unknown: slice,
    known: Float[np.ndarray, "U nv nv"] | None,
    refused: Refused | None,
) -> Float[np.ndarray, "U nv nv"] | None:
    """Return the curvature [1/m^2, 1/rad^2] of all kinks that are known, and add it to a band in place.

    Args:
        band: Of the normal equations.
        gradient: Of half the cost.
        unknown: Frames that are not pinned.
        known: Curvature that was found before.
        refused: Tells of a further kink.
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
