"""Rows that keep points of a link, or points near it, at a distance from something."""

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.retargeting.trajopt.rows import FrameRows
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.parts import Frame

LINEAR_BEYOND = 0.03
"""[m]"""


def levers(
    kinematics: Kinematics, frame: Frame, points: Float[np.ndarray, "3 K F"], frames: Int[np.ndarray, "F"]
) -> Float[np.ndarray, "3 K F"]:
    """Return the way [m], in world axes, from a link's origin to points that are given in its frame."""
    return np.einsum("ijf,jkf->ikf", kinematics.orientation(frame)[:, :, frames], points)


def moments(lever: Float[np.ndarray, "3 K F"], normals: Float[np.ndarray, "3 K F"]) -> Float[np.ndarray, "3 K F"]:
    """Return the derivative of the points' way along the normals by the link's angular velocity."""
    (x, y, z), (a, b, c) = lever, normals
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a])


def hinge_rows(  # noqa: PLR0913, PLR0917 - what rows are made of
    frame: Frame,
    lever: Float[np.ndarray, "3 K F"],
    distances: Float[np.ndarray, "K F"],
    normals: Float[np.ndarray, "3 K F"],
    margin: float | Float[np.ndarray, "K F"],
    weight: float | Float[np.ndarray, "F"],
    frames: Int[np.ndarray, "F"],
) -> FrameRows:
    """Return `weight max(0, margin - distance)^2` of every point, as rows of the link that carries the points.

    Deep inside, beyond `LINEAR_BEYOND`, the cost grows in proportion to the depth: what cannot be got out is not torn.

    Args:
        frame: Of the link.
        lever: From the link's origin to the points, in world axes [m].
        distances: Of the points [m].
        normals: World directions in which the distances grow as the points move.
        margin: Distance that costs nothing [m].
        weight: [1/m^2]
        frames: Of the rows.
    """
    residual, slope = softened(np.minimum(distances - margin, 0.0), LINEAR_BEYOND)
    along = np.where(residual < 0.0, slope, 0.0) * normals
    by_linear, by_angular = along, moments(lever, along)
    return FrameRows(frame, residual, by_linear.transpose(1, 0, 2), by_angular.transpose(1, 0, 2), weight, frames)


def softened(
    residual: Float[np.ndarray, "*many"], knee: float
) -> tuple[Float[np.ndarray, "*many"], Float[np.ndarray, "*many"]]:
    """Return residuals whose squares are Huber's cost, quadratic up to the knee and linear beyond, and their slopes."""
    size = np.abs(residual)
    beyond = size > knee
    root = np.sqrt(np.where(beyond, knee * (2.0 * size - knee), 1.0))
    return np.where(beyond, np.sign(residual) * root, residual), np.where(beyond, knee / root, 1.0)
