"""Normal equations of a linearized problem, in the lower band storage of LAPACK.

For one frame, `J^T W J` over all rows that depend on the poses of frames is assembled the way a mass matrix
is: each row gives a symmetric 6 x 6 matrix in the space of twists at the root, a subtree's matrices
add up, and the entry of two hinges is one product of their motion axes with the matrix of the
subtree they share (composite rigid bodies; Featherstone, Rigid Body Dynamics Algorithms, ch. 6).
The cost per frame is then independent of how many frames the terms follow. Frames are coupled
by difference rows alone, which reach a few frames back: the matrix is banded.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.kernels.tree_sums import RowSums
from hoi_retarget.retargeting.trajopt.problem import FrameRows, PairRows, Rows, StencilRows, TangentRows
from hoi_retarget.robots.model import Kinematics


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """`band[t, c, k]` couples coordinate `c` of frame `t` with the one `k` places further on."""

    band: Float[np.ndarray, "T nv width"]
    gradient: Float[np.ndarray, "T nv"]  # `J^T W r`, the gradient of half the cost.


def assemble(kinematics: Kinematics, rows: Iterable[Rows], *, least_width: int = 0) -> NormalEquations:
    """Return the normal equations of all rows, with at least so many diagonals."""
    rows = tuple(rows)
    model, frames = kinematics.model, len(kinematics.qpos)
    width = max([least_width, model.nv, *(_width(part, model.nv) for part in rows)])
    band = np.zeros((frames, model.nv, width))
    gradient = np.zeros((frames, model.nv))
    _add_frame_rows(band, gradient, kinematics, [part for part in rows if isinstance(part, FrameRows)])
    for part in rows:
        if isinstance(part, StencilRows):
            _add_stencil_rows(band, gradient, part)
        elif isinstance(part, TangentRows):
            _add_tangent_rows(band, gradient, part)
        elif isinstance(part, PairRows):
            _add_pair_rows(band, gradient, kinematics, part)
    if model.fixed_columns.any():
        _fix(band, gradient, model.fixed_columns)
    return NormalEquations(band, gradient)


def _fix(band: np.ndarray, gradient: np.ndarray, fixed: Bool[np.ndarray, "nv"]) -> None:
    """Take coordinates out of the equations in place: their step is zero to the bit."""
    nv = gradient.shape[1]
    gradient[:, fixed] = 0.0
    later = (np.arange(nv)[:, None] + np.arange(band.shape[2])) % nv
    band[:, fixed[later]] = 0.0
    band[:, fixed] = 0.0
    band[:, fixed, 0] = 1.0


def _width(part: Rows, nv: int) -> int:
    """Return the number of diagonals that a row fills: between frames it couples few coordinates."""
    if isinstance(part, StencilRows):
        return (len(part.coefficients) - 1) * nv + 1
    if isinstance(part, TangentRows):
        return (len(part.jacobian) - 1) * nv + max(part.columns) - min(part.columns) + 1
    return nv


def _add_frame_rows(band: np.ndarray, gradient: np.ndarray, kinematics: Kinematics, parts: list[FrameRows]) -> None:
    if not parts:
        return
    model = kinematics.model
    sums = RowSums(len(gradient), model.n + 1)
    for part in parts:
        lever = kinematics.point(part.frame) - kinematics.node_position[:, 0]
        by = part.by_linear, part.by_angular
        sums.add(part.frame.node, part.residual, *by, lever, part.weight, part.frames)
    tree = model.parents, kinematics.motion_axes, model.column_nodes, model.moving_columns
    sums.to_band(*tree, band, gradient)


def _at_root(part: FrameRows, kinematics: Kinematics) -> tuple[slice, np.ndarray]:
    """Return which coordinates of the twist at the root a row depends on, and its Jacobian by them.

    The linear velocity of a frame is `v + omega x lever`, with v at the root.
    """
    if part.by_linear is None:
        assert part.by_angular is not None, "a row depends on something"
        return slice(3, 6), part.by_angular
    lever = kinematics.point(part.frame) - kinematics.node_position[:, 0]
    if part.frames is not None:
        lever = lever[:, part.frames]
    jacobian = np.empty((len(part.residual), 6, lever.shape[1]))
    jacobian[:, :3] = part.by_linear
    (x, y, z), (by_x, by_y, by_z) = lever, part.by_linear.transpose(1, 0, 2)
    jacobian[:, 3] = y * by_z - z * by_y
    jacobian[:, 4] = z * by_x - x * by_z
    jacobian[:, 5] = x * by_y - y * by_x
    if part.by_angular is not None:
        jacobian[:, 3:] += part.by_angular
    return slice(0, 6), jacobian


def _add_stencil_rows(band: np.ndarray, gradient: np.ndarray, part: StencilRows) -> None:
    nv = gradient.shape[1]
    count = part.residual.shape[1]
    weighted = part.weight * part.residual.T
    for later, a in enumerate(part.coefficients):
        gradient[later : later + count, part.columns] += a * weighted
        for earlier, b in enumerate(part.coefficients[: later + 1]):
            diagonal = (later - earlier) * nv
            band[earlier : earlier + count, part.columns, diagonal] += part.weight * a * b


def _add_tangent_rows(band: np.ndarray, gradient: np.ndarray, part: TangentRows) -> None:
    nv = gradient.shape[1]
    columns = np.array(part.columns)
    count = part.residual.shape[1]
    for later, jacobian in enumerate(part.jacobian):
        weighted = part.weight * jacobian
        gradient[later : later + count, columns] += np.einsum("mkt,mt->tk", weighted, part.residual)
        for earlier in range(later + 1):
            block = np.einsum("mrt,mct->trc", weighted, part.jacobian[earlier])
            row, column = np.tril_indices(len(columns)) if later == earlier else np.indices(block.shape[1:])
            place = (later - earlier) * nv + columns[row] - columns[column]
            band[earlier : earlier + count, columns[column], place] += block[:, row, column]


def _add_pair_rows(band: np.ndarray, gradient: np.ndarray, kinematics: Kinematics, part: PairRows) -> None:
    """Add rows between two links: only hinges on the way from one to the other move them against each other."""
    model, rows = kinematics.model, part.of
    moves = (model.supports[:, rows.frame.node] - model.supports[:, part.other.node])[model.column_nodes]
    columns = np.flatnonzero(moves)
    twist, at_root = _at_root(rows, kinematics)
    active = np.flatnonzero(at_root.any(axis=(0, 1)))
    if not active.size or not columns.size:
        return
    frames = active if rows.frames is None else rows.frames[active]
    axes = kinematics.motion_axes[twist][:, columns[:, None], frames] * moves[columns, None]
    jacobian = np.einsum("mat,act->tmc", at_root[:, :, active], axes)
    weight = np.broadcast_to(rows.weight, rows.residual.shape[1:])[active]
    weighted = jacobian * weight[:, None, None]
    gradient[frames[:, None], columns] += np.einsum("tmc,mt->tc", weighted, rows.residual[:, active])
    block = np.matmul(weighted.transpose(0, 2, 1), jacobian)
    row, column = np.tril_indices(len(columns))
    band[frames[:, None], columns[column], columns[row] - columns[column]] += block[:, row, column]
