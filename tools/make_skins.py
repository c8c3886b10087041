"""Make the skin files of this package's robots from their makers' meshes, of which nothing else is kept.

    python tools/make_skins.py unitree_g1 ../shared/data/robots/unitree_g1/meshes

One run takes some minutes. The mesh files are those that the robot's specification names.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from hoi_retarget.numerics import se3
from hoi_retarget.robots import load_robot, robot
from hoi_retarget.robots.mjcf import read_mjcf
from hoi_retarget.robots.outer_skin import OuterSkin, fineness_of, mesh_distances, outer_skin
from hoi_retarget.robots.skin_file import write_skins
from hoi_retarget.robots.spec import RobotSpec
from hoi_retarget.viewers.scene.vendor_meshes import attach_visual_meshes

SAME = 5e-4
"""Links whose mirrored meshes differ by no more than this [m] have mirrored skins."""


def link_meshes(spec: RobotSpec, folder: Path) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield each link with the vertices [m] and triangles of its meshes, in the body's frame."""
    description = read_mjcf(spec.mjcf, spec.sites)
    attach_visual_meshes(description, spec, folder)
    compiled = description.compile()
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
            yield compiled.body(body).name, np.concatenate(vertices), np.concatenate(faces)


def make(name: str, folder: Path) -> None:
    """Write the skin file of one robot."""
    spec, model = robot(name), load_robot(name)
    meshes = {link: (vertices, faces) for link, vertices, faces in link_meshes(spec, folder)}
    skins: dict[str, OuterSkin] = {}
    mirrored: dict[str, str] = {}
    for link, (vertices, faces) in meshes.items():
        other = link.replace("right_", "left_", 1)
        if other != link and other in meshes and are_mirrored(meshes[other], (vertices, faces)):
            mirrored[link] = other
            continue
        skins[link] = outer_skin(vertices, faces, fineness_of(model, link))
        print(f"{link}: {len(skins[link].points)} points, grid {skins[link].solid.values.shape}", flush=True)
    assert spec.skin is not None
    write_skins(spec.skin, skins, mirrored)
    print(f"{spec.skin}: {spec.skin.stat().st_size / 1e3:.0f} kB; mirrored: {', '.join(mirrored)}")


def are_mirrored(left: tuple[np.ndarray, np.ndarray], right: tuple[np.ndarray, np.ndarray]) -> bool:
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
