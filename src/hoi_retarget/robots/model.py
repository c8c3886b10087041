"""One robot model: the tree read from a compiled MJCF, forward kinematics for all frames at once.

Inside this package's kinematics and optimization, time is the last axis of every array: numpy's
inner loops then run over frames, which makes them several times faster than stacks of 3 x 3
matrices. Arrays for metrics, viewers and exporters have time first.

The tree's nodes are the free root (node 0) and one node per hinge. Bodies and sites are fixed to a
node by a constant transform. A configuration is `q = (p_b, R_b, theta)`, stored as MuJoCo's qpos;
its tangent is `(dp_world, dphi_body, dtheta)` with `6 + n` numbers (paper Sec. III).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.errors import RobotError
from hoi_retarget.kernels import tree_sums
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.robots import frames as robot_frames
from hoi_retarget.robots.mjcf import compile_mjcf
from hoi_retarget.robots.spec import SIDES, SITES, SOLE_CORNERS, RobotSpec

_KEPT_FRAMES = 2000  # Of longer trajectories, orientations would take more memory than time.


@dataclass(frozen=True, eq=False)
class RobotModel:
    """The kinematic tree of one robot with its limits; n hinges, N = n + 1 nodes."""

    spec: RobotSpec
    joint_names: tuple[str, ...]
    lower: Float[np.ndarray, "n"]  # Joint range [rad].
    upper: Float[np.ndarray, "n"]
    speed_limits: Float[np.ndarray, "n"]  # [rad/s]
    torque_limits: Float[np.ndarray, "n"]  # [N m]; infinite where the MJCF has none (`actuatorfrcrange`).
    home_qpos: Float[np.ndarray, "nq"]
    parents: Int[np.ndarray, "n"]  # Parent node of hinge node `1 + j`.
    offsets: Float[np.ndarray, "3 n"]  # Origin of a hinge's node in its parent's frame [m].
    hinge_rotations: Float[np.ndarray, "3 3 3 n"]
    """`R(theta) = [0] + [1] cos(theta) + [2] sin(theta)`: node to parent rotation."""
    axes: Float[np.ndarray, "3 n"]  # Hinge axis in its node's frame.
    bodies: robot_frames.Attachments  # Bodies with mass, in MuJoCo's order.
    inertias: robot_frames.Inertias  # Of those bodies.
    geometries: robot_frames.Geometries
    sites: robot_frames.Attachments
    site_bodies: tuple[str, ...]  # Body that carries each site.
    body_frames: robot_frames.Attachments  # All bodies, those without mass included.
    levels: tuple[Int[np.ndarray, "_"], ...]  # Hinges by depth; all of one level can be computed at once.
    supports: Float[np.ndarray, "N N"]  # `[a, b]` is 1 when node `a` is `b` or an ancestor of it.

    def __repr__(self) -> str:
        return f"<RobotModel {self.spec.name}: {self.n} joints>"

    @property
    def n(self) -> int:
        """Number of hinges."""
        return len(self.joint_names)

    @property
    def nv(self) -> int:
        """Number of tangent coordinates."""
        return 6 + self.n

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of the bodies with mass."""
        return self.bodies.names

    @property
    def site_names(self) -> tuple[str, ...]:
        """Names of the sites."""
        return self.sites.names

    def body_of(self, site: str) -> str:
        """Return the body that carries a site."""
        return self.site_bodies[self.sites.index[site]]

    @cached_property
    def column_nodes(self) -> Int[np.ndarray, "nv"]:
        """Return the node that each tangent coordinate moves first."""
        return np.concatenate([np.zeros(6, dtype=int), np.arange(1, self.n + 1)])

    @cached_property
    def fixed_columns(self) -> Bool[np.ndarray, "nv"]:
        """Return the tangent coordinates that are fixed.

        All of the root's where its base stays; where it follows, its height and its tilt, and all of its rotation if
        none of the root link's axes points up.
        """
        fixed = np.zeros(self.nv, dtype=bool)
        if self.spec.base == "legs":
            return fixed
        fixed[:6] = True
        if self.spec.base == "follows":
            upwards = np.abs(se3.quat_to_matrix(self.home_qpos[3:7])[2])
            fixed[:2] = False
            fixed[3:6] = upwards < 1.0 - 1e-9
        return fixed

    @cached_property
    def moving_columns(self) -> tuple[Int[np.ndarray, "nv nv"], Int[np.ndarray, "nv"]]:
        """Return, for each tangent coordinate, the coordinates that move its node, up to itself, and their number."""
        rows, columns = self.coupled_columns
        count = np.bincount(rows, minlength=self.nv)
        table = np.zeros((self.nv, self.nv), dtype=int)
        table[rows, np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)] = columns
        return table, count

    @cached_property
    def coupled_columns(self) -> tuple[Int[np.ndarray, "pairs"], Int[np.ndarray, "pairs"]]:
        """Return (row, column) of the lower triangle of one frame's normal matrix that sites can fill."""
        nodes = self.column_nodes
        coupled = np.tril(self.supports[np.ix_(nodes, nodes)].T > 0)
        row, column = np.nonzero(coupled)
        return row, column

    def forward(self, qpos: Float[np.ndarray, "T nq"]) -> "Kinematics":
        """Return the poses of all nodes for all frames."""
        theta = np.ascontiguousarray(qpos[:, 7:].T)
        rotation = np.empty((3, 3, self.n + 1, len(qpos)))
        position = np.empty((3, self.n + 1, len(qpos)))
        rotation[:, :, 0] = se3.quat_to_matrix(qpos[:, 3:7]).transpose(1, 2, 0)
        position[:, 0] = qpos[:, :3].T
        tree_sums.forward(self.parents, self.offsets, self.hinge_rotations, theta, rotation, position)
        return Kinematics(self, qpos, position, rotation)

    def integrate(
        self, qpos: Float[np.ndarray, "T nq"], tangent: Float[np.ndarray, "T nv"]
    ) -> Float[np.ndarray, "T nq"]:
        """Return the configuration after a step along a tangent vector [m, rad]."""
        return np.concatenate(
            [
                qpos[:, :3] + tangent[:, :3],
                se3.quat_multiply(qpos[:, 3:7], se3.exp(tangent[:, 3:6])),
                qpos[:, 7:] + tangent[:, 6:],
            ],
            axis=1,
        )


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Node poses of one trajectory: a value of this type has been through forward kinematics."""

    model: RobotModel
    qpos: Float[np.ndarray, "T nq"]
    node_position: Float[np.ndarray, "3 N T"]
    node_rotation: Float[np.ndarray, "3 3 N T"]
    _points: dict[robot_frames.Frame, np.ndarray] = field(default_factory=dict, init=False, repr=False)
    _orientations: dict[robot_frames.Frame, np.ndarray] = field(default_factory=dict, init=False, repr=False)

    def window(self, frames: slice) -> "Kinematics":
        """Return the poses in some frames."""
        places, turns = self.node_position[..., frames], self.node_rotation[..., frames]
        return Kinematics(self.model, self.qpos[frames], places, turns)

    def parts(self, first: int = 0) -> Iterator["Kinematics"]:
        """Yield the poses from one frame on, some frames after the other, for work in little memory."""
        for start in range(first, len(self.qpos), _KEPT_FRAMES):
            yield self.window(slice(start, start + _KEPT_FRAMES))

    def frame(self, site: str | robot_frames.Frame) -> robot_frames.Frame:
        """Return a site's frame by its name, or the given frame; raises `RobotError` when there is no such site."""
        if isinstance(site, robot_frames.Frame):
            return site
        try:
            return self.model.sites.frames[site]
        except KeyError:
            raise RobotError(
                f"{self.model.spec.name}: no site {site!r}. Sites: {', '.join(self.model.site_names)}."
            ) from None

    def point(self, site: str | robot_frames.Frame) -> Float[np.ndarray, "3 T"]:
        """Return the world position of a site or another frame [m], time last."""
        frame = self.frame(site)
        if frame not in self._points:
            offset = np.einsum("ijt,j->it", self.node_rotation[:, :, frame.node], frame.position)
            self._points[frame] = self.node_position[:, frame.node] + offset
        return self._points[frame]

    def orientation(self, site: str | robot_frames.Frame) -> Float[np.ndarray, "3 3 T"]:
        """Return the world rotation matrices of a site or another frame, time last."""
        frame = self.frame(site)
        if frame in self._orientations:
            return self._orientations[frame]
        turn = np.einsum("ijt,jk->ikt", self.node_rotation[:, :, frame.node], frame.rotation)
        if len(self.qpos) <= _KEPT_FRAMES:
            self._orientations[frame] = turn
        return turn

    def site_position(self, site: str) -> Float[np.ndarray, "T 3"]:
        """Return a site's world position [m]."""
        return np.ascontiguousarray(self.point(site).T)

    def soles(self) -> Float[np.ndarray, "T 2 4 3"]:
        """Return the world positions of the corners of the left and the right sole [m]."""
        feet = [[self.site_position(f"{side}_sole_{corner}") for corner in SOLE_CORNERS] for side in SIDES]
        return np.moveaxis(np.array(feet), 2, 0)

    def site_rotation(self, site: str) -> Float[np.ndarray, "T 3 3"]:
        """Return a site's world rotation matrices."""
        return np.ascontiguousarray(self.orientation(site).transpose(2, 0, 1))

    @property
    def body_positions(self) -> Float[np.ndarray, "T B 3"]:
        """World positions of the bodies with mass [m]."""
        bodies = self.model.bodies
        offsets = np.einsum("ijkt,jk->ikt", self.node_rotation[:, :, bodies.nodes], bodies.positions)
        return np.ascontiguousarray((self.node_position[:, bodies.nodes] + offsets).transpose(2, 1, 0))

    @cached_property
    def motion_axes(self) -> Float[np.ndarray, "6 nv T"]:
        """Twist per tangent coordinate at the root's position: linear [m], then angular [rad].

        Column `6 + j` moves only the nodes that hinge `j` supports.
        """
        model, frames = self.model, self.qpos.shape[0]
        axes = np.zeros((6, model.nv, frames))
        axes[0, 0] = axes[1, 1] = axes[2, 2] = 1.0
        axes[3:, 3:6] = self.node_rotation[:, :, 0]
        angular = np.einsum("ijkt,jk->ikt", self.node_rotation[:, :, 1:], model.axes)
        lever = self.node_position[:, 1:] - self.node_position[:, :1]
        axes[3:, 6:] = angular
        axes[:3, 6:] = _cross(lever, angular)
        return axes

    def jacobian(self, site: str | robot_frames.Frame) -> Float[np.ndarray, "T 6 nv"]:
        """Return the Jacobian of the world twist of a site or another frame, linear [m], then angular [rad]."""
        moved = np.concatenate([np.ones(6), self.model.supports[1:, self.frame(site).node]])
        axes = self.motion_axes * moved[:, None]
        lever = self.point(site) - self.node_position[:, 0]
        linear = axes[:3] + _cross(axes[3:], lever[:, None])
        return np.ascontiguousarray(np.concatenate([linear, axes[3:]]).transpose(2, 0, 1))


def load_model(spec: RobotSpec) -> RobotModel:
    """Return a robot's model.

    Raises `RobotError` when its MJCF cannot be compiled or lacks a free root, a limited hinge, a speed limit or a site.
    """
    compiled = compile_mjcf(spec.mjcf, spec.sites)
    _check_joints(spec, compiled)
    hinges = np.flatnonzero(compiled.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    names = tuple(compiled.joint(int(joint)).name for joint in hinges)
    tree = robot_frames.tree_of(compiled)
    bodies, sites = robot_frames.bodies_of(compiled, tree), robot_frames.sites_of(compiled, tree)
    _check_names(spec, names, {name for name, _ in sites})
    before = [tree.hinges[int(joint)] for joint in hinges]
    axes = compiled.jnt_axis[hinges]
    zeros = compiled.qpos0[compiled.jnt_qposadr[hinges]]
    rotations = [
        _hinge_rotation(frame.rotation, axis, zero) for frame, axis, zero in zip(before, axes, zeros, strict=True)
    ]
    parents = [frame.node for frame in before]
    depth = np.zeros(len(hinges) + 1, dtype=int)
    for hinge, parent in enumerate(parents):
        depth[hinge + 1] = depth[parent] + 1
    return RobotModel(
        spec=spec,
        joint_names=names,
        lower=frozen(compiled.jnt_range[hinges, 0]),
        upper=frozen(compiled.jnt_range[hinges, 1]),
        speed_limits=frozen([spec.speed_limits[name] for name in names]),
        torque_limits=frozen(np.where(compiled.jnt_actfrclimited[hinges], compiled.jnt_actfrcrange[hinges, 1], np.inf)),
        home_qpos=frozen(np.concatenate([compiled.qpos0[:7], [spec.home.get(name, 0.0) for name in names]])),
        parents=frozen(parents, int),
        offsets=frozen(np.transpose([frame.position for frame in before])),
        hinge_rotations=frozen(np.transpose(rotations, (1, 2, 3, 0))),
        axes=frozen(axes.T),
        bodies=robot_frames.Attachments.named(
            frame for frame, mass in zip(bodies, compiled.body_mass[1:], strict=True) if mass > 0
        ),
        inertias=robot_frames.inertias_of(compiled),
        geometries=robot_frames.geometries_of(compiled, tree),
        sites=robot_frames.Attachments.named(sites),
        site_bodies=tuple(compiled.body(body).name for body in compiled.site_bodyid),
        body_frames=robot_frames.Attachments.named(bodies),
        levels=tuple(frozen(np.flatnonzero(depth[1:] == level), int) for level in range(1, depth.max() + 1)),
        supports=frozen(_supports(parents)),
    )


def _hinge_rotation(rotation: np.ndarray, axis: np.ndarray, zero: float) -> np.ndarray:
    along = np.outer(axis, axis)
    across, cross = np.eye(3) - along, se3.skew(axis)
    # MuJoCo turns by theta - zero; expand cosine and sine of the difference once.
    cosine = across * np.cos(zero) - cross * np.sin(zero)
    sine = across * np.sin(zero) + cross * np.cos(zero)
    return np.stack([rotation @ along, rotation @ cosine, rotation @ sine])


def _check_joints(spec: RobotSpec, compiled: mujoco.MjModel) -> None:
    free = compiled.jnt_type == mujoco.mjtJoint.mjJNT_FREE
    hinge = compiled.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    if compiled.njnt == 0 or not free[0] or free.sum() != 1:
        raise RobotError(f"{spec.mjcf}: the first joint must be the one free joint of the root body.")
    for index in np.flatnonzero(~free):
        name = compiled.joint(int(index)).name
        if not hinge[index]:
            raise RobotError(f"{spec.mjcf}: joint {name!r} is not a hinge; only hinges are supported.")
        if not compiled.jnt_limited[index]:
            raise RobotError(f"{spec.mjcf}: joint {name!r} has no range.")


def _check_names(spec: RobotSpec, joints: tuple[str, ...], sites: set[str]) -> None:
    unlimited = [name for name in joints if name not in spec.speed_limits]
    if unlimited:
        raise RobotError(f"{spec.name}: no speed limit for {', '.join(unlimited)}. Add it to the specification.")
    followed = [one.other for one in spec.couplings if one.other]
    unknown = sorted({*spec.home, *followed, *(one.joint for one in spec.couplings)} - set(joints))
    if unknown:
        raise RobotError(f"{spec.name}: its specification names joints that {spec.mjcf} has not: {', '.join(unknown)}.")
    missing = [name for name in SITES if name not in sites]
    if missing:
        raise RobotError(f"{spec.mjcf}: sites are missing: {', '.join(missing)}. Add them where docs/robots.md says.")


def _supports(parents: list[int]) -> np.ndarray:
    supports = np.eye(len(parents) + 1)
    for hinge, parent in enumerate(parents):
        supports[:, hinge + 1] += supports[:, parent]
    return supports


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product along the first axis; `numpy.cross` moves axes and is slower."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
