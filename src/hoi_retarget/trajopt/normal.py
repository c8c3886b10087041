"""Normal equations of a linearized problem, in the lower band storage of LAPACK.

For one frame, `J^T W J` over all rows that depend on site poses is assembled the way a mass matrix
is: each row gives a symmetric 6 x 6 matrix in the space of twists at the root, a subtree's matrices
add up, and the entry of two hinges is one product of their motion axes with the matrix of the
subtree they share (composite rigid bodies; Featherstone, Rigid Body Dynamics Algorithms, ch. 6).
The cost per frame is then independent of how many sites a term table follows. Frames are coupled
by difference rows alone, which reach a few frames back: the matrix is banded.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.trajopt.rows import Rows, SiteRows, StencilRows, TangentRows, span


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """`band[t, c, k]` couples coordinate `c` of frame `t` with the one `k` places further on."""

    band: Float[np.ndarray, "T nv width"]
    gradient: Float[np.ndarray, "T nv"]
    """`J^T W r`, the gradient of half the cost."""


def assemble(kinematics: Kinematics, rows: Iterable[Rows], *, reach: int) -> NormalEquations:
    """Return the normal equations of all rows; `reach` is the number of coupled earlier frames."""
    rows = tuple(rows)
    model, frames = kinematics.model, len(kinematics.qpos)
    band = np.zeros((frames, model.nv, (reach + 1) * model.nv))
    gradient = np.zeros((frames, model.nv))
    _add_site_rows(band, gradient, kinematics, [part for part in rows if isinstance(part, SiteRows)])
    for part in rows:
        if isinstance(part, StencilRows):
            _add_stencil_rows(band, gradient, part)
        elif isinstance(part, TangentRows):
            _add_tangent_rows(band, gradient, part)
    return NormalEquations(band, gradient)


def reach_of(rows: Iterable[Rows]) -> int:
    """Return how many earlier frames a frame is coupled with."""
    return max((span(part) - 1 for part in rows), default=0)


def _add_site_rows(
    band: np.ndarray, gradient: np.ndarray, kinematics: Kinematics, parts: list[SiteRows]
) -> None:
    if not parts:
        return
    model = kinematics.model
    nodes, matrices, forces = _twist_space(kinematics, parts)
    frames = len(gradient)
    carried = model.supports[:, nodes]
    composite = (carried @ matrices.reshape(len(nodes), -1)).reshape(-1, 6, 6, frames)
    wrench = (carried @ forces.reshape(len(nodes), -1)).reshape(-1, 6, frames)
    column_nodes = _column_nodes(model)
    axes = kinematics.motion_axes
    gradient += np.einsum("act,cat->tc", axes, wrench[column_nodes])
    momentum = np.einsum("cabt,bct->tac", composite[column_nodes], axes)
    products = np.matmul(np.ascontiguousarray(axes.transpose(2, 1, 0)), momentum)
    row, column = _coupled_pairs(model)
    band[:, column, row - column] += products[:, column, row]


def _twist_space(kinematics: Kinematics, parts: list[SiteRows]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the nodes with rows, their 6 x 6 matrices and their generalized forces at the root."""
    sites = kinematics.model.sites
    by_node: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for part in parts:
        node = int(sites.nodes[sites.index[part.site]])
        lever = kinematics.point(part.site) - kinematics.node_position[:, 0]
        jacobian = _at_root(part.jacobian, lever)
        weighted = jacobian * part.weight
        matrix = np.einsum("mat,mbt->abt", weighted, jacobian)
        force = np.einsum("mat,mt->at", weighted, part.residual)
        if node in by_node:
            matrix, force = matrix + by_node[node][0], force + by_node[node][1]
        by_node[node] = matrix, force
    matrices, forces = zip(*by_node.values(), strict=True)
    return np.array(list(by_node)), np.stack(matrices), np.stack(forces)


def _at_root(jacobian: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """Return a Jacobian by the twist at the root: the site's linear velocity is v + omega x lever."""
    moved = jacobian.copy()
    x, y, z = lever
    moved[:, 3] += y * jacobian[:, 2] - z * jacobian[:, 1]
    moved[:, 4] += z * jacobian[:, 0] - x * jacobian[:, 2]
    moved[:, 5] += x * jacobian[:, 1] - y * jacobian[:, 0]
    return moved


def _column_nodes(model: RobotModel) -> np.ndarray:
    return np.concatenate([np.zeros(6, dtype=int), np.arange(1, model.n + 1)])


def _coupled_pairs(model: RobotModel) -> tuple[np.ndarray, np.ndarray]:
    """Return (row, column) of the lower triangle where the column's node supports the row's."""
    nodes = _column_nodes(model)
    coupled = np.tril(model.supports[np.ix_(nodes, nodes)].T > 0)
    coupled[:6, :6] = np.tril(np.ones((6, 6), dtype=bool))
    return np.nonzero(coupled)


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
