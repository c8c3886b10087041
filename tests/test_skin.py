"""Skins of robots: points on the outside only, solids with the right sign, and both the makers' own shapes."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from hoi_retarget.errors import RobotError
from hoi_retarget.kernels.shape import DistanceGrid
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import load_model
from hoi_retarget.robots.outer_skin import OuterSkin, SkinResolution, farthest_points, outer_skin, resolution_of
from hoi_retarget.robots.skin import read_skins, skin_of, write_skins
from plain_kernels import node_distances

ROBOTS = ("unitree_g1", "unitree_h2")
SHARED = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "robots"
COARSE = SkinResolution(nodes=0.002, ball=0.003, spacing=0.008, grid=0.004)


def grid_of_a_plane(normal: np.ndarray, offset: float) -> DistanceGrid:
    origin, step = np.array([-0.1, -0.2, 0.3]), 0.05
    nodes = origin + step * np.stack(np.meshgrid(*map(np.arange, (5, 6, 7)), indexing="ij"), axis=-1)
    return DistanceGrid(origin, step, (nodes @ normal - offset).astype(np.float32))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_grid_is_exact_for_planes(seed):
    random = np.random.default_rng(seed)
    normal = random.normal(size=3)
    normal /= np.linalg.norm(normal)
    grid = grid_of_a_plane(normal, 0.1)
    points = random.uniform([-0.1, -0.2, 0.3], [0.1, 0.05, 0.6], (20, 3))
    distances, normals = grid.distances_and_normals(points)
    np.testing.assert_allclose(distances, points @ normal - 0.1, atol=1e-7)
    np.testing.assert_allclose(distances, grid.distances(points), atol=1e-12)
    np.testing.assert_allclose(normals, np.tile(normal, (20, 1)), atol=2e-6)
    assert np.abs(node_distances(grid, points) - distances).max() <= 0.5 * np.sqrt(3) * grid.step + 1e-6


def test_beyond_a_grid_distances_grow_with_the_way_to_it():
    grid = grid_of_a_plane(np.array([1.0, 0.0, 0.0]), 0.0)
    distances, normals = grid.distances_and_normals(np.array([[2.1, 0.0, 0.4]]))
    np.testing.assert_allclose(distances, 0.1 + 2.0, atol=1e-9)
    np.testing.assert_allclose(normals, [[1.0, 0.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(node_distances(grid, np.array([[2.1, 0.0, 0.4]])), 2.1, atol=0.03)


def housing() -> trimesh.Trimesh:
    """A box with a hole in one wall, a motor inside, and half of its triangles wound the other way."""
    box = trimesh.creation.box((0.1, 0.08, 0.06)).subdivide().subdivide().subdivide().subdivide()
    rim = np.linalg.norm(box.triangles_center - [0.05, 0.0, 0.0], axis=1)
    box.update_faces(rim > 0.0025)
    box.faces[::2] = box.faces[::2, ::-1]
    return trimesh.util.concatenate([box, trimesh.creation.icosphere(3, 0.02)])


@pytest.mark.parametrize("turned", [False, True])
def test_internals_are_no_skin_and_no_hole(turned):
    mesh = housing()
    if turned:
        mesh.faces = mesh.faces[:, ::-1]
    skin = outer_skin(mesh.vertices, mesh.faces, COARSE)
    half = np.array([0.05, 0.04, 0.03])
    assert (np.abs(np.abs(skin.points) - half).min(axis=1) < 1e-9).all()
    assert (np.einsum("ki,ki->k", skin.normals, skin.points) > 0.0).all()
    random = np.random.default_rng(0)
    points = random.uniform(-1.4 * half, 1.4 * half, (2000, 3))
    beyond = np.abs(points) - half
    exact = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
    away = np.abs(exact) > 0.002
    distances = skin.solid.distances(points)
    assert (np.sign(distances) == np.sign(exact))[away].all()
    assert np.percentile(np.abs(distances - exact), 99) < 0.0015


def test_a_prefix_of_points_is_a_coarser_skin():
    points = np.random.default_rng(0).normal(size=(3000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    chosen = farthest_points(points, 0.1)
    reach = [cKDTree(points[chosen[:count]]).query(points)[0].max() for count in (10, 30, 100, len(chosen))]
    assert reach == sorted(reach, reverse=True)
    assert reach[-1] <= 0.1
    apart = cKDTree(points[chosen]).query(points[chosen], k=2)[0][:, 1]
    assert apart.min() > 0.1


def test_a_file_of_skins_gives_them_back(tmp_path):
    mesh = trimesh.creation.box((0.1, 0.08, 0.06))
    skin = outer_skin(mesh.vertices + np.array([0.02, 0.03, 0.0]), mesh.faces, COARSE)
    write_skins(tmp_path / "skin.npz", {"left_arm": skin}, {"right_arm": "left_arm"})
    left, right = (read_skins(tmp_path / "skin.npz")[link] for link in ("left_arm", "right_arm"))
    np.testing.assert_allclose(left.points, skin.points, atol=1.1e-5)
    np.testing.assert_allclose(left.normals, skin.normals, atol=0.01)
    np.testing.assert_allclose(left.solid.values, skin.solid.values, atol=5.1e-5)
    np.testing.assert_array_equal(right.points, left.points * [1, -1, 1])
    places = np.random.default_rng(0).uniform(-0.1, 0.1, (50, 3))
    np.testing.assert_allclose(right.solid.distances(places * [1, -1, 1]), left.solid.distances(places), atol=1e-9)


def test_skins_of_large_links_are_written_too(tmp_path):
    mesh = trimesh.creation.box((0.3, 0.2, 1.8))
    skin = outer_skin(mesh.vertices, mesh.faces, replace(COARSE, nodes=0.02, ball=0.03, spacing=0.05, grid=0.05))
    write_skins(tmp_path / "skin.npz", {"torso": skin}, {})
    np.testing.assert_allclose(read_skins(tmp_path / "skin.npz")["torso"].points, skin.points, atol=1.1e-5)


def test_a_damaged_skin_file_is_one_clear_error(tmp_path):
    file = tmp_path / "skin.npz"
    model = load_model(replace(load_robot("unitree_g1").spec, skin=file))
    with pytest.raises(RobotError, match=r"skin\.npz.*make_skins"):
        skin_of(model)
    file.write_bytes(b"PK\x03\x04 no archive")
    with pytest.raises(RobotError, match=r"skin\.npz.*make_skins"):
        skin_of(model)
    write_skins(file, {"third_arm": a_small_skin()}, {})
    with pytest.raises(RobotError, match="third_arm"):
        skin_of(model)


def a_small_skin() -> OuterSkin:
    mesh = trimesh.creation.icosphere(2, 0.02)
    return outer_skin(mesh.vertices, mesh.faces, COARSE)


@pytest.mark.parametrize("name", ROBOTS)
def test_skins_of_the_robots(name):
    model = load_robot(name)
    skin = skin_of(model)
    assert {link.link for link in skin.links} == set(model.spec.meshes)
    for link in skin.links:
        assert link.frame is model.body_frames.frames[link.link]
        np.testing.assert_allclose(np.linalg.norm(link.normals, axis=1), 1.0, atol=1e-9)
        assert (np.linalg.norm(link.points - link.centre, axis=1) <= link.radius + 1e-12).all()
        # Thin walls and hollows apart, points lie on the solid's skin, and normals point out of it.
        assert np.median(np.abs(link.solid.distances(link.points))) < 0.0015
        assert (link.solid.distances(link.points + 0.004 * link.normals) > 0.0).mean() > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_colliding_geometries_are_the_skin_of_a_robot_without_a_skin_file(name):
    model = load_model(replace(load_robot(name).spec, skin=None))
    skin = skin_of(model)
    assert "left_wrist_yaw_link" in skin.by_link
    outside = []
    for link in skin.links:
        assert np.abs(link.solid.distances(link.points)).max() < 0.5 * link.solid.step
        without, within = (link.solid.distances(link.points + way * link.normals) for way in (0.003, -0.003))
        assert (without > within).mean() > 0.99
        # Where two geometries of a link meet, what is off the one is in the other.
        outside.append(link.solid.distances(link.points + 0.01 * link.normals) > 0.0)
        assert outside[-1].mean() > 0.9
        own = cKDTree(link.points).query(link.points, k=2)[0][:, 1]
        assert own.max() <= 2.0 * resolution_of(model, link.link).spacing
    assert np.concatenate(outside).mean() > 0.97


def maker_meshes(name: str):
    folder = SHARED / name / "meshes"
    if not folder.is_dir():
        pytest.skip(f"the maker's meshes are not at {folder}")
    import mujoco

    from hoi_retarget.numerics import se3

    if name == "unitree_g1":
        compiled = mujoco.MjModel.from_xml_path(str(SHARED / name / "g1_29dof_rev_1_0.xml"))
    else:
        text = re.sub("<mujoco>.*</mujoco>", "", (SHARED / name / "H2.urdf").read_text(), flags=re.DOTALL)
        compiler = f'<compiler meshdir="{folder}" strippath="true" fusestatic="true" discardvisual="false"/>'
        compiled = mujoco.MjModel.from_xml_string(text.replace("</robot>", f"<mujoco>{compiler}</mujoco></robot>"))
    meshes: dict[str, list[trimesh.Trimesh]] = {}
    for geom in np.flatnonzero(compiled.geom_type == mujoco.mjtGeom.mjGEOM_MESH):
        mesh = compiled.mesh(int(compiled.geom_dataid[geom]))
        vertices = compiled.mesh_vert[int(mesh.vertadr[0]) :][: int(mesh.vertnum[0])]
        faces = compiled.mesh_face[int(mesh.faceadr[0]) :][: int(mesh.facenum[0])]
        turn = se3.quat_to_matrix(compiled.geom_quat[geom])
        body = compiled.body(int(compiled.geom_bodyid[geom])).name
        meshes.setdefault(body, []).append(
            trimesh.Trimesh(vertices @ turn.T + compiled.geom_pos[geom], faces, process=False)
        )
    return compiled, {body: trimesh.util.concatenate(own) for body, own in meshes.items()}


@pytest.mark.parametrize("name", ROBOTS)
def test_bodies_lie_where_the_makers_do(name):
    import mujoco

    theirs, meshes = maker_meshes(name)
    ours = mujoco.MjModel.from_xml_path(str(load_robot(name).spec.mjcf))
    places = []
    links = sorted(set(meshes) - {"world"})
    for compiled in (ours, theirs):
        data = mujoco.MjData(compiled)
        mujoco.mj_kinematics(compiled, data)
        root = "pelvis" if compiled is ours or "pelvis" in meshes else "world"  # A URDF's base is fixed.
        turn, start = data.body(root).xmat.reshape(3, 3), data.body(root).xpos
        places.append([(data.body(link).xpos - start) @ turn for link in links])
        places.append([turn.T @ data.body(link).xmat.reshape(3, 3) for link in links])
    np.testing.assert_allclose(places[0], places[2], atol=1e-5)
    np.testing.assert_allclose(places[1], places[3], atol=1e-4)


def plugged(model, link: str, places: np.ndarray) -> np.ndarray:
    """Return which places next to a link are within 1 cm of other links in every pose: slits between links."""
    random = np.random.default_rng(0)
    low, high = model.lower, model.upper
    theta = low + random.uniform(0.3, 0.7, (6, len(low))) * (high - low)
    qpos = np.concatenate([np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (6, 1)), theta], axis=1)
    kinematics, skin = model.forward(qpos), skin_of(model)
    own = skin.by_link[link].frame
    near = np.ones(len(places), dtype=bool)
    for pose in range(len(qpos)):
        turns = {each.link: kinematics.orientation(each.frame)[:, :, pose] for each in skin.links}
        origins = {each.link: kinematics.point(each.frame)[:, pose] for each in skin.links}
        world = places @ kinematics.orientation(own)[:, :, pose].T + kinematics.point(own)[:, pose]
        others = [
            each.solid.distances((world - origins[each.link]) @ turns[each.link])
            for each in skin.links
            if each.link != link
        ]
        near &= np.min(others, axis=0) < 0.01
    return near


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_skins_against_the_makers_meshes(name):
    """Seen from outside: a ray along the triangle's normal, one way or the other, meets nothing of the link."""
    import igl

    _, meshes = maker_meshes(name)
    model = load_robot(name)
    skin = skin_of(model)
    inside, outside = [], []
    for body, mesh in meshes.items():
        own = skin.by_link["pelvis" if body == "world" else body]
        spacing = resolution_of(model, own.link).spacing
        vertices, faces = np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)
        tree = igl.AABB()
        tree.init(vertices, faces)
        assert np.sqrt(tree.squared_distance(vertices, faces, np.array(own.points))[0]).max() < 5e-4, body
        points, owner = trimesh.sample.sample_surface(mesh, 3000, seed=1)
        points, normals = np.array(points), mesh.face_normals[owner]
        free = [
            tree.intersect_ray_first(vertices, faces, points + 1e-4 * side * normals, side * normals)[0] < 0
            for side in (1.0, -1.0)
        ]
        outward = normals * (free[0].astype(float) - free[1])[:, None]
        # What other links hide in every pose is no skin.
        seen = (np.linalg.norm(outward, axis=1) > 0.5) & (np.abs(own.solid.distances(points)) < 0.0015)
        seen &= ~plugged(model, own.link, points + 0.01 * outward)
        points, outward = points[seen], outward[seen]
        away, nearest = cKDTree(own.points).query(points)
        assert (away <= spacing + 0.001).mean() > 0.97, body
        # The inner side of a wall is seen, too, through openings that other links plug.
        outer = np.einsum("ki,ki->k", outward, own.normals[nearest]) > 0.0
        points, outward = points[outer], outward[outer]
        # Walls as thin as the grid's step enclose nothing.
        way = tree.intersect_ray_first(vertices, faces, points - 1e-4 * outward, -outward)[1]
        thick = way > own.solid.step
        inside.append(own.solid.distances(points - 0.003 * outward)[thick] < 0.0)
        outside.append(own.solid.distances(points + 0.003 * outward) > 0.0)
        if "wrist_yaw" in body:
            fingers = mesh.vertices[mesh.vertices[:, 0] > 0.06]
            depth = own.solid.distances(np.array(fingers))
            assert np.median(np.abs(depth)) < 0.0005
            assert (depth < 0.003).all()
    assert np.concatenate(outside).mean() > 0.98
    assert np.concatenate(inside).mean() > 0.95


@pytest.mark.parametrize("name", ROBOTS)
def test_solids_end_where_their_links_do(name):
    """Outside is all that is beyond a link's grid, and no distance changes faster than by the way."""
    for skin in skin_of(load_robot(name)).links:
        values, step = skin.solid.values, skin.solid.step
        for axis in range(3):
            along = np.moveaxis(values, axis, 0)
            assert min(along[0].min(), along[-1].min()) > 0, skin.link
            assert np.abs(np.diff(along, axis=0)).max() < 2.5 * step, skin.link
            assert (np.abs(np.diff(along, axis=0)) > 1.3 * step).mean() < 0.03, skin.link
