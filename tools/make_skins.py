"""Make the skin files of this package's robots from their makers' meshes, of which nothing else is kept.

    python tools/make_skins.py unitree_g1 ../shared/data/robots/unitree_g1/meshes

One run takes some minutes. The mesh files are those that the robot's specification names.
"""

import argparse
from pathlib import Path

import mujoco
import numpy as np
from scipy import ndimage

from hoi_retarget.kernels.shape import DistanceGrid
from hoi_retarget.numerics import se3
from hoi_retarget.robots import load_robot, robot
from hoi_retarget.robots.mjcf import read_mjcf
from hoi_retarget.robots.outer_skin import (
    OuterSkin,
    Outside,
    grid_around,
    grid_nodes,
    mesh_distances,
    outer_skin,
    reached_from_afar,
    resolution_of,
)
from hoi_retarget.robots.skin import write_skins
from hoi_retarget.robots.spec import RobotSpec
from hoi_retarget.studio.scene.robot_shapes import attach_visual_meshes

SAME = 5e-4
"""Links whose mirrored meshes differ by no more than this [m] have mirrored skins."""
BALL = 0.0025
"""Radius of the ball that finds the outside of the whole robot, and the distance of its places [m]."""
WIDE = 0.010
"""Radius of a second ball [m]: what the first one finds beyond slits that are too narrow for this one is no outside."""
SLIT = 4
"""So many places into such a slit still are."""
POSES = 8
"""In how many poses: a hollow is plugged by other links in all of them, a bend opens in some."""

Mesh = tuple[np.ndarray, np.ndarray]
"""Vertices [m] and triangles."""


def compiled_with_meshes(spec: RobotSpec, folder: Path) -> mujoco.MjModel:
    """Return the robot with its maker's meshes on it."""
    description = read_mjcf(spec.mjcf, spec.sites)
    attach_visual_meshes(description, spec, folder)
    return description.compile()


def link_meshes(compiled: mujoco.MjModel) -> dict[str, Mesh]:
    """Return the meshes of each link in the body's frame."""
    meshes: dict[str, Mesh] = {}
    for body in range(1, compiled.nbody):
        vertices, faces, before = [], [], 0
        for geom in np.flatnonzero((compiled.geom_bodyid == body) & (compiled.geom_type == mujoco.mjtGeom.mjGEOM_MESH)):
            mesh = compiled.mesh(int(compiled.geom_dataid[geom]))
            own = compiled.mesh_vert[int(mesh.vertadr[0]) :][: int(mesh.vertnum[0])].astype(float)
            turn = se3.quat_to_matrix(compiled.geom_quat[geom])
            vertices.append(own @ turn.T + compiled.geom_pos[geom])
            faces.append(compiled.mesh_face[int(mesh.faceadr[0]) :][: int(mesh.facenum[0])].astype(np.int64) + before)
            before += len(own)
        if vertices:
            meshes[compiled.body(body).name] = np.concatenate(vertices), np.concatenate(faces)
    return meshes


def outsides(compiled: mujoco.MjModel, meshes: dict[str, Mesh]) -> dict[str, Outside]:
    """Return the outside of each link as part of the whole robot, in several poses."""
    grids = {link: distances_around(mesh) for link, mesh in meshes.items()}
    found: dict[str, list[np.ndarray]] = {link: [] for link in meshes}
    random, data = np.random.default_rng(0), mujoco.MjData(compiled)
    hinges = compiled.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    low, high = compiled.jnt_range[hinges].T
    for pose in range(POSES):
        share = random.uniform(0.3, 0.7, len(low))
        data.qpos[compiled.jnt_qposadr[hinges]] = low + share * (high - low) if pose else 0.0
        mujoco.mj_kinematics(compiled, data)
        places = {link: (data.body(link).xpos.copy(), data.body(link).xmat.reshape(3, 3).copy()) for link in meshes}
        world = np.concatenate([meshes[link][0] @ turn.T + place for link, (place, turn) in places.items()])
        origin, shape = grid_around(world, BALL, 2 * WIDE)
        fits, fits_wide = np.ones(shape, dtype=bool), np.ones(shape, dtype=bool)
        near: dict[str, tuple[tuple[slice, ...], np.ndarray, np.ndarray]] = {}
        for link, (place, turn) in places.items():
            own = meshes[link][0] @ turn.T + place
            first = np.floor((own.min(axis=0) - WIDE - origin) / BALL).astype(int).clip(0)
            last = np.minimum(np.ceil((own.max(axis=0) + WIDE - origin) / BALL).astype(int) + 1, shape)
            box = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
            x, y, z = last - first
            nodes = (grid_nodes(origin + BALL * first, BALL, (int(x), int(y), int(z))) - place) @ turn
            room = grids[link].distances(nodes)
            fits[box] &= (room > BALL).reshape(last - first)
            fits_wide[box] &= (room > WIDE).reshape(last - first)
            near[link] = box, nodes, room
        # A ball's centre is no nearer than its radius: as far again, the wide one is as near as the other.
        into = SLIT + round(WIDE / BALL) - 1
        reached = ndimage.binary_dilation(reached_from_afar(fits_wide), iterations=into, mask=reached_from_afar(fits))
        for link, (box, nodes, room) in near.items():
            found[link].append(nodes[reached[box].reshape(-1) & (room <= 3 * BALL)])
    return {link: outside_at(np.concatenate(places), meshes[link]) for link, places in found.items()}


def distances_around(mesh: Mesh) -> DistanceGrid:
    """Return the distances from a mesh, unsigned."""
    origin, shape = grid_around(mesh[0], BALL, 5 * BALL)
    values = mesh_distances(grid_nodes(origin, BALL, shape), *mesh)
    return DistanceGrid(origin, BALL, values.reshape(shape).astype(np.float32))


def outside_at(centres: np.ndarray, mesh: Mesh) -> Outside:
    """Return the balls at some centres, those left out that nearly coincide."""
    _, first = np.unique(np.floor(centres / (0.5 * BALL)).astype(np.int64), axis=0, return_index=True)
    return Outside(centres[first], mesh_distances(centres[first], *mesh))


def make(name: str, folder: Path) -> None:
    """Write the skin file of one robot."""
    spec, model = robot(name), load_robot(name)
    compiled = compiled_with_meshes(spec, folder)
    meshes = link_meshes(compiled)
    outside = outsides(compiled, meshes)
    skins: dict[str, OuterSkin] = {}
    mirrored: dict[str, str] = {}
    for link, (vertices, faces) in meshes.items():
        other = link.replace("right_", "left_", 1)
        if other != link and other in meshes and are_mirrored(meshes[other], (vertices, faces)):
            mirrored[link] = other
            continue
        skins[link] = outer_skin(vertices, faces, resolution_of(model, link), outside[link])
        print(f"{link}: {len(skins[link].points)} points, grid {skins[link].solid.values.shape}", flush=True)
    assert spec.skin is not None
    write_skins(spec.skin, skins, mirrored)
    print(f"{spec.skin}: {spec.skin.stat().st_size / 1e3:.0f} kB; mirrored: {', '.join(mirrored)}")


def are_mirrored(left: Mesh, right: Mesh) -> bool:
    """Return whether vertices and centres of triangles lie on the other mesh, both ways."""
    return all(
        mesh_distances(np.concatenate([vertices, vertices[faces].mean(axis=1)]) * [1.0, -1.0, 1.0], *other).max() < SAME
        for (vertices, faces), other in ((left, right), (right, left))
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Make the skin file of a robot from its maker's meshes.")
    parser.add_argument("robot")
    parser.add_argument("meshes", type=Path)
    arguments = parser.parse_args()
    make(arguments.robot, arguments.meshes)
