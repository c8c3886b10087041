"""A robot as unit shapes, the primitives of its MJCF, or as its vendor meshes: world poses for all frames at once.

Every geometry is fixed to a node of the kinematic tree.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import ReadError
from hoi_retarget.numerics import se3
from hoi_retarget.robots.mjcf import read_mjcf
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.parts import Geometries, geometries_of, tree_of
from hoi_retarget.viewers.scene.drawing import Colour, Kind, Shapes, Solid
from hoi_retarget.viewers.scene.vendor_meshes import attach_visual_meshes

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
    description = read_mjcf(model.spec.mjcf, model.spec.sites)
    attach_visual_meshes(description, model.spec, folder)
    try:
        compiled = description.compile()
    except ValueError as error:
        raise ReadError(f"{folder}: MuJoCo cannot read the meshes of {model.spec.title}: {error}") from error
    geometries = geometries_of(compiled, tree_of(compiled))
    solids = []
    for geom in _drawn(geometries):
        if not geometries.meshes[geom]:
            continue
        frame, mesh = geometries.frames[geom], compiled.mesh(geometries.meshes[geom]).id
        vertices, faces = int(compiled.mesh_vertadr[mesh]), int(compiled.mesh_faceadr[mesh])
        positions, quats = poses.place(
            np.array([frame.node]), frame.position[None], se3.matrix_to_quat(frame.rotation)[None]
        )
        solids.append(
            Solid(
                vertices=compiled.mesh_vert[vertices : vertices + compiled.mesh_vertnum[mesh]].astype(float),
                faces=compiled.mesh_face[faces : faces + compiled.mesh_facenum[mesh]].astype(int),
                colour=_colour(geometries, geom),
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
    geometries = model.geometries
    found: list[_Piece] = []
    for geom in _drawn(geometries):
        frame = geometries.frames[geom]
        for kind, size, along in _unit_shapes(geometries.types[geom], geometries.sizes[geom]):
            centre = frame.of(np.array([0.0, 0.0, along]), np.eye(3))
            quat = se3.matrix_to_quat(frame.rotation)
            found.append(_Piece(kind, size, _colour(geometries, geom), frame.node, centre.position, quat))
    return tuple(found)


def _drawn(geometries: Geometries) -> Iterator[int]:
    """Yield the geometries that are to be seen."""
    for geom, (group, colour) in enumerate(zip(geometries.groups, geometries.colours, strict=True)):
        if group < _DRAWN_GROUPS and colour[3] > 0:
            yield geom


def _colour(geometries: Geometries, geom: int) -> Colour:
    red, green, blue = (round(255 * float(share)) for share in geometries.colours[geom, :3])
    return red, green, blue


def _unit_shapes(geometry: str, size: np.ndarray) -> Iterator[tuple[Kind, np.ndarray, float]]:
    """Yield what a primitive is made of: kind, half extents, and how far along its axis it lies [m]."""
    radius, half = size[0], size[1]
    match geometry:
        case "capsule":
            yield Kind.CYLINDER, np.array([radius, radius, half]), 0.0
            yield Kind.SPHERE, np.full(3, radius), float(half)
            yield Kind.SPHERE, np.full(3, radius), -float(half)
        case "cylinder":
            yield Kind.CYLINDER, np.array([radius, radius, half]), 0.0
        case "sphere":
            yield Kind.SPHERE, np.full(3, radius), 0.0
        case "ellipsoid":
            yield Kind.SPHERE, size.copy(), 0.0
        case "box":
            yield Kind.BOX, size.copy(), 0.0
