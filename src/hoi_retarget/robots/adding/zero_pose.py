"""A description in its zero pose, in world axes: rigid parts, the hinges between them, and points on their surfaces."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.robots.adding.description import Description
from hoi_retarget.robots.adding.findings import UnsuitableRobotError
from hoi_retarget.robots.mjcf import mesh_of
from hoi_retarget.robots.spec import HeldJoint

_HINGE, _FREE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_FREE
_SLIDE = mujoco.mjtJoint.mjJNT_SLIDE
_LIMB_JOINTS, _LIMB_MASS = 3, 0.04  # A joint that carries as many and such a share of the robot's mass moves a limb.


@dataclass(frozen=True, eq=False)
class LimbPart:
    """Bodies that no joint moves against each other."""

    body: int  # The outermost of them.
    hinges: tuple[int, ...]  # Joints that move it against its parent; none for the root.
    parent: "LimbPart | None"
    bodies: list[int] = field(default_factory=list)
    children: list["LimbPart"] = field(default_factory=list)

    def below(self) -> Iterator["LimbPart"]:
        """Yield the part and all that hang from it."""
        yield self
        for child in self.children:
            yield from child.below()

    @property
    def hinge_count(self) -> int:
        """Number of hinges that move anything of it, its own included."""
        return sum(len(part.hinges) for part in self.below())


@dataclass(frozen=True, eq=False)
class ZeroPose:
    """The tree with some joints held, which count as rigid."""

    description: Description
    compiled: mujoco.MjModel
    root: LimbPart
    parts: tuple[LimbPart, ...]
    held: tuple[HeldJoint, ...]  # Joints that do not move on their own, in the source file's order.
    loose: tuple[HeldJoint, ...]  # Couplings of two limbs, whose joints move on their own here, and of fingers.
    anchors: Float[np.ndarray, "joints 3"]  # [m]
    axes: Float[np.ndarray, "joints 3"]
    body_position: Float[np.ndarray, "bodies 3"]
    body_rotation: Float[np.ndarray, "bodies 3 3"]

    @cached_property
    def _points(self) -> list[Float[np.ndarray, "_ 3"]]:
        """Points on each geometry."""
        return [
            geom_points(self.compiled, geom) @ self.body_rotation[body].T + self.body_position[body]
            for geom, body in enumerate(self.compiled.geom_bodyid)
        ]

    def points(self, *parts: LimbPart, meshes_only: bool = False) -> Float[np.ndarray, "_ 3"]:
        """Return points on the surfaces of parts [m]; with `meshes_only`, of their meshes where they have some."""
        bodies = [body for part in parts for body in part.bodies]
        geoms = [geom for body in bodies for geom in np.flatnonzero(self.compiled.geom_bodyid == body).tolist()]
        if meshes_only:
            is_mesh = self.compiled.geom_type == mujoco.mjtGeom.mjGEOM_MESH
            geoms = [geom for geom in geoms if is_mesh[geom]] or geoms
        return np.concatenate([np.zeros((0, 3)), *(self._points[geom] for geom in geoms)])

    def mass(self, part: LimbPart) -> float:
        """Return the mass of a part and all that hangs from it [kg]."""
        return float(sum(self.compiled.body_mass[body] for below in part.below() for body in below.bodies))

    def zero_angle(self, joint: int) -> float:
        """Return the angle of a joint in the file's own zero pose [rad]."""
        return float(self.compiled.qpos0[self.compiled.jnt_qposadr[joint]])

    def name(self, joint: int) -> str:
        """Return a joint's name."""
        return self.compiled.joint(joint).name

    def part_of(self, body: int) -> LimbPart:
        """Return the part that a body belongs to."""
        return next(part for part in self.parts if body in part.bodies)

    def lever(self, point: Float[np.ndarray, "3"], joint: int) -> float:
        """Return the distance of a point from a joint's axis [m]."""
        away = point - self.anchors[joint]
        return float(np.linalg.norm(away - self.axes[joint] * (away @ self.axes[joint])))


def zero_pose(description: Description, locked: Collection[str], following: Collection[str] = ()) -> ZeroPose:
    """Return a description's zero pose; joints in `locked`, coupled ones but those `following`, and slides are held.

    Raises `UnsuitableRobotError` when it has no joints that move.
    """
    compiled = description.compiled
    root_body = _root_of(compiled)
    held, loose = _held(description, root_body, locked, following)
    data = _posed(compiled, {one.joint: one for one in held})
    moved = {one.joint for one in held}
    parts: dict[int, LimbPart] = {}
    for body in _below(compiled, root_body):
        joints = range(compiled.body_jntadr[body], compiled.body_jntadr[body] + compiled.body_jntnum[body])
        hinges = tuple(
            joint for joint in joints if compiled.jnt_type[joint] == _HINGE and compiled.joint(joint).name not in moved
        )
        if body == root_body:
            parts[body] = LimbPart(body, (), None)
        elif hinges:
            parts[body] = LimbPart(body, hinges, parts[int(compiled.body_parentid[body])])
            parts[int(compiled.body_parentid[body])].children.append(parts[body])
        else:
            parts[body] = parts[int(compiled.body_parentid[body])]
        parts[body].bodies.append(body)
    unique = tuple({id(part): part for part in parts.values()}.values())
    return ZeroPose(
        description=description,
        compiled=compiled,
        root=parts[root_body],
        parts=unique,
        held=held,
        loose=loose,
        anchors=data.xanchor.copy(),
        axes=data.xaxis.copy(),
        body_position=data.xpos.copy(),
        body_rotation=data.xmat.reshape(-1, 3, 3).copy(),
    )


def _root_of(compiled: mujoco.MjModel) -> int:
    """Return the body with the free joint, or the heaviest body that stands in the world."""
    free = [int(compiled.jnt_bodyid[joint]) for joint in np.flatnonzero(compiled.jnt_type == _FREE)]
    tops = free or [body for body in range(1, compiled.nbody) if compiled.body_parentid[body] == 0]
    if not tops:
        raise UnsuitableRobotError(f"{compiled.nbody - 1} links and no joint: there is nothing that moves.")
    return max(tops, key=lambda body: compiled.body_subtreemass[body])


def _below(compiled: mujoco.MjModel, root: int) -> list[int]:
    inside = {root}
    for body in range(root + 1, compiled.nbody):
        if int(compiled.body_parentid[body]) in inside:
            inside.add(body)
    return sorted(inside)


def _held(
    description: Description, root: int, locked: Collection[str], following: Collection[str]
) -> tuple[tuple[HeldJoint, ...], tuple[HeldJoint, ...]]:
    """Return the joints that do not move on their own: slides, joints coupled to others, and locked ones.

    The couplings that would hold a limb are apart.
    """
    compiled = description.compiled
    inside = set(_below(compiled, root))
    names = {compiled.joint(joint).name: joint for joint in range(compiled.njnt)}
    held: dict[str, HeldJoint] = {}
    loose: list[HeldJoint] = []
    for coupling in description.couplings:
        one = _lighter(compiled, names, coupling)
        moves = one.joint in following or (one.joint in names and _carries_limb(compiled, names[one.joint]))
        if one.other in names and one.joint not in locked and moves:
            loose.append(one)
        elif one.joint in names:
            held.setdefault(one.joint, one)
    for name, joint in names.items():
        if int(compiled.jnt_bodyid[joint]) in inside and (compiled.jnt_type[joint] == _SLIDE or name in locked):
            held[name] = HeldJoint(name, "", 0.0, _nearest_to_zero(compiled, joint))
    in_order = (held[name] for name in names if name in held and compiled.jnt_type[names[name]] != _FREE)
    return tuple(in_order), tuple(loose)


def _carries_limb(compiled: mujoco.MjModel, joint: int) -> bool:
    top = int(compiled.jnt_bodyid[joint])
    below = set(_below(compiled, top))
    hinges = sum(int(body) in below for body in compiled.jnt_bodyid[compiled.jnt_type == _HINGE])
    return bool(hinges >= _LIMB_JOINTS and compiled.body_subtreemass[top] > _LIMB_MASS * compiled.body_subtreemass[0])


def _lighter(compiled: mujoco.MjModel, names: dict[str, int], coupling: HeldJoint) -> HeldJoint:
    """Return a coupling such that the joint with less mass on it follows the other."""
    if coupling.other not in names or coupling.joint not in names or not coupling.ratio:
        joint = names.get(coupling.joint)
        offset = coupling.offset if joint is None or coupling.offset else _nearest_to_zero(compiled, joint)
        return HeldJoint(coupling.joint, "", 0.0, offset)
    carried = [compiled.body_subtreemass[compiled.jnt_bodyid[names[name]]] for name in (coupling.joint, coupling.other)]
    if carried[0] <= 1.5 * carried[1]:
        return coupling
    return HeldJoint(coupling.other, coupling.joint, 1.0 / coupling.ratio, -coupling.offset / coupling.ratio)


def _nearest_to_zero(compiled: mujoco.MjModel, joint: int) -> float:
    zero = float(compiled.qpos0[compiled.jnt_qposadr[joint]])
    if not compiled.jnt_limited[joint]:
        return zero
    lower, upper = compiled.jnt_range[joint].tolist()
    return min(max(zero, lower), upper)


def _posed(compiled: mujoco.MjModel, held: dict[str, HeldJoint]) -> mujoco.MjData:
    data = mujoco.MjData(compiled)
    for name, one in held.items():
        value = one.offset
        if one.other:
            value += one.ratio * float(compiled.qpos0[compiled.joint(one.other).qposadr[0]])
        data.qpos[compiled.joint(name).qposadr[0]] = value
    mujoco.mj_kinematics(compiled, data)
    return data


def geom_points(compiled: mujoco.MjModel, geom: int) -> Float[np.ndarray, "_ 3"]:
    """Return points that span a geometry, in its body's frame [m]; none for planes and height fields."""
    kind, size = mujoco.mjtGeom(compiled.geom_type[geom]), compiled.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        vertices, _ = mesh_of(compiled, geom)
    elif kind in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER):
        turns = np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
        ring = size[0] * np.stack([np.cos(turns), np.sin(turns), np.zeros(16)], axis=1)
        half = np.array([0.0, 0.0, size[1]])
        round_end = size[0] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
        tips = np.array([[0.0, 0.0, size[1] + round_end], [0.0, 0.0, -size[1] - round_end]])
        vertices = np.concatenate([ring + half, ring - half, tips])
    elif kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        radii = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[[0, 0, 0]]
        vertices = np.concatenate([np.eye(3), -np.eye(3)]) * radii
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        vertices = size * (np.indices((7, 7, 7)).reshape(3, -1).T / 3.0 - 1.0)
    else:
        return np.zeros((0, 3))
    return vertices @ se3.quat_to_matrix(compiled.geom_quat[geom]).T + compiled.geom_pos[geom]
