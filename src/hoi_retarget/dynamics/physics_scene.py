"""A robot and the objects of its motion as a MuJoCo scene, compiled or as files for MuJoCo's own viewer.

Colliding are the sole corners as small spheres, the convex parts of the robot's skin, the objects, and the floor. The
hands' contacts resist torsion, as a patch of skin of a palm's size does. The robot's friction counts in its contacts,
the objects' on the floor and on each other. The robot does not collide with itself, and its feet touch the floor by
their soles' corners only, as in the manufacturer's own model. Cones are elliptic, and friction is ten times as stiff as
what keeps things apart: with pyramids, held boxes creep by 4 to 16 mm a second.

In MJCF, MuJoCo writes six digits. Places of bodies, joints' axes and keyframes are put in again with all digits, so
that kinematics of the file are those of the motion. Dynamics to the bit are in the binary file beside it.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float

from hoi_retarget.dynamics.actuators import Actuators, actuators_of
from hoi_retarget.dynamics.object_bodies import CollisionShape, ObjectBody, collision_shape, object_body
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.dynamics.robot_parts import parts_by_body
from hoi_retarget.errors import RobotError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.objects.object_joint import JointPath, depth_first, parents_of, path_of, root_of, scaled, world_of
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.robots.mjcf import read_mjcf
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import PALMS, SIDES, SOLE_CORNERS

_ROBOT, _FEET, _OBJECT, _FLOOR = 1, 2, 4, 8  # Bits of what collides with what.
_SOLE_RADIUS = 0.005  # [m]
_PALM_TORSION = 0.03  # Of a patch of 4.5 cm radius, evenly pressed: two thirds of it [m].
_TORSION = 4  # MuJoCo's `condim` of contacts that resist sliding and torsion.
_ABOVE = 1  # MuJoCo's `priority` of geometries whose friction counts, instead of the larger one.
_COLLIDING = 3  # MuJoCo's group of geometries that are not drawn by default.
SOLES = frozenset(f"{side}_sole_{corner}" for side in SIDES for corner in SOLE_CORNERS)
FRICTION_STIFFNESS = 10.0
"""Of friction over that of what keeps things apart (MuJoCo's `impratio`): held objects must not creep."""
JOINT_DAMPING = 1.0  # Of hinges [N m s/rad] and slides [N s/m]: no recording tells it, and HDMI's door has this.
_ITERATIONS = 20  # Of the constraint solver: more change nothing that is seen, and cost time.
FILE, BINARY, MESHES = "scene.xml", "scene.mjb", "meshes"
KEYFRAMES = 11  # Number of keyframes over a motion, the first and the last frame included.


@dataclass(frozen=True, eq=False)
class SceneObject:
    """One object of a scene."""

    body_name: str  # In the scene; `NAME_joint` is its joint.
    body: ObjectBody
    shape: CollisionShape
    scale: float  # Of the shape.
    parent: int = -1  # Index of the object that it is a part of; -1 for none.
    path: JointPath | None = None  # Along its joint, of the motion; None where it is free.

    @property
    def corners(self) -> Float[np.ndarray, "V 3"]:
        """Corners of the colliding shape, in the object's frame [m]."""
        return self.scale * np.concatenate([self.shape.box.corners] if self.shape.box else self.shape.parts)

    def height(self, pose: Float[np.ndarray, "7"]) -> float:
        """Return the height of the lowest corner in a pose [m]."""
        return float(pose[2] + (self.corners @ se3.quat_to_matrix(pose[3:])[2]).min())


@dataclass(frozen=True, eq=False)
class PhysicsScene:
    """A robot with objects on a floor."""

    model: RobotModel
    actuators: Actuators
    objects: tuple[SceneObject, ...]
    physics: Physics

    def qpos(self, motion: Motion) -> Float[np.ndarray, "T nq"]:
        """Return configurations [m, rad, quaternion] along a motion: the robot's, then each object's pose."""
        objects = self.object_qpos(motion.object_pos, motion.object_quat)
        return np.concatenate([motion.qpos, *objects.values()], axis=1)

    def object_qpos(
        self, positions: Float[np.ndarray, "T O 3"], quats: Float[np.ndarray, "T O 4"]
    ) -> dict[int, Float[np.ndarray, "T k"]]:
        """Return coordinates by object, in MuJoCo's order: poses of free ones, states [rad, m] of joints."""
        found = {}
        for index in depth_first([item.parent for item in self.objects]):
            item = self.objects[index]
            if item.path is None:
                found[index] = np.concatenate([positions[:, index], quats[:, index]], axis=1)
            elif item.path.joint.kind != "fixed":
                tracks = (
                    ObjectTrack(item.body_name, positions[:, place], quats[:, place], ObjectGeometry(item.corners))
                    for place in (item.parent, index)
                )
                found[index] = path_of(item.path.joint, *tracks).states[:, None]
        return found


def scene_of(
    motion: Motion, model: RobotModel, recorded: Sequence[ObjectTrack], physics: Physics = Physics()
) -> PhysicsScene:
    """Return the scene of a motion and its objects; their recorded tracks are given in their order.

    Raises `RobotError`: a base carries the robot, or a joint's torque has no limit; `GeometryError`: an object's mesh
    cannot be read.
    """
    geometries = [track.geometry for track in recorded]
    objects = scene_objects(motion, geometries, physics, model.body_frames.names)
    objects = tuple(map(partial(_hung, motion, recorded), objects, range(len(objects)), parents_of(recorded)))
    return PhysicsScene(model, actuators_of(model), objects, physics)


def scene_objects(
    motion: Motion, geometries: Sequence[ObjectGeometry], physics: Physics, names: Collection[str] = PALMS
) -> tuple[SceneObject, ...]:
    """Return the objects of a motion; see `scene_of`. No body has one of the names of others."""
    objects, taken = [], set(names)
    for name, geometry, scale in zip(motion.object_names, geometries, motion.object_scale.tolist(), strict=True):
        body_name = _unused(re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") or "object", taken)
        body = object_body(name, geometry, scale, physics)
        objects.append(SceneObject(body_name, body, collision_shape(geometry), scale))
    return tuple(objects)


def _hung(motion: Motion, recorded: Sequence[ObjectTrack], item: SceneObject, index: int, parent: int) -> SceneObject:
    """Return an object with its joint along a motion, if it has one."""
    joint = recorded[index].joint
    if joint is None:
        return item
    part, above = (
        replace(recorded[index], positions=motion.object_pos[:, one], quats=motion.object_quat[:, one])
        for one in (index, parent)
    )
    above = above if parent >= 0 else world_of(part)
    return replace(item, parent=parent, path=path_of(scaled(joint, item.scale), above, part))


def scene_description(scene: PhysicsScene, meshes: Mapping[str, bytes] | None = None) -> mujoco.MjSpec:
    """Return a scene as MuJoCo's editable description; raises `RobotError` when MuJoCo cannot read the robot's MJCF.

    Its meshes are files by name, or carry their corners where `meshes` is None.
    """
    description, physics = robot_description(scene), scene.physics
    description.modelname = f"{scene.model.spec.name}_scene"
    description.option.timestep = physics.timestep
    description.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    description.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    description.option.impratio, description.option.iterations = FRICTION_STIFFNESS, _ITERATIONS
    # The same numbers but for rounding, in 0.55 to 0.7 of the time: a foot's contacts do not move the arms.
    description.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    world = description.worldbody
    world.add_light(pos=[0.0, 0.0, 4.0], dir=[0.0, 0.0, -1.0], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    world.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 1.0],
        rgba=[0.55, 0.57, 0.6, 1.0],
        **floor_contacts(physics),
    )
    for index in depth_first([item.parent for item in scene.objects]):
        item = scene.objects[index]
        above = scene.objects[item.parent].body_name if item.parent >= 0 else ""
        add_object(description, item, physics, meshes, above=above)
    _exclude_parts(description, scene)
    return description


def _exclude_parts(description: mujoco.MjSpec, scene: PhysicsScene) -> None:
    """Keep parts of one object from pushing each other: a hull may lie over others."""
    parents = [item.parent for item in scene.objects]
    for one, other in combinations(range(len(parents)), 2):
        first, second = (scene.objects[index].body_name for index in (one, other))
        if root_of(parents, one) == root_of(parents, other) and description.body(first) and description.body(second):
            description.add_exclude(bodyname1=first, bodyname2=second)


def robot_description(scene: PhysicsScene) -> mujoco.MjSpec:
    """Return a scene's robot alone with its drives, and with contacts as in the scene; raises `RobotError`."""
    description = read_mjcf(scene.model.spec.mjcf, scene.model.spec.sites)
    _set_robot(description, scene)
    return description


def object_description(scene: PhysicsScene, root: int) -> mujoco.MjSpec:
    """Return one of a scene's objects with its parts, alone, with contacts as in the scene."""
    description, parents = mujoco.MjSpec(), [item.parent for item in scene.objects]
    description.modelname = scene.objects[root].body_name
    for index in depth_first(parents, root):
        above = "" if index == root else scene.objects[parents[index]].body_name
        add_object(description, scene.objects[index], scene.physics, above=above)
    _exclude_parts(description, scene)
    return description


def floor_contacts(physics: Physics) -> dict[str, Any]:
    """Return the contacts of the floor, and its friction with objects, as attributes of its geometry."""
    return {"contype": _FLOOR, "conaffinity": _ROBOT | _FEET | _OBJECT, "friction": _friction(physics.object_friction)}


def hand_contacts(physics: Physics) -> dict[str, Any]:
    """Return the contacts of a hand, and its friction with objects, as attributes of its geometries."""
    friction = [physics.hand_friction, _PALM_TORSION, _friction(0.0)[2]]
    return {"contype": _ROBOT, "conaffinity": 0, "priority": _ABOVE, "condim": _TORSION, "friction": friction}


def compiled(scene: PhysicsScene) -> mujoco.MjModel:
    """Return a scene that MuJoCo can simulate; raises `RobotError` where MuJoCo cannot compile the robot."""
    return _compiled(scene, scene_description(scene))


def _compiled(scene: PhysicsScene, description: mujoco.MjSpec) -> mujoco.MjModel:
    try:
        return description.compile()
    except ValueError as error:
        raise RobotError(f"{scene.model.spec.mjcf}: MuJoCo cannot compile it with objects: {error}") from error


def mesh_name(item: SceneObject, part: int) -> str:
    """Return the name of a mesh of one of an object's parts."""
    return f"{item.body_name}_part{part}"


def _set_robot(description: mujoco.MjSpec, scene: PhysicsScene) -> None:
    friction = _friction(scene.physics.hand_friction)
    sites = {site.name: site for site in description.sites}
    palms = {sites[name].parent.name for name in PALMS}
    feet = {sites[name].parent.name for name in SOLES}
    parts = parts_by_body(scene.model)
    for body in description.bodies[1:]:
        foot = body.name in feet
        for number, geom in enumerate(list(body.geoms)):
            geom.name = geom.name or f"{body.name}_geom{number}"
            geom.contype, geom.conaffinity = (_FEET << 4) if foot else 0, 0
            geom.friction, geom.priority = friction, _ABOVE
        contacts = {"contype": _ROBOT, "conaffinity": 0, "priority": _ABOVE, "friction": friction}
        contacts |= hand_contacts(scene.physics) if body.name in palms else {}
        for number, corners in enumerate(() if foot else parts.get(body.name, ())):
            name = f"{body.name}_part{number}"
            description.add_mesh(name=name).uservert = corners.reshape(-1)
            kind = mujoco.mjtGeom.mjGEOM_MESH
            body.add_geom(name=name, type=kind, meshname=name, mass=0.0, group=_COLLIDING, **contacts)
    for name in sorted(SOLES):
        site = sites[name]
        up = se3.rotate(np.array(site.quat), np.array([0.0, 0.0, _SOLE_RADIUS]))
        site.parent.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[_SOLE_RADIUS, 0.0, 0.0],
            pos=site.pos + up,
            density=0.0,
            rgba=[0.2, 0.2, 0.2, 1.0],
            contype=_FEET,
            conaffinity=0,
            priority=_ABOVE,
            friction=_friction(scene.physics.floor_friction),
        )
    drives = scene.actuators
    for index, name in enumerate(scene.model.joint_names):
        joint, limit = description.joint(name), float(drives.torque[index])
        joint.armature = float(drives.armature[index])
        joint.frictionloss = 0.0
        _set_damping(joint, 0.0)
        joint.actfrclimited, joint.actfrcrange = mujoco.mjtLimited.mjLIMITED_TRUE, [-limit, limit]
        actuator = description.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=float(drives.stiffness[index]), kv=float(drives.damping[index]))
        actuator.forcelimited, actuator.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, [-limit, limit]


def add_object(
    description: mujoco.MjSpec,
    item: SceneObject,
    physics: Physics,
    meshes: Mapping[str, bytes] | None = None,
    *,
    above: str = "",
) -> None:
    """Add an object to a description; see `scene_description`.

    Args: `description`: it gets the object; `item`: the object; `physics`: masses and frictions; `meshes`: as for a
    scene; `above`: name of the body of which it is a part; empty where it is none.
    """
    node = (description.body(above) if above else description.worldbody).add_body(name=item.body_name)
    _add_joint(node, item)
    node.explicitinertial = True
    node.mass, node.ipos = item.body.mass, item.body.centre
    inertia = item.body.inertia
    node.fullinertia = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    common: dict[str, Any] = {
        "contype": _OBJECT,
        "conaffinity": _ROBOT | _FEET | (_FEET << 4) | _OBJECT,
        "friction": _friction(physics.object_friction),
        "rgba": [0.75, 0.56, 0.36, 1.0],
    }
    box = item.shape.box
    if box is not None:
        node.add_geom(
            name=f"{item.body_name}_box",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=item.scale * box.half,
            pos=item.scale * box.centre,
            quat=se3.matrix_to_quat(box.rotation),
            **common,
        )
    for number, corners in enumerate(item.shape.parts):
        name = mesh_name(item, number)
        mesh = description.add_mesh(name=name)
        if meshes is None:
            mesh.uservert = (item.scale * corners).reshape(-1)
        else:
            mesh.file = f"{name}.obj"
        node.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **common)


def _add_joint(node: mujoco.MjsBody, item: SceneObject) -> None:
    name = f"{item.body_name}_joint"
    if item.path is None:
        node.add_freejoint(name=name)
        return
    joint = item.path.joint
    node.pos, node.quat = item.path.rest_position, item.path.rest_quat
    if joint.kind == "fixed":
        return
    kind = mujoco.mjtJoint.mjJNT_HINGE if joint.kind == "hinge" else mujoco.mjtJoint.mjJNT_SLIDE
    anchor = se3.rotate_inverse(item.path.rest_quat, np.array(joint.anchor) - item.path.rest_position)
    axis = se3.rotate_inverse(item.path.rest_quat, np.array(joint.axis))
    _set_damping(node.add_joint(name=name, type=kind, pos=anchor, axis=axis), JOINT_DAMPING)


def _set_damping(joint: mujoco.MjsJoint, damping: float) -> None:
    # One number before MuJoCo 4, a polynomial's since.
    joint.damping = damping if np.ndim(joint.damping) == 0 else [damping, *[0.0] * (len(joint.damping) - 1)]


def _friction(sliding: float) -> list[float]:
    return [sliding, 0.005, 0.0001]  # Torsion and rolling as MuJoCo has them.


def _unused(name: str, taken: set[str]) -> str:
    """Return a name that nothing else has, and take it."""
    number, candidate = 1, name
    while candidate in taken:
        number += 1
        candidate = f"{name}_{number}"
    taken.add(candidate)
    return candidate


def scene_files(scene: PhysicsScene, motion: Motion) -> Mapping[Path, bytes]:
    """Return the files of a scene, by their places in its folder, with a motion's keyframes, `frame_0` and so on.

    Raises `RobotError` when the robot's MJCF has meshes, or MuJoCo cannot compile it with objects.
    """
    meshes = {
        f"{mesh_name(item, number)}.obj": _obj(item.scale * corners)
        for item in scene.objects
        for number, corners in enumerate(item.shape.parts)
    }
    description = scene_description(scene, meshes)
    check_no_meshes(scene, description, meshes)
    description.assets = meshes
    root = exact_xml(scene, description)
    for compiler in root.iter("compiler"):
        compiler.set("meshdir", MESHES)
    _add_keyframes(root, scene.qpos(motion), scene.model.n)
    return {
        Path(FILE): to_bytes(root),
        Path(BINARY): _binary(compiled(scene)),
        **{Path(MESHES) / name: content for name, content in meshes.items()},
    }


def check_no_meshes(scene: PhysicsScene, description: mujoco.MjSpec, known: Collection[str] = ()) -> None:
    """Raise `RobotError` where a description has other files of meshes than those of objects."""
    files = [mesh for mesh in description.meshes if mesh.file]  # An added robot's MJCF holds its meshes' corners.
    if own := [mesh.name for mesh in files if f"{mesh.name}.obj" not in known]:
        raise RobotError(f"{scene.model.spec.mjcf}: a scene of a robot with meshes ({own[0]}, ...) is not written yet.")


def exact_xml(scene: PhysicsScene, description: mujoco.MjSpec) -> ElementTree.Element:
    """Return a description of a scene, or of a part of it, as MJCF; raises `RobotError` when it cannot be compiled."""
    compiled, root = _compiled(scene, description), ElementTree.fromstring(description.to_xml())
    for tag, item_of in (("body", compiled.body), ("site", compiled.site)):
        for element in root.iter(tag):
            if (name := element.get("name")) is not None:
                element.set("pos", _numbers(item_of(name).pos))
                element.set("quat", _numbers(item_of(name).quat))
    for element in root.iter("joint"):
        if (name := element.get("name")) is not None and element.get("axis") is not None:
            element.set("axis", _numbers(compiled.joint(name).axis))
            if element.get("pos") is not None:
                element.set("pos", _numbers(compiled.joint(name).pos))
    return root


def to_bytes(root: ElementTree.Element) -> bytes:
    """Return MJCF as the content of a file."""
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8") + b"\n"


def _binary(simulated: mujoco.MjModel) -> bytes:
    """Return a compiled model as this version of MuJoCo loads it."""
    content = np.empty(mujoco.mj_sizeModel(simulated), dtype=np.uint8)
    mujoco.mj_saveModel(simulated, None, content)
    return content.tobytes()


def _add_keyframes(root: ElementTree.Element, qpos: Float[np.ndarray, "T nq"], joints: int) -> None:
    keyframe = ElementTree.SubElement(root, "keyframe")
    for frame in np.unique(np.linspace(0, len(qpos) - 1, KEYFRAMES).round().astype(int)):
        angles = qpos[frame, 7 : 7 + joints]
        ElementTree.SubElement(
            keyframe, "key", name=f"frame_{frame}", qpos=_numbers(qpos[frame]), ctrl=_numbers(angles)
        )


def _numbers(values: np.ndarray) -> str:
    return " ".join(map(repr, np.asarray(values, dtype=float).tolist()))


def _obj(corners: Float[np.ndarray, "V 3"]) -> bytes:
    """Return a convex part as a mesh file."""
    faces = scipy.spatial.ConvexHull(corners, qhull_options="QJ").simplices
    lines = [f"v {_numbers(corner)}" for corner in corners] + [
        "f " + " ".join(str(corner + 1) for corner in face) for face in faces.tolist()
    ]
    return ("\n".join(lines) + "\n").encode()
