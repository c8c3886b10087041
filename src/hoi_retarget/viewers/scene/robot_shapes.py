"""A robot as unit shapes, the primitives of its MJCF, or as its vendor meshes: world poses for all frames at once.

Every geometry is fixed to a node of the kinematic tree. Where it lies there is read once, from
MuJoCo's own kinematics in the home pose; the frames then follow from ours.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ReadError
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.viewers.scene.drawing import Colour, Kind, Part, Shapes, Solid
from hoi_retarget.viewers.scene.vendor_meshes import attach_visual_meshes

_NO_COLOUR = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)  # What MuJoCo takes for none: the material's holds.
_DRAWN_GROUPS = 3  # As in MuJoCo's own viewer; robots keep what only collides in the groups above.


@dataclass(frozen=True, eq=False)
class _Attached:
    """A geometry of a compiled model, fixed to a node of the tree."""

    geom: int
    colour: Colour
    node: int
    position: Float[np.ndarray, "3"]
    quat: Float[np.ndarray, "4"]


def robot_parts(model: RobotModel, kinematics: Kinematics, meshes: Path | None) -> tuple[Part, ...]:
    """Return a robot over time: its vendor meshes from a folder, or its primitives where none is given.

    Raises:
        RobotError: The robot's specification names no meshes.
        ReadError: A mesh file is missing, or MuJoCo cannot read it.
    """
    return robot_shapes(model, kinematics) if meshes is None else robot_meshes(model, kinematics, meshes)


def robot_shapes(model: RobotModel, kinematics: Kinematics) -> tuple[Shapes, ...]:
    """Return a robot's primitives over time, one `Shapes` for each kind of them."""
    shapes = []
    for kind, pieces in _primitives(model).items():
        sizes, attached = zip(*pieces, strict=True)
        colours = np.array([item.colour for item in attached], dtype=np.uint8)
        shapes.append(Shapes(kind, np.stack(sizes).astype(np.float32), colours, *_world_poses(kinematics, attached)))
    return tuple(shapes)


def robot_meshes(model: RobotModel, kinematics: Kinematics, folder: Path) -> tuple[Solid, ...]:
    """Return the vendor meshes of a robot over time, from a folder with their files.

    Raises:
        RobotError: The robot's specification names no meshes.
        ReadError: A mesh file is missing, or MuJoCo cannot read it.
    """
    description = mujoco.MjSpec.from_file(str(model.spec.mjcf))
    attach_visual_meshes(description, model.spec, folder)
    try:
        compiled = description.compile()
    except ValueError as error:
        raise ReadError(f"{folder}: MuJoCo cannot read the meshes of {model.spec.title}: {error}") from error
    attached = [item for item in _attached(model, compiled) if compiled.geom_dataid[item.geom] >= 0]
    positions, quats = _world_poses(kinematics, attached)
    solids = []
    for index, item in enumerate(attached):
        mesh = compiled.mesh(compiled.geom_dataid[item.geom])
        vertices = compiled.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]].astype(float)
        faces = compiled.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]].astype(int)
        solids.append(Solid(vertices, faces, item.colour, positions[:, index], quats[:, index]))
    return tuple(solids)


def _world_poses(
    kinematics: Kinematics, attached: Sequence[_Attached]
) -> tuple[Float[np.ndarray, "T K 3"], Float[np.ndarray, "T K 4"]]:
    """Return world positions [m] and rotations of geometries, in single precision."""
    nodes = [item.node for item in attached]
    turns = se3.matrix_to_quat(kinematics.node_rotation.transpose(3, 2, 0, 1)).astype(np.float32)[:, nodes]
    places = kinematics.node_position.transpose(2, 1, 0).astype(np.float32)[:, nodes]
    within = np.stack([item.position for item in attached]).astype(np.float32)
    quats = np.stack([item.quat for item in attached]).astype(np.float32)
    return places + se3.rotate(turns, within), se3.quat_multiply(turns, quats)


@lru_cache(maxsize=8)
def _primitives(model: RobotModel) -> Mapping[Kind, Sequence[tuple[np.ndarray, _Attached]]]:
    """Return the unit shapes of each kind that the robot is made of: half extents [m] and place."""
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    found: dict[Kind, list[tuple[np.ndarray, _Attached]]] = {kind: [] for kind in Kind}
    for item in _attached(model, compiled):
        for kind, size, along in _unit_shapes(int(compiled.geom_type[item.geom]), compiled.geom_size[item.geom]):
            position = item.position + se3.rotate(item.quat, np.array([0.0, 0.0, along]))
            found[kind].append((size, replace(item, position=position)))
    return {kind: pieces for kind, pieces in found.items() if pieces}


def _attached(model: RobotModel, compiled: mujoco.MjModel) -> Iterator[_Attached]:
    """Yield the geometries that are to be seen."""
    data = mujoco.MjData(compiled)
    data.qpos[:] = model.home_qpos
    mujoco.mj_kinematics(compiled, data)
    home = model.forward(model.home_qpos[None])
    for geom in range(compiled.ngeom):
        colour, drawn = _colour(compiled, geom)
        if drawn:
            node = _node(compiled, int(compiled.geom_bodyid[geom]))
            turned = home.node_rotation[:, :, node, 0].T
            position = turned @ (data.geom_xpos[geom] - home.node_position[:, node, 0])
            quat = se3.matrix_to_quat(turned @ data.geom_xmat[geom].reshape(3, 3))
            yield _Attached(geom, colour, node, position, quat)


def _colour(compiled: mujoco.MjModel, geom: int) -> tuple[Colour, bool]:
    """Return a geometry's colour, and whether it is to be seen at all."""
    material, rgba = compiled.geom_matid[geom], compiled.geom_rgba[geom]
    if material >= 0 and np.array_equal(rgba, _NO_COLOUR):
        rgba = compiled.mat_rgba[material]
    red, green, blue = (round(255 * float(share)) for share in rgba[:3])
    return (red, green, blue), bool(rgba[3] > 0) and int(compiled.geom_group[geom]) < _DRAWN_GROUPS


def _node(compiled: mujoco.MjModel, body: int) -> int:
    """Return the node that carries a body: that of the last joint on the way to the root."""
    while compiled.body_jntnum[body] == 0 and body:
        body = int(compiled.body_parentid[body])
    # The first joint is the root's free one, and every later one a hinge with a node of its own.
    return int(compiled.body_jntadr[body] + compiled.body_jntnum[body] - 1) if body else 0


def _unit_shapes(geom: int, size: np.ndarray) -> Iterator[tuple[Kind, np.ndarray, float]]:
    """Yield what a primitive is made of: kind, half extents, and how far along its axis it lies [m]."""
    radius, half = size[0], size[1]
    match geom:
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            yield Kind.CYLINDER, np.array([radius, radius, half]), 0.0
            yield Kind.SPHERE, np.full(3, radius), float(half)
            yield Kind.SPHERE, np.full(3, radius), -float(half)
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            yield Kind.CYLINDER, np.array([radius, radius, half]), 0.0
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            yield Kind.SPHERE, np.full(3, radius), 0.0
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            yield Kind.SPHERE, size.copy(), 0.0
        case mujoco.mjtGeom.mjGEOM_BOX:
            yield Kind.BOX, size.copy(), 0.0
