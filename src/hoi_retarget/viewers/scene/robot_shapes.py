"""A robot as unit shapes, the primitives of its MJCF, or as its vendor meshes: world poses for all frames at once.

Every geometry is fixed to a node of the kinematic tree. Where it lies there is read once, from
MuJoCo's own kinematics in the home pose; the frames then follow from ours.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import ReadError
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.viewers.scene.drawing import Colour, Kind, Shapes, Solid
from hoi_retarget.viewers.scene.vendor_meshes import attach_visual_meshes

_NO_COLOUR = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)  # What MuJoCo takes for none: the material's holds.
_DRAWN_GROUPS = 3  # As in MuJoCo's own viewer; robots keep what only collides in the groups above.


@dataclass(frozen=True, eq=False)
class _Piece:
    """One unit shape, fixed to a node of the tree."""

    kind: Kind
    size: Float[np.ndarray, "3"]
    colour: Colour
    node: int
    position: Float[np.ndarray, "3"]
    quat: Float[np.ndarray, "4"]


@dataclass(frozen=True, eq=False)
class NodePoses:
    """World poses of the tree's nodes, as shapes need them."""

    positions: Float[np.ndarray, "T N 3"]
    """[m]"""
    quats: Float[np.ndarray, "T N 4"]

    @staticmethod
    def of(kinematics: Kinematics) -> "NodePoses":
        """Return the poses of a trajectory's nodes, in single precision."""
        rotations = kinematics.node_rotation.transpose(3, 2, 0, 1)
        return NodePoses(
            kinematics.node_position.transpose(2, 1, 0).astype(np.float32),
            se3.matrix_to_quat(rotations).astype(np.float32),
        )

    def place(
        self,
        nodes: Int[np.ndarray, "K"],
        positions: Float[np.ndarray, "K 3"],
        quats: Float[np.ndarray, "K 4"],
    ) -> tuple[Float[np.ndarray, "T K 3"], Float[np.ndarray, "T K 4"]]:
        """Return world positions [m] and rotations of what is fixed to nodes."""
        turns = self.quats[:, nodes]
        world = self.positions[:, nodes] + se3.rotate(turns, positions.astype(np.float32))
        return world, se3.quat_multiply(turns, quats.astype(np.float32))


def robot_shapes(model: RobotModel, poses: NodePoses) -> tuple[Shapes, ...]:
    """Return a robot's primitives over time, one `Shapes` for each kind of them."""
    pieces = _pieces(model)
    kinds = [kind for kind in Kind if any(piece.kind is kind for piece in pieces)]
    return tuple(_moved([piece for piece in pieces if piece.kind is kind], poses) for kind in kinds)


def robot_meshes(model: RobotModel, poses: NodePoses, folder: Path) -> tuple[Solid, ...]:
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
    solids = []
    for place in _placed_geometries(model, compiled):
        mesh = int(compiled.geom_dataid[place.geom])
        if mesh < 0:
            continue
        vertices, faces = int(compiled.mesh_vertadr[mesh]), int(compiled.mesh_faceadr[mesh])
        positions, quats = poses.place(np.array([place.node]), place.position[None], place.quat[None])
        solids.append(
            Solid(
                vertices=compiled.mesh_vert[vertices : vertices + compiled.mesh_vertnum[mesh]].astype(float),
                faces=compiled.mesh_face[faces : faces + compiled.mesh_facenum[mesh]].astype(int),
                colour=place.colour,
                positions=positions[:, 0],
                quats=quats[:, 0],
            )
        )
    return tuple(solids)


def _moved(pieces: list[_Piece], poses: NodePoses) -> Shapes:
    positions, quats = poses.place(
        np.array([piece.node for piece in pieces]),
        np.stack([piece.position for piece in pieces]),
        np.stack([piece.quat for piece in pieces]),
    )
    return Shapes(
        kind=pieces[0].kind,
        sizes=np.stack([piece.size for piece in pieces]).astype(np.float32),
        colours=np.array([piece.colour for piece in pieces], dtype=np.uint8),
        positions=positions,
        quats=quats,
    )


@lru_cache(maxsize=8)
def _pieces(model: RobotModel) -> tuple[_Piece, ...]:
    compiled = mujoco.MjModel.from_xml_path(str(model.spec.mjcf))
    found: list[_Piece] = []
    for place in _placed_geometries(model, compiled):
        for kind, size, along in _unit_shapes(int(compiled.geom_type[place.geom]), compiled.geom_size[place.geom]):
            position = place.position + se3.rotate(place.quat, np.array([0.0, 0.0, along]))
            found.append(_Piece(kind, size, place.colour, place.node, position, place.quat))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class _Placed:
    """A geometry of a compiled model, fixed to a node of the tree."""

    geom: int
    colour: Colour
    node: int
    position: Float[np.ndarray, "3"]
    quat: Float[np.ndarray, "4"]


def _placed_geometries(model: RobotModel, compiled: mujoco.MjModel) -> Iterator[_Placed]:
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
            yield _Placed(geom, colour, node, position, quat)


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
