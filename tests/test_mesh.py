"""Nearest points of surfaces: against all triangles one by one, and the laws that hold for any of them."""

import itertools
import os

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from trimesh.triangles import closest_point

from hoi_retarget.errors import ClipError, GeometryError
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.readers.object_files import load_geometry
from intermimic_writer import write_box
from synthetic import OBJECTS, make
from synthetic.object_shapes import shape

FAST = settings(max_examples=20, deadline=None, derandomize=True, database=None)
seeds = st.integers(0, 10_000)


def soup(seed: int, count: int = 40) -> Surface:
    """Triangles of very different sizes, some of them without area or even length."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(count, 1, 3)) + 10.0 ** rng.uniform(-4, 0.5, (count, 1, 1)) * rng.normal(
        size=(count, 3, 3)
    )
    corners[0] = corners[0, :1]  # a point
    corners[1, 2] = 0.3 * corners[1, 0] + 0.7 * corners[1, 1]  # an edge
    return Surface(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def brute_force(surface: Surface, points: np.ndarray) -> np.ndarray:
    """Distances by trimesh, each point against every triangle that has an area."""
    proper = surface.triangles[np.linalg.norm(np.cross(*np.diff(surface.triangles, axis=1).swapaxes(0, 1)), axis=1) > 0]
    return np.array(
        [
            np.linalg.norm(closest_point(proper, np.repeat(point[None], len(proper), 0)) - point, axis=1).min()
            for point in points
        ]
    )


@FAST
@given(seed=seeds, reach=st.sampled_from([0.05, 1.0, 20.0]))
def test_no_triangle_is_nearer(seed, reach):
    surface = soup(seed)
    points = reach * np.random.default_rng(seed + 1).normal(size=(30, 3))
    # The point and the edge among the triangles lie anywhere: an all-pairs answer may only be farther.
    assert (surface.distances(points) <= brute_force(surface, points) + 1e-9).all()


@pytest.mark.parametrize("name", OBJECTS)
def test_normals_are_across_the_nearest_face(name):
    surface = Surface(*shape(name).mesh)
    a, b, c = surface.triangles.transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    middles = (a + b + c) / 3
    # Boxes that touch have two faces in one place, of opposite sides.
    found = surface.normals(middles + 1e-6 * normals)
    np.testing.assert_allclose(np.abs(np.sum(found * normals, axis=1)), 1.0, atol=1e-9)
    assert surface.normals(np.zeros((0, 3))).shape == (0, 3)


def test_a_surface_without_area_has_normals_all_the_same():
    edge = Surface(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.array([[0, 1, 1]]))
    np.testing.assert_array_equal(edge.normals(np.ones((2, 3))), [[0.0, 0.0, 1.0]] * 2)


@pytest.mark.parametrize("name", OBJECTS)
def test_distances_are_those_of_all_triangles(name):
    surface = Surface(*shape(name).mesh)
    points = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_allclose(surface.distances(points), brute_force(surface, points), atol=1e-12)


def test_a_round_mesh_with_many_triangles():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    surface = Surface(np.asarray(ball.vertices), np.asarray(ball.faces))
    points = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_allclose(surface.distances(points), brute_force(surface, points), atol=1e-12)
    middle = surface.closest_points(np.zeros((2, 3)))
    np.testing.assert_allclose(np.linalg.norm(middle, axis=1), 0.5, atol=2e-3)


@FAST
@given(seed=seeds)
def test_a_point_on_the_surface_is_its_own_nearest(seed):
    surface, rng = soup(seed), np.random.default_rng(seed)
    weights = rng.dirichlet(np.ones(3), size=40)
    points = np.einsum("nc,ncj->nj", weights, surface.triangles)
    np.testing.assert_allclose(surface.closest_points(points), points, atol=1e-9)


@FAST
@given(seed=seeds)
def test_rigid_motions_carry_the_nearest_points_along(seed):
    surface, rng = soup(seed), np.random.default_rng(seed)
    quat, shift, points = se3.exp(rng.normal(size=3)), rng.normal(size=3), rng.normal(size=(20, 3))
    moved = Surface(se3.rotate(quat, surface.vertices) + shift, surface.faces)
    there = moved.closest_points(se3.rotate(quat, points) + shift)
    np.testing.assert_allclose(there, se3.rotate(quat, surface.closest_points(points)) + shift, atol=1e-9)


@FAST
@given(seed=seeds)
def test_the_nearest_point_of_a_nearest_point_is_itself(seed):
    surface, points = soup(seed), np.random.default_rng(seed).normal(size=(20, 3))
    once = surface.closest_points(points)
    np.testing.assert_allclose(surface.closest_points(once), once, atol=1e-9)


def test_no_points():
    surface = soup(0)
    assert surface.closest_points(np.zeros((0, 3))).shape == (0, 3)
    assert surface.distances(np.zeros((0, 3))).shape == surface.signed_distances(np.zeros((0, 3))).shape == (0,)


@pytest.mark.parametrize("height", 10.0 ** np.arange(-9, 0))
@pytest.mark.parametrize("corner", [0, 1, 2])
def test_thin_triangles_lose_no_place(height, corner):
    """Needles and caps of any thinness: their own places are as near as the arithmetic allows."""
    rng = np.random.default_rng(corner)
    for apex in (0.0, 0.3):  # Above an end of the long edge, and between its ends.
        ends = rng.normal(size=(2, 3))
        third = (1 - apex) * ends[0] + apex * ends[1] + height * rng.normal(size=3)
        triangle = np.roll(np.concatenate([ends, third[None]]), corner, axis=0)
        places = rng.dirichlet(np.ones(3), size=50) @ triangle
        assert Surface(triangle, np.array([[0, 1, 2]])).distances(places).max() < 2e-5


# Inside and outside


SIZE = np.array([0.4, 0.6, 1.0])


def crate(*, lid: bool = True, inside_out: bool = False) -> Surface:
    """A box of `SIZE` about the origin, its triangles facing outwards; without a lid it is open at its top."""
    box = trimesh.creation.box(SIZE)
    faces = np.asarray(box.faces)[:, ::-1] if inside_out else np.asarray(box.faces)
    is_lid = (np.asarray(box.vertices)[faces][:, :, 2] > 0).all(axis=1)
    return Surface(np.asarray(box.vertices), faces if lid else faces[~is_lid])


def box_distances(points: np.ndarray) -> np.ndarray:
    """Signed distances from the box, by its formula."""
    beyond = np.abs(points) - 0.5 * SIZE
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


@pytest.mark.parametrize("inside_out", [False, True])
def test_signed_distances_from_a_box(inside_out):
    surface, rng = crate(inside_out=inside_out), np.random.default_rng(0)
    points = rng.uniform(-1.0, 1.0, (2000, 3)) * SIZE
    np.testing.assert_allclose(surface.signed_distances(points), box_distances(points), atol=1e-12)
    assert 0.05 < (surface.signed_distances(points) < 0).mean() < 0.95


@pytest.mark.parametrize("depth", [-1e-3, -1e-6, -1e-8, -1e-11, 1e-11, 1e-8, 1e-6, 1e-3])
def test_the_side_of_a_point_beside_the_surface_is_known(depth):
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.4, 0.4, (200, 3)) * SIZE
    points[:, 0] = 0.5 * SIZE[0] + depth
    np.testing.assert_allclose(crate().signed_distances(points), depth, rtol=1e-3)


def test_signed_distances_from_a_ball():
    """On the rays of its vertices outside, and below the middles of its triangles inside, they are known exactly."""
    radius = 0.5
    ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    surface = Surface(np.asarray(ball.vertices), np.asarray(ball.faces))
    for height in (1e-9, 1e-3, 2.0):
        above = surface.vertices * (1.0 + height / radius)
        np.testing.assert_allclose(surface.signed_distances(above), height, atol=1e-9)
    a, b, c = np.moveaxis(surface.triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for depth in (1e-9, 1e-3, 0.1):
        below = surface.triangles.mean(axis=1) - depth * normals
        np.testing.assert_allclose(surface.signed_distances(below), -depth, atol=1e-9)
    (middle,) = surface.signed_distances(np.zeros((1, 3)))
    np.testing.assert_allclose(middle, -np.einsum("fi,fi->f", a, normals).min(), atol=1e-9)


def test_an_open_box_holds_what_is_deep_in_it():
    surface = crate(lid=False)
    deep, above, beside = np.array([[0.0, 0.0, -0.2], [0.0, 0.0, 0.7], [0.3, 0.0, 0.0]])
    found = surface.signed_distances(np.stack([deep, above, beside]))
    np.testing.assert_allclose(found, [-0.2, np.hypot(0.2, 0.2), 0.1], atol=1e-12)
    # In the middle of the opening, less than half of what is seen there is the box.
    assert surface.signed_distances(np.array([[0.0, 0.0, 0.55]]))[0] > 0


@pytest.mark.parametrize("face", range(12))
def test_a_surface_is_closed_until_a_triangle_is_missing_or_turned(face):
    box = crate()
    parts = Surface(box.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3))
    turned = box.faces.copy()
    turned[face] = turned[face, ::-1]
    assert box.closed and parts.closed, "corners in one place are one"
    assert not Surface(box.vertices, np.delete(box.faces, face, axis=0)).closed
    assert not Surface(box.vertices, turned).closed


@pytest.mark.parametrize("edge", [(0, 1), (1, 2), (2, 0)])
def test_places_on_each_edge_of_a_thin_triangle_are_exact(edge):
    """The search for the nearest place on a triangle without area may miss its edges."""
    ends = np.array([[0.3, -0.2, 0.7], [1.1, 0.4, -0.5]])
    for corner, apex in itertools.product(range(3), (0.0, 0.3, 1.0)):
        needle = np.roll([*ends, apex * ends[0] + (1 - apex) * ends[1]], corner, axis=0)
        share = np.random.default_rng(0).uniform(size=(50, 1))
        places = share * needle[edge[0]] + (1 - share) * needle[edge[1]]
        surface = Surface(needle, np.array([[0, 1, 2]]))
        np.testing.assert_allclose(surface.closest_points(places), places, atol=1e-12)
        faces = surface._tree[1]
        assert {frozenset(face) for face in faces.tolist()} >= {frozenset(edge)}


def test_triangles_without_area_and_overlapping_solids_change_no_side():
    box, points = crate(), np.random.default_rng(0).uniform(-1.0, 1.0, (500, 3))
    shift = np.array([0.1, 0.0, 0.0])
    twice = Surface(
        np.concatenate([box.vertices, box.vertices + shift]),
        np.concatenate([box.faces, box.faces + len(box.vertices), [[0, 0, 0], [0, 1, 1]]]),
    )
    either = np.minimum(box_distances(points), box_distances(points - shift)) < 0
    np.testing.assert_array_equal(twice.signed_distances(points) < 0, either)


def test_hulls_have_an_inside_and_flat_ones_none():
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (500, 3))
    hull = surface_of(ObjectGeometry(crate().vertices))
    np.testing.assert_allclose(hull.signed_distances(points), box_distances(points), atol=1e-12)
    flat = surface_of(ObjectGeometry(crate().vertices * [1.0, 1.0, 0.0]))
    assert (flat.signed_distances(points) >= 0).all()


@FAST
@given(seed=seeds)
def test_faces_of_a_hull_are_wound_outwards(seed):
    rng = np.random.default_rng(seed)
    hull = surface_of(ObjectGeometry(rng.normal(size=3) + rng.uniform(0.1, 2.0, 3) * rng.normal(size=(30, 3))))
    points, normals = hull.random_points(200)
    assert (np.einsum("ki,ki->k", points - hull.vertices.mean(axis=0), normals) > 0).all()
    assert hull.closed
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    np.testing.assert_allclose(hull.distances(points), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["carry_box", "carry_table"])
def test_synthetic_clips_have_exact_surfaces(name):
    geometry = make(name).objects[0].geometry
    surface = surface_of(geometry)
    assert surface.exact
    np.testing.assert_array_equal(surface.vertices, geometry.points)
    assert surface.closest_points(np.zeros((1, 3))).shape == (1, 3)


def test_a_mesh_file_is_read_again_only_when_it_changes(tmp_path):
    write_box(tmp_path, "box")
    geometry = load_geometry(tmp_path, "box")
    surface = surface_of(geometry)
    assert surface.exact and surface_of(geometry) is surface
    np.testing.assert_allclose(np.ptp(surface.vertices, axis=0), np.ptp(geometry.points, axis=0), atol=1e-6)
    assert geometry.mesh_path is not None
    os.utime(geometry.mesh_path, (1, 1))
    assert surface_of(geometry) is not surface


def test_points_alone_give_their_hull():
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * 0.5
    surface = surface_of(ObjectGeometry(corners))
    assert not surface.exact
    np.testing.assert_allclose(surface.closest_points(np.array([[2.0, 0.1, 0.2]])), [[0.5, 0.1, 0.2]], atol=1e-12)


@pytest.mark.parametrize(
    ("points", "nearest"),
    [
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 0.5, 0]], [0.3, 0.8, 0]),
        ([[0, 0, 0], [1, 0, 0], [0.5, 0, 0]], [0.3, 0, 0]),
        ([[0.2, 0.2, 0]], [0.2, 0.2, 0]),
    ],
    ids=["flat", "straight", "single"],
)
def test_hulls_without_volume(points, nearest):
    surface = surface_of(ObjectGeometry(np.array(points, dtype=float)))
    np.testing.assert_allclose(surface.closest_points(np.array([[0.3, 0.8, 2.0]])), [nearest], atol=1e-12)


@pytest.mark.parametrize("content", [b"", b"not a mesh", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", b"v 0 0 0\nf 1 2 3\n", None])
def test_what_is_no_mesh_is_refused(tmp_path, content):
    path = tmp_path / "box.obj"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(GeometryError, match=str(path)):
        surface_of(ObjectGeometry(np.zeros((1, 3)), mesh_path=path))


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        (np.zeros((3, 3)), np.zeros((0, 3), int)),
        (np.zeros((3, 3)), [[0, 1, 3]]),
        (np.full((3, 3), np.nan), [[0, 1, 2]]),
    ],
)
def test_surfaces_that_are_none(vertices, faces):
    with pytest.raises(GeometryError, match="surface"):
        Surface(vertices, np.asarray(faces))


def test_faces_beyond_the_points_are_refused():
    with pytest.raises(ClipError, match="beyond the 3"):
        ObjectGeometry(np.zeros((3, 3)), faces=np.array([[0, 1, 3]]))
