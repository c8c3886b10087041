"""The trajectory problem stated a second time, in CasADi's symbols and from the terms' data alone.

Nothing of the package's kinematics, residuals or Jacobians is used: forward kinematics is written
again from the model's tree arrays, every term type is translated by a function of its own, and
derivatives are left to automatic differentiation. Unknowns of a frame are the base position, the
base rotation as a rotation vector about a reference, `R = R_ref Exp(phi)`, and the joint angles:
no unit-norm constraint is needed, and the map is smooth wherever `|phi| < pi`.

The terms of the paper are stated here, and the floor's. Others need no translation: `stated` leaves
them out, and `left_out` names them.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import singledispatch
from math import comb, factorial

import casadi as ca
import numpy as np
from scipy import sparse

from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.trajopt.problem import Problem, Term
from hoi_retarget.retargeting.trajopt.terms.differences import Differences
from hoi_retarget.retargeting.trajopt.terms.floor_clearance import FloorClearance
from hoi_retarget.retargeting.trajopt.terms.object_contact import ObjectContact
from hoi_retarget.retargeting.trajopt.terms.posture import Posture
from hoi_retarget.retargeting.trajopt.terms.site_pose import RelativeRotation, SiteHeight, SitePosition, SiteRotation
from hoi_retarget.robots.model import RobotModel

EXPONENTIAL_ORDER = 11  # Terms of the series: exact to rounding for rotation vectors up to pi.


class Frame:
    """Symbolic forward kinematics of one frame; only the nodes that are asked for are computed."""

    def __init__(self, model: RobotModel, position: ca.SX, base: ca.SX, theta: ca.SX) -> None:
        self.model, self.theta = model, theta
        self._nodes: dict[int, tuple[ca.SX, ca.SX]] = {0: (position, base)}

    def node(self, index: int) -> tuple[ca.SX, ca.SX]:
        """Return a node's world position and rotation."""
        if index not in self._nodes:
            hinge, model = index - 1, self.model
            position, rotation = self.node(int(model.parents[hinge]))
            constant, cosine, sine = (_constant(part[..., hinge]) for part in model.hinge_rotations)
            angle = self.theta[hinge]
            local = constant + cosine * ca.cos(angle) + sine * ca.sin(angle)
            place = position + rotation @ _constant(model.offsets[:, hinge])
            self._nodes[index] = place, rotation @ local
        return self._nodes[index]

    def point(self, site: str) -> ca.SX:
        """Return a site's world position."""
        place = self.model.sites.index[site]
        position, rotation = self.node(int(self.model.sites.nodes[place]))
        return position + rotation @ _constant(self.model.sites.positions[:, place])

    def orientation(self, site: str) -> ca.SX:
        """Return a site's world rotation."""
        place = self.model.sites.index[site]
        _, rotation = self.node(int(self.model.sites.nodes[place]))
        return rotation @ _constant(self.model.sites.rotations[:, :, place])


@dataclass(frozen=True, eq=False)
class FrameCost:
    """A term that sees one frame at a time: its cost as an expression of the frame and of its data."""

    weight: float | np.ndarray
    data: tuple[np.ndarray, ...]
    """Time last, or one number for all frames."""
    cost: Callable[..., ca.SX]
    """Called with the frame and one symbol per array, of that array's leading shape."""

    @property
    def size(self) -> int:
        """Return how many numbers a frame has: the weight, then the data."""
        return 1 + sum(int(np.prod(array.shape[:-1])) for array in self.data)

    def column(self, frames: int) -> np.ndarray:
        """Return those numbers, one column a frame."""
        arrays = (np.broadcast_to(self.weight, (1, frames)), *self.data)
        return np.concatenate([np.broadcast_to(a, (*a.shape[:-1], frames)).reshape(-1, frames) for a in arrays])

    def expression(self, frame: Frame, column: ca.SX) -> ca.SX:
        """Return the weighted cost of a frame."""
        symbols, start = [], 1
        for array in self.data:
            shape = array.shape[:-1]
            rows = column[start : start + int(np.prod(shape))]
            symbols.append(ca.reshape(rows, shape[::-1]).T if len(shape) == 2 else rows)
            start += rows.numel()
        return column[0] * self.cost(frame, *symbols)


@singledispatch
def translate(term: object) -> FrameCost:
    """Return a term as a symbolic cost of one frame.

    Raises `TypeError` for a term type that has no translation here.
    """
    raise TypeError(f"benchmarks/casadi_problem.py states no {type(term).__name__} yet: register its translation.")


def stated(terms: Iterable[Term]) -> tuple[Term, ...]:
    """Return the terms that are stated here."""
    return tuple(term for term in terms if _is_stated(term))


def left_out(terms: Iterable[Term]) -> tuple[str, ...]:
    """Return the names of the terms that are not."""
    return tuple(term.name for term in terms if not _is_stated(term))


def show_left_out(terms: Iterable[Term]) -> None:
    """Say which terms are not compared."""
    if names := left_out(terms):
        print(f"Left out of both sides, for benchmarks/casadi_problem.py does not state them: {', '.join(names)}.")


def _is_stated(term: object) -> bool:
    return isinstance(term, Differences) or translate.dispatch(type(term)) is not translate.dispatch(object)


@translate.register
def _(term: Posture) -> FrameCost:
    return FrameCost(term.weight, (term.target,), lambda frame, target: ca.sumsqr(frame.theta - target))


@translate.register
def _(term: SitePosition) -> FrameCost:
    return FrameCost(term.weight, (term.target,), lambda frame, target: ca.sumsqr(frame.point(term.site) - target))


@translate.register
def _(term: SiteHeight) -> FrameCost:
    target = np.reshape(term.target, (1, -1))
    return FrameCost(term.weight, (target,), lambda frame, height: (frame.point(term.site)[2] - height) ** 2)


@translate.register
def _(term: SiteRotation) -> FrameCost:
    def cost(frame: Frame, target: ca.SX) -> ca.SX:
        return ca.sumsqr(frame.orientation(term.site) - target)

    return FrameCost(term.weight, (term.target,), cost)


@translate.register
def _(term: RelativeRotation) -> FrameCost:
    def cost(frame: Frame, target: ca.SX) -> ca.SX:
        return ca.sumsqr(frame.node(0)[1].T @ frame.orientation(term.site) - target)

    return FrameCost(term.weight, (term.target_base,), cost)


@translate.register
def _(term: ObjectContact) -> FrameCost:
    def cost(frame: Frame, target: ca.SX, position: ca.SX, rotation: ca.SX) -> ca.SX:
        return ca.sumsqr(rotation.T @ (frame.point(term.site) - position) - target)

    return FrameCost(term.weight, (term.target_object, term.object_position, term.object_rotation), cost)


@translate.register
def _(term: FloorClearance) -> FrameCost:
    def cost(frame: Frame, margin: ca.SX) -> ca.SX:
        return sum(ca.fmin(0, frame.point(site)[2] - margin) ** 2 for site in term.sites)

    return FrameCost(term.weight, (np.reshape(term.margin, (1, -1)),), cost)


class Statement:
    """One problem in symbols; its graph depends on `structure_of` alone, its numbers are parameters."""

    def __init__(self, problem: Problem, frames: int) -> None:
        self.model, self.frames = problem.model, frames
        self._parts, self._differences = _split(problem)
        size = 4 + sum(part.size for part in self._parts)
        self._unknowns = ca.MX.sym("x", self.model.nv, frames)
        self._columns = ca.MX.sym("columns", size, frames)
        self._weights = ca.MX.sym("weights", len(self._differences))
        self._symbols = ca.SX.sym("x", self.model.nv), ca.SX.sym("column", size)
        self._cost = self._frame_cost()

    def program(self) -> dict[str, ca.MX]:
        """Return the nonlinear program: unknowns `x`, parameters `p`, objective `f`, joint steps `g`."""
        each = ca.Function("frame_cost", list(self._symbols), [self._cost]).map(self.frames)
        objective = ca.sum2(each(self._unknowns, self._columns))
        for index, term in enumerate(self._differences):
            if self.frames > term.order:
                changes = self._values(self._quats()) @ ca.DM(_stencil(term.order, self.frames)).T
                objective += self._weights[index] * ca.sumsqr(changes)
        return {
            "x": ca.vec(self._unknowns),
            "p": ca.vertcat(ca.vec(self._columns), self._weights),
            "f": objective,
            "g": ca.vec(self._unknowns[6:, 1:] - self._unknowns[6:, :-1]),
        }

    def hessian(self) -> ca.Function:
        """Return the exact Hessian of the Lagrangian, put together from blocks of one or two frames.

        The constraints are linear; `|K Q|^2` of the differences of quaternions has the blocks
        `(K^T K)_ab J_a^T J_b` and, within a frame, the second derivatives along `2 K^T K Q`.
        """
        product = sum(
            self._weights[index] * ca.DM(_gram(term.order, self.frames)) for index, term in enumerate(self._differences)
        )
        force = 2.0 * self._quats() @ product
        along = ca.SX.sym("along", 4)
        unknown, column = self._symbols
        quat = _turned(column[:4], unknown[3:6])
        block = ca.triu(ca.hessian(self._cost + ca.dot(along, quat), unknown)[0])
        local = ca.Function("block", [unknown, column, along], [block.nz[:]]).map(self.frames)
        scatter = _Scatter(self.model.nv * self.frames)
        rows, columns = (np.array(part) for part in block.sparsity().get_triplet())
        first = self.model.nv * np.arange(self.frames)[:, None]
        scatter.add(rows + first, columns + first, local(self._unknowns, self._columns, force))
        jacobian = ca.Function("turned", [unknown, column[:4]], [ca.vec(ca.jacobian(quat, unknown[3:6]))])
        self._couple(scatter, 2.0 * product, jacobian.map(self.frames)(self._unknowns, self._columns[:4, :]))
        factor, multipliers = ca.MX.sym("factor"), ca.MX.sym("multipliers", self.model.n * (self.frames - 1))
        program = self.program()
        inputs = [program["x"], program["p"], factor, multipliers]
        names = ["x", "p", "lam_f", "lam_g"]
        return ca.Function("nlp_hess_l", inputs, [factor * scatter.matrix()], names, ["triu_hess_gamma_x_x"])

    def _couple(self, scatter: "_Scatter", product: ca.MX, jacobians: ca.MX) -> None:
        """Add the differences' blocks between frames `lag` apart."""
        a, b = ca.SX.sym("a", 12), ca.SX.sym("b", 12)
        pair = ca.Function("pair", [a, b], [ca.vec(ca.reshape(a, 4, 3).T @ ca.reshape(b, 4, 3))])
        linear = np.r_[0:3, 6 : self.model.nv]
        column, row = np.divmod(np.arange(9), 3)
        for lag in range(min(max(term.order for term in self._differences) + 1, self.frames)):
            count = self.frames - lag
            first, second = (self.model.nv * np.arange(start, start + count)[:, None] for start in (0, lag))
            weights = ca.horzcat(*(product[t, t + lag] for t in range(count)))
            scatter.add(linear + first, linear + second, ca.repmat(weights, len(linear), 1))
            blocks = pair.map(count)(jacobians[:, :count], jacobians[:, lag:])
            kept = np.flatnonzero(row <= column) if lag == 0 else np.arange(9)
            turned = blocks[kept.tolist(), :] * ca.repmat(weights, len(kept), 1)
            scatter.add(3 + row[kept] + first, 3 + column[kept] + second, turned)

    def _frame_cost(self) -> ca.SX:
        unknown, column = self._symbols
        frame = Frame(self.model, unknown[:3], _matrix(_turned(column[:4], unknown[3:6])), unknown[6:])
        cost, start = ca.SX(0), 4
        for part in self._parts:
            cost += part.expression(frame, column[start : start + part.size])
            start += part.size
        return cost

    def _quats(self) -> ca.MX:
        reference, vector = ca.SX.sym("reference", 4), ca.SX.sym("phi", 3)
        turn = ca.Function("turn", [reference, vector], [_turned(reference, vector)]).map(self.frames)
        return turn(self._columns[:4, :], self._unknowns[3:6, :])

    def _values(self, quats: ca.MX) -> ca.MX:
        return ca.vertcat(self._unknowns[:3, :], quats, self._unknowns[6:, :])


class _Scatter:
    """A symmetric sparse matrix as the sum of values at places of its upper triangle."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._keys: list[np.ndarray] = []
        self._values: list[ca.MX] = []

    def add(self, rows: np.ndarray, columns: np.ndarray, values: ca.MX) -> None:
        """Add values (places, repetitions) at rows and columns (repetitions, places)."""
        self._keys.append((columns * self._size + rows).reshape(-1))
        self._values.append(ca.vec(values))

    def matrix(self) -> ca.MX:
        """Return the sum."""
        keys, place = np.unique(np.concatenate(self._keys), return_inverse=True)
        columns, rows = np.divmod(keys, self._size)
        pattern = ca.Sparsity.triplet(self._size, self._size, rows.tolist(), columns.tolist())
        adding = ca.Sparsity.triplet(len(keys), len(place), place.tolist(), list(range(len(place))))
        return ca.MX(pattern, ca.DM(adding, 1.0) @ ca.vertcat(*self._values))


def structure_of(problem: Problem, frames: int) -> tuple[object, ...]:
    """Return what the graph of a problem depends on: two problems that agree here share their graph."""
    names = ("site", "sites", "order")
    terms = [(type(term).__name__, *(getattr(term, name, None) for name in names)) for term in problem.terms]
    return (id(problem.model), frames, *terms)


def parameters_of(problem: Problem, reference: np.ndarray) -> np.ndarray:
    """Return the numbers of a problem: per frame the reference rotation and every term's data, then weights."""
    parts, differences = _split(problem)
    columns = [se3.quat_continuous(reference[:, 3:7]).T, *(part.column(len(reference)) for part in parts)]
    weights = [term.weight for term in differences]
    return np.concatenate([np.concatenate(columns).reshape(-1, order="F"), weights])


def start_of(reference: np.ndarray) -> np.ndarray:
    """Return the unknowns of the reference trajectory itself, one column a frame."""
    return np.concatenate([reference[:, :3], np.zeros((len(reference), 3)), reference[:, 7:]], axis=1).T


def trajectory_of(unknowns: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the trajectory of some unknowns."""
    quats = se3.quat_multiply(se3.quat_continuous(reference[:, 3:7]), se3.exp(unknowns[3:6].T))
    return np.concatenate([unknowns[:3].T, quats, unknowns[6:].T], axis=1)


def _split(problem: Problem) -> tuple[list[FrameCost], list[Differences]]:
    differences = [term for term in problem.terms if isinstance(term, Differences)]
    return [translate(term) for term in problem.terms if not isinstance(term, Differences)], differences


def _stencil(order: int, frames: int) -> sparse.csc_array:
    """Return the matrix that takes differences over time."""
    count = frames - order
    lines = [np.full(count, (-1.0) ** (order - k) * comb(order, k)) for k in range(order + 1)]
    return sparse.diags_array(lines, offsets=range(order + 1), shape=(count, frames)).tocsc()


def _gram(order: int, frames: int) -> sparse.csc_array:
    if frames <= order:
        return sparse.csc_array((frames, frames))
    stencil = _stencil(order, frames)
    return (stencil.T @ stencil).tocsc()


def _turned(quat: ca.SX, vector: ca.SX) -> ca.SX:
    """Return `quat * exp(vector)` as a quaternion wxyz; cosine and sine by their series in `|vector|^2`."""
    square = ca.sumsqr(vector) / 4.0
    cosine, sine = ca.SX(0), ca.SX(0)
    for k in reversed(range(EXPONENTIAL_ORDER)):
        cosine = cosine * square + (-1) ** k / factorial(2 * k)
        sine = sine * square + (-1) ** k / factorial(2 * k + 1)
    imaginary = 0.5 * sine * vector
    return ca.vertcat(
        quat[0] * cosine - ca.dot(quat[1:], imaginary),
        quat[0] * imaginary + cosine * quat[1:] + ca.cross(quat[1:], imaginary),
    )


def _matrix(quat: ca.SX) -> ca.SX:
    """Return the rotation matrix of a unit quaternion wxyz."""
    w, v = quat[0], quat[1:]
    return (w**2 - ca.sumsqr(v)) * ca.SX.eye(3) + 2 * (v @ v.T + w * ca.skew(v))


def _constant(values: np.ndarray) -> ca.SX:
    """Return a constant whose zeros are structural, rounding of the model's compiler included."""
    return ca.sparsify(ca.SX(ca.DM(np.where(np.abs(values) < 1e-15, 0.0, values))))
