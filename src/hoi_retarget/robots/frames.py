"""Parts of a robot, each fixed to a node of its kinematic tree: frames, inertias and geometries.

The tree's nodes are the free root (node 0) and one node per hinge. Everything else keeps a constant
place in the frame of one node.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen

_NO_COLOUR = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)  # MuJoCo's default, which a material overrides.


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame fixed to a node, such as a site: its constant place in the node's frame."""

    node: int
    position: Float[np.ndarray, "3"]  # [m]
    rotation: Float[np.ndarray, "3 3"]

    def of(self, position: Float[np.ndarray, "3"], rotation: Float[np.ndarray, "3 3"]) -> "Frame":
        """Return a frame that has a constant place [m] in this one."""
        return Frame(self.node, self.position + self.rotation @ position, self.rotation @ rotation)


@dataclass(frozen=True, eq=False)
class Attachments:
    """Named frames fixed to nodes."""

    names: tuple[str, ...]
    nodes: Int[np.ndarray, "K"]
    positions: Float[np.ndarray, "3 K"]  # [m]
    rotations: Float[np.ndarray, "3 3 K"]

    @classmethod
    def named(cls, frames: Iterable[tuple[str, Frame]]) -> "Attachments":
        """Return frames with their names."""
        names, places = zip(*frames, strict=True)
        return cls(
            names=names,
            nodes=frozen([place.node for place in places], int),
            positions=frozen(np.transpose([place.position for place in places])),
            rotations=frozen(np.transpose([place.rotation for place in places], (1, 2, 0))),
        )

    @cached_property
    def index(self) -> dict[str, int]:
        """Return where each name stands."""
        return {name: index for index, name in enumerate(self.names)}

    @cached_property
    def frames(self) -> dict[str, Frame]:
        """Return each frame by its name."""
        places = zip(self.nodes, self.positions.T, self.rotations.transpose(2, 0, 1), strict=True)
        return {name: Frame(int(node), *place) for name, (node, *place) in zip(self.names, places, strict=True)}


@dataclass(frozen=True, eq=False)
class Inertias:
    """Masses of the bodies that have one, in the bodies' own frames."""

    masses: Float[np.ndarray, "B"]  # [kg]
    centres: Float[np.ndarray, "B 3"]  # Centres of mass [m].


@dataclass(frozen=True, eq=False)
class Geometries:
    """Geometries of the robot's description, in MuJoCo's order."""

    bodies: tuple[str, ...]  # Body that carries each.
    frames: tuple[Frame, ...]
    types: tuple[str, ...]  # As MJCF writes them: capsule, box, mesh, ...
    sizes: Float[np.ndarray, "G 3"]
    """MJCF's size numbers [m]: radius and half length of a capsule, half extents of a box, ..."""
    meshes: tuple[str, ...]  # Mesh asset; empty for primitives.
    colours: Float[np.ndarray, "G 4"]
    """Red, green, blue, opacity, 0 to 1; the material's where the geometry has none of its own."""
    groups: Int[np.ndarray, "G"]
    """Viewers draw the groups below 3; geometries that only collide are often in those above."""


@dataclass(frozen=True, eq=False)
class Tree:
    """Frames of a compiled description's bodies, and its hinges' frames before they turn."""

    bodies: list[Frame]  # World first.
    hinges: dict[int, Frame]  # In the frame of the parent node, by MuJoCo's joint number.


def tree_of(compiled: mujoco.MjModel) -> Tree:
    """Return the frames of all bodies and hinges."""
    root = Frame(0, np.zeros(3), np.eye(3))
    bodies: list[Frame] = [root]
    hinges: dict[int, Frame] = {}
    for index in range(1, compiled.nbody):
        first, count = compiled.body_jntadr[index], compiled.body_jntnum[index]
        if count and compiled.jnt_type[first] == mujoco.mjtJoint.mjJNT_FREE:
            bodies.append(root)
            continue
        rotation = se3.quat_to_matrix(compiled.body_quat[index])
        body = bodies[compiled.body_parentid[index]].of(compiled.body_pos[index], rotation)
        for joint in range(first, first + count):
            anchor = compiled.jnt_pos[joint]
            hinges[joint] = body.of(anchor, np.eye(3))
            # A node sits at its hinge's anchor: the body's origin is then at minus the anchor.
            body = Frame(len(hinges), -anchor, np.eye(3))
        bodies.append(body)
    return Tree(bodies, hinges)


def sites_of(compiled: mujoco.MjModel, tree: Tree) -> list[tuple[str, Frame]]:
    """Return all sites by name."""
    return [
        (
            compiled.site(index).name,
            tree.bodies[compiled.site_bodyid[index]].of(
                compiled.site_pos[index], se3.quat_to_matrix(compiled.site_quat[index])
            ),
        )
        for index in range(compiled.nsite)
    ]


def bodies_of(compiled: mujoco.MjModel, tree: Tree) -> list[tuple[str, Frame]]:
    """Return all bodies but the world by name."""
    return [(compiled.body(index).name, tree.bodies[index]) for index in range(1, compiled.nbody)]


def inertias_of(compiled: mujoco.MjModel) -> Inertias:
    """Return masses and centres of the bodies with mass."""
    massive = 1 + np.flatnonzero(compiled.body_mass[1:] > 0)
    return Inertias(frozen(compiled.body_mass[massive]), frozen(compiled.body_ipos[massive]))


def geometries_of(compiled: mujoco.MjModel, tree: Tree) -> Geometries:
    """Return all geometries."""
    bodies, meshes = compiled.geom_bodyid, compiled.geom_dataid
    types = [mujoco.mjtGeom(kind) for kind in compiled.geom_type]
    return Geometries(
        bodies=tuple(compiled.body(body).name for body in bodies),
        frames=tuple(
            tree.bodies[body].of(position, se3.quat_to_matrix(quat))
            for body, position, quat in zip(bodies, compiled.geom_pos, compiled.geom_quat, strict=True)
        ),
        types=tuple(kind.name.removeprefix("mjGEOM_").lower() for kind in types),
        sizes=frozen(compiled.geom_size),
        meshes=tuple(
            compiled.mesh(mesh).name if kind == mujoco.mjtGeom.mjGEOM_MESH else ""
            for kind, mesh in zip(types, meshes, strict=True)
        ),
        colours=frozen([_colour(compiled, geom) for geom in range(compiled.ngeom)]).reshape(-1, 4),
        groups=frozen(compiled.geom_group, int),
    )


def _colour(compiled: mujoco.MjModel, geom: int) -> np.ndarray:
    material, rgba = compiled.geom_matid[geom], compiled.geom_rgba[geom]
    return compiled.mat_rgba[material] if material >= 0 and np.array_equal(rgba, _NO_COLOUR) else rgba
