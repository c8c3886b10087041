"""Parts of a scene as rigid meshes, each with one pose a frame.

A browser applies poses and visibilities of nodes in the very frame that it draws next, and anything else, such as
poses within a batch of copies, in a later one. So whatever moves is a node of its own, or hands and objects are seen
in different frames; and what moves alike is one node, or there are hundreds.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int

from hoi_retarget.numerics import se3
from hoi_retarget.viewers.scene.drawing import Colour, Kind, Shapes, Solid

_SAMPLES = 16  # Frames that tell at first what moves alike.
_ALIKE = 1e-5  # Most that poses of one body differ by, in [m] and in parts of quaternions.


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A mesh that moves over T frames as one."""

    vertices: Float[np.ndarray, "V 3"]
    """[m]"""
    faces: Int[np.ndarray, "F 3"]
    colour: Colour
    faceted: bool
    """Whether edges are seen."""
    closed: bool
    """Whether its inside is never seen."""
    positions: Float[np.ndarray, "T 3"]
    """[m]"""
    quats: Float[np.ndarray, "T 4"]
    """wxyz"""
    visible: Bool[np.ndarray, "T"] | None = None
    """None for always."""

    def fits(self, other: "RigidBody") -> bool:
        """Return whether another body has the same mesh."""
        return (
            (self.colour, self.faceted, self.closed) == (other.colour, other.faceted, other.closed)
            and self.vertices.shape == other.vertices.shape
            and np.allclose(self.vertices, other.vertices, rtol=0.0, atol=10 * _ALIKE)
        )


def body_of(solid: Solid) -> RigidBody:
    """Return a solid as a body."""
    return RigidBody(solid.vertices, solid.faces, solid.colour, True, False, solid.positions, solid.quats)


def bodies_of(shapes: Shapes) -> tuple[RigidBody, ...]:
    """Return copies of a shape as bodies: those of one colour that move alike are one."""
    return tuple(_merged(shapes, members) for members in _groups(shapes))


def _groups(shapes: Shapes) -> list[Int[np.ndarray, "_"]]:
    """Return the copies of each body, the one that gives the pose first."""
    frames = np.unique(np.linspace(0, len(shapes.positions) - 1, _SAMPLES).astype(int))
    left, groups = np.arange(shapes.count), []
    while len(left):
        alike = left[_move_alike(shapes, left, frames)]
        members = alike[_move_alike(shapes, alike, slice(None))]
        groups.append(members)
        left = np.setdiff1d(left, members)
    return groups


def _move_alike(shapes: Shapes, copies: Int[np.ndarray, "N"], frames: np.ndarray | slice) -> Bool[np.ndarray, "N"]:
    """Return which copies keep their place beside the first, have its colour and are there when it is."""
    places, turns = _beside(shapes, copies, frames)
    alike = (np.abs(places - places[:1]).max(axis=(0, 2)) < _ALIKE) & (
        np.abs(turns - turns[:1] * np.sign((turns * turns[:1]).sum(axis=2, keepdims=True))).max(axis=(0, 2)) < _ALIKE
    )
    alike &= (shapes.colours[copies] == shapes.colours[copies[0]]).all(axis=1)
    if shapes.visible is not None:
        seen = shapes.visible[frames][:, copies]
        alike &= (seen == seen[:, :1]).all(axis=0)
    alike[0] = True
    return alike


def _beside(
    shapes: Shapes, copies: Int[np.ndarray, "N"], frames: np.ndarray | slice
) -> tuple[Float[np.ndarray, "K N 3"], Float[np.ndarray, "K N 4"]]:
    """Return the poses of copies as the first of them sees them."""
    positions = shapes.positions[frames][:, copies].astype(float)
    quats = shapes.quats[frames][:, copies].astype(float)
    back = se3.quat_conjugate(quats[:, :1])
    return se3.rotate(back, positions - positions[:, :1]), se3.quat_multiply(back, quats)


def _merged(shapes: Shapes, members: Int[np.ndarray, "N"]) -> RigidBody:
    unit, faces = _unit_mesh(shapes.kind)
    places, turns = _beside(shapes, members, np.array([0]))
    vertices = places[0][:, None] + se3.rotate(turns[0][:, None], shapes.sizes[members][:, None].astype(float) * unit)
    first, (red, green, blue) = members[0], shapes.colours[members[0]].tolist()
    return RigidBody(
        vertices.reshape(-1, 3),
        np.concatenate([faces + number * len(unit) for number in range(len(members))]),
        (red, green, blue),
        shapes.kind is Kind.BOX,
        True,
        shapes.positions[:, first],
        shapes.quats[:, first],
        None if shapes.visible is None else shapes.visible[:, first],
    )


@cache
def _unit_mesh(kind: Kind) -> tuple[np.ndarray, np.ndarray]:
    match kind:
        case Kind.SPHERE:
            mesh = trimesh.creation.uv_sphere(radius=1.0, count=[8, 14])
            mesh.merge_vertices()
        case Kind.CYLINDER:
            mesh = trimesh.creation.cylinder(radius=1.0, height=2.0, sections=14)
        case Kind.BOX:
            mesh = trimesh.creation.box(extents=(2.0, 2.0, 2.0))
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)
