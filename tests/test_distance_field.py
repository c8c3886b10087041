"""Distance fields: against formulas and exact surfaces, and the laws that hold for any of them."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.files import user_cache
from hoi_retarget.numerics import se3
from hoi_retarget.objects import distance_field as module
from hoi_retarget.objects.distance_field import (
    SHELL_THICKNESS,
    DistanceField,
    Region,
    distance_field,
    field_of,
    surface_samples,
)
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.objects.track import ObjectGeometry
from synthetic import OBJECTS
from synthetic.object_shapes import shape

DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"
FAST = settings(max_examples=6, deadline=None, derandomize=True, database=None)
seeds = st.integers(0, 10_000)
SIZE = np.array([0.2, 0.3, 0.4])


def surface(mesh: trimesh.Trimesh) -> Surface:
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def box_distances(points: np.ndarray, size: np.ndarray = SIZE) -> np.ndarray:
    beyond = np.abs(points) - 0.5 * size
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


@pytest.fixture(scope="module")
def box() -> DistanceField:
    return field_of(surface(trimesh.creation.box(SIZE)))


@pytest.fixture(scope="module")
def ball() -> DistanceField:
    return field_of(surface(trimesh.creation.icosphere(subdivisions=5, radius=0.15)))


@pytest.fixture
def cache(tmp_path, monkeypatch) -> Path:
    """An empty cache folder, and a process that has built nothing yet."""
    monkeypatch.setattr(user_cache, "_folder", lambda: tmp_path / "cache")
    module._cached.cache_clear()
    yield tmp_path / "cache"
    module._cached.cache_clear()


def crate(shift: float = 0.0) -> ObjectGeometry:
    mesh = trimesh.creation.box([0.1, 0.1, 0.1])
    return ObjectGeometry(np.asarray(mesh.vertices) + shift, faces=np.asarray(mesh.faces))


# Distances


def test_a_box_by_its_formula(box):
    rng = np.random.default_rng(1)
    on_surface, _ = surface(trimesh.creation.box(SIZE)).random_points(3000, seed=1)
    points = on_surface + rng.uniform(-2, 2, on_surface.shape) * box.step
    errors = np.abs(box.distances(points) - box_distances(points))
    assert np.quantile(errors, 0.995) <= box.error < box.step
    assert np.median(errors) < 1e-4
    anywhere = rng.uniform(-0.5, 0.5, (3000, 3)) * SIZE
    true = box_distances(anywhere)
    assert (np.abs(box.distances(anywhere) - true) < 2e-3 + 0.2 * np.abs(true)).all()


def test_a_ball_by_its_formula(ball):
    rng = np.random.default_rng(1)
    outwards = rng.normal(size=(3000, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    heights = rng.uniform(-2, 2, 3000) * ball.step
    distances, normals = ball.distances_and_normals(outwards * (0.15 + heights)[:, None])
    assert np.abs(distances - heights).max() <= ball.error + 1e-4  # The ball's own faces are flat.
    assert (np.einsum("ki,ki->k", normals, outwards) > 0.97).all()


@pytest.mark.parametrize("name", OBJECTS)
def test_sides_are_right_two_millimetres_from_the_surface(name):
    exact = Surface(*shape(name).mesh)
    field = field_of(exact)
    points, normals = exact.random_points(3000, seed=2)
    for side in (-2e-3, 2e-3):
        off = points + side * normals
        true = exact.signed_distances(off)
        clear = np.abs(true) > 1.9e-3  # Not beside another face.
        assert (np.sign(field.distances(off[clear])) == np.sign(true[clear])).mean() > 0.999


def test_thin_rods_have_a_surface_and_an_inside():
    """Two rods of 8 mm, which pass between the corners of all cells."""
    rods = [
        trimesh.creation.cylinder(4e-3, segment=[[-0.15, -0.05, z], [0.15, 0.05, 0.1 + z]], sections=16)
        for z in (0.0, 0.05)
    ]
    exact = surface(trimesh.util.concatenate(rods))
    field = field_of(exact)
    assert not field.shell
    points, normals = exact.random_points(4000, seed=3)
    assert (field.distances(points - 2e-3 * normals) < -5e-4).mean() > 0.98
    assert (field.distances(points + 2e-3 * normals) > 1e-3).all()
    near = points + np.random.default_rng(0).uniform(-5e-3, 5e-3, points.shape)
    errors = np.abs(field.distances(near) - exact.signed_distances(near))
    assert np.quantile(errors, 0.95) < 1e-3
    assert field.cells.samples.nbytes < 20e6


@FAST
@given(seed=seeds)
def test_any_solid_anywhere(seed):
    """Boxes of any proportions, turned and moved: solids, and near to their formula."""
    rng = np.random.default_rng(seed)
    size = 10 ** rng.uniform(-2, -0.5, 3)
    mesh = trimesh.creation.box(size)
    turn, shift = se3.exp(rng.normal(size=3)), 10 * rng.normal(size=3)
    field = field_of(Surface(se3.rotate(turn, np.asarray(mesh.vertices)) + shift, np.asarray(mesh.faces)))
    points = rng.uniform(-0.6, 0.6, (500, 3)) * size
    true = box_distances(points, size)
    found = field.distances(se3.rotate(turn, points) + shift)
    assert not field.shell
    assert (np.abs(found - true) < field.step + 0.2 * np.abs(true)).all()


@FAST
@given(seed=seeds, factor=st.floats(0.1, 10.0))
def test_a_scaled_field_scales_all_distances(seed, factor, box):
    points = np.random.default_rng(seed).normal(size=(200, 3))
    grown = box.scaled(factor)
    np.testing.assert_allclose(grown.distances(factor * points), factor * box.distances(points), rtol=1e-4, atol=1e-6)
    assert grown.step == pytest.approx(factor * box.step)
    assert grown.error == pytest.approx(factor * box.error)


@FAST
@given(seed=seeds, reach=st.sampled_from([0.3, 3.0, 300.0]))
def test_far_points_are_never_too_far(seed, reach, box):
    points = reach * np.random.default_rng(seed).normal(size=(500, 3))
    true, found = box_distances(points), box.distances(points)
    out = true > 0.1
    assert np.isfinite(found).all()
    assert (found[out] < 1.01 * true[out]).all()
    assert (found[out] > 0.7 * true[out]).all()


@FAST
@given(seed=seeds)
def test_what_a_point_is_told_does_not_depend_on_its_company(seed, box):
    near, far = np.random.default_rng(seed).uniform(-1, 1, (2, 100, 3))
    points = np.concatenate([0.1 * near, 3.0 * far])
    distances, normals = box.distances_and_normals(points)
    assert (distances < 0).any() and (distances > 1).any()
    alone = [box.distances_and_normals(point[None]) for point in points]
    np.testing.assert_array_equal(distances, np.concatenate([distance for distance, _ in alone]))
    np.testing.assert_array_equal(normals, np.concatenate([normal for _, normal in alone]))


@FAST
@given(seed=seeds, reach=st.sampled_from([0.2, 3.0]))
def test_normals_are_the_derivatives(seed, reach, box):
    rng = np.random.default_rng(seed)
    points, step = reach * rng.uniform(-1, 1, (300, 3)), 1e-5
    distances, normals = box.distances_and_normals(points)
    np.testing.assert_array_equal(distances, box.distances(points))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    slopes = [(box.distances(points + way) - box.distances(points - way)) / (2 * step) for way in step * np.eye(3)]
    lengths = np.linalg.norm(slopes, axis=0)
    known = lengths > 0.5  # Not in the middle between two faces.
    assert known.mean() > 0.8
    # All but those that are between two cells.
    off = np.linalg.norm(np.transpose(slopes)[known] / lengths[known, None] - normals[known], axis=1)
    assert (off < 1e-3).mean() > 0.98


def test_no_points(box):
    assert box.distances(np.zeros((0, 3))).shape == (0,)
    distances, normals = box.distances_and_normals(np.zeros((0, 3)))
    assert distances.shape == (0,)
    assert normals.shape == (0, 3)


def test_many_points_are_the_same_as_few(box):
    points = np.random.default_rng(0).normal(size=(70_000, 3))
    np.testing.assert_array_equal(box.distances(points)[[0, -1]], box.distances(points[[0, -1]]))


def test_small_objects_have_finer_samples_and_large_ones_the_usual_step():
    for size, step in ((1.0, module._MIN_STEP), (0.5, module._MIN_STEP), (0.1, 0.1 / 64), (0.01, 0.01 / 64)):
        assert field_of(surface(trimesh.creation.box([size, 0.5 * size, 0.01]))).step == pytest.approx(step)
    tiny = field_of(surface(trimesh.creation.box([1e-3] * 3)))
    assert tiny.step == pytest.approx(module._MIN_SIZE / 64), "nothing is finer than for this size"


@pytest.mark.parametrize(("bound", "limit"), [("_MAX_SAMPLES", 60_000), ("_MAX_CELLS", 100)])
def test_an_object_that_would_take_too_much_memory_has_coarser_samples(bound, limit, box, monkeypatch):
    monkeypatch.setattr(module, bound, limit)
    coarse = field_of(surface(trimesh.creation.box(SIZE)))
    ratio = np.log(coarse.step / box.step) / np.log(1.25)
    assert ratio == pytest.approx(round(ratio)) and round(ratio) > 0
    of_level = np.bincount(coarse.cells.levels.reshape(-1), minlength=4) * (module.STEPS + 1) ** 3
    assert len(coarse.cells.samples) == of_level.sum()
    assert of_level.max() <= limit if bound == "_MAX_SAMPLES" else coarse.cells.levels.size <= limit


@FAST
@given(seed=seeds)
def test_samples_of_a_surface_are_as_dense_on_every_triangle(seed):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(20, 1, 3)) + rng.uniform(0.05, 1.0, (20, 1, 1)) * rng.normal(size=(20, 3, 3))
    exact, spacing = Surface(corners.reshape(-1, 3), np.arange(60).reshape(-1, 3)), 0.05
    areas = trimesh.triangles.area(corners)
    samples = surface_samples(exact, spacing)
    assert len(samples) == round(areas.sum() / spacing**2)
    assert exact.distances(samples).max() < 1e-9
    ends = np.cumsum(areas) / areas.sum() * len(samples) - 0.5
    for triangle, (first, stop) in enumerate(pairwise(np.ceil([-0.5, *ends]).astype(int))):
        own = Surface(corners[triangle], np.array([[0, 1, 2]]))
        assert own.distances(samples[first:stop]).max(initial=0.0) < 1e-9
    assert len(surface_samples(exact, 100.0)) == 1


@FAST
@given(seed=seeds)
def test_samples_in_a_region_of_a_large_surface_are_as_dense_as_all_of_them(seed):
    """A wall of 8 m would take 14 million."""
    wall = trimesh.creation.box((8.0, 0.2, 8.0))
    surface, spacing = Surface(wall.vertices, wall.faces), 3e-3
    rng = np.random.default_rng(seed)
    region = Region(rng.uniform(-2, 2, (5, 3)) * [1, 0.05, 1], 0.15)
    samples = surface_samples(surface, spacing, region)
    assert len(samples) < 500_000
    assert surface.distances(samples).max() < 1e-9
    places = surface.closest_points(region.centres + rng.uniform(-0.05, 0.05, (5, 3)))
    near = np.linalg.norm(places - region.centres, axis=1) < region.radius
    assert np.linalg.norm(samples[:, None] - places[near], axis=2).min(axis=0).max(initial=0.0) < 2 * spacing
    assert len(surface_samples(surface, spacing, Region(np.full((1, 3), 20.0), 0.1))) == 1


# What has no inside


def sheets() -> dict[str, ObjectGeometry]:
    mesh = trimesh.creation.box(SIZE)
    faces = np.asarray(mesh.faces)
    return {
        "flat points": ObjectGeometry(np.asarray(mesh.vertices) * [1, 1, 0]),
        "straight points": ObjectGeometry(np.linspace(0, 1, 5)[:, None] * SIZE),
        "one point": ObjectGeometry(np.zeros((1, 3))),
        "both sides": ObjectGeometry(mesh.vertices, faces=np.concatenate([faces, faces[:, ::-1]])),
    }


@pytest.mark.parametrize("name", sheets())
def test_a_surface_without_an_inside_is_a_shell(name):
    geometry = sheets()[name]
    field, exact = field_of(surface_of(geometry)), surface_of(geometry)
    assert field.shell
    points = exact.vertices[0] + np.random.default_rng(0).uniform(-0.02, 0.02, (2000, 3))
    true = exact.distances(points) - SHELL_THICKNESS
    assert (np.abs(field.distances(points) - true) < field.step + 0.3 * np.abs(true)).all()


def test_faces_turned_at_random_are_a_shell():
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    faces = np.asarray(mesh.faces).copy()
    turned = np.random.default_rng(0).random(len(faces)) < 0.5
    faces[turned] = faces[turned, ::-1]
    assert field_of(Surface(np.asarray(mesh.vertices), faces)).shell


def test_points_without_triangles_have_the_field_of_their_hull():
    points = np.asarray(trimesh.creation.box(SIZE).vertices)
    inside = np.random.default_rng(0).uniform(-0.5, 0.5, (100, 3)) * SIZE
    field = field_of(surface_of(ObjectGeometry(np.concatenate([points, 0.9 * inside]))))
    assert not field.shell
    assert (field.distances(0.9 * inside) < 0).all()


# Kept between runs


def test_a_cached_field_is_the_same_to_the_bit(cache):
    built = distance_field(crate())
    assert distance_field(crate()) is built
    (file,) = cache.iterdir()
    module._cached.cache_clear()
    before = file.read_bytes()
    read = distance_field(crate())
    assert read is not built
    assert file.read_bytes() == before
    for name in ("origin", "levels", "samples"):
        np.testing.assert_array_equal(getattr(read.cells, name), getattr(built.cells, name))
    assert (read.cells.edge, read.shell, read.error) == (built.cells.edge, built.shell, built.error)
    assert read.cells.samples.dtype == built.cells.samples.dtype


def test_another_mesh_is_another_file(cache):
    assert distance_field(crate(0.1)) is not distance_field(crate())
    assert len(list(cache.iterdir())) == 2


@pytest.mark.parametrize(
    "damage",
    [
        lambda b: b"",
        lambda b: b[: len(b) // 2],
        lambda b: b"PK" + b[::-1],
        lambda b: b[:-900] + bytes([b[-900] ^ 1]) + b[-899:],
    ],
)
def test_a_damaged_file_is_built_anew(cache, damage):
    built = distance_field(crate())
    (file,) = cache.iterdir()
    good = file.read_bytes()
    file.write_bytes(damage(good))
    module._cached.cache_clear()
    np.testing.assert_array_equal(distance_field(crate()).cells.samples, built.cells.samples)
    assert file.read_bytes() == good


def test_fields_are_built_in_memory_where_nothing_can_be_cached(tmp_path, monkeypatch):
    (tmp_path / "a file").write_text("")
    monkeypatch.setattr(user_cache, "_folder", lambda: tmp_path / "a file" / "cache")
    module._cached.cache_clear()
    assert distance_field(crate()).distances(np.zeros((1, 3)))[0] == pytest.approx(-0.05, abs=1e-3)
    module._cached.cache_clear()


def test_the_cache_forgets_what_was_not_used_for_longest(cache, monkeypatch):
    monkeypatch.setattr(user_cache, "_MAX_BYTES", 2500)
    for number in range(4):
        user_cache.write_cached(f"file {number}", bytes(1000))
    assert user_cache.read_cached("file 3") == bytes(1000)
    assert len(list(cache.iterdir())) == 2


# Real objects


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tripod", "clothesstand", "largebox", "trashcan", "woodchair", "plasticbox"])
def test_real_objects(name):
    path = DATA / "objects" / name / f"{name}.obj"
    if not path.exists():
        pytest.skip(f"{path} is not here")
    exact = surface_of(ObjectGeometry(np.zeros((1, 3)), mesh_path=path))
    field = field_of(exact)
    assert field.shell == (name == "plasticbox")
    assert field.cells.samples.nbytes < 20e6
    points, _ = exact.random_points(10_000, seed=5)
    points = points + np.random.default_rng(3).uniform(-0.01, 0.01, points.shape)
    true = exact.distances(points) - SHELL_THICKNESS if field.shell else exact.signed_distances(points)
    errors = np.abs(field.distances(points) - true)
    assert np.quantile(errors, 0.95) < 0.7e-3
    assert np.quantile(errors, 0.99) < 1.3e-3
    clear = np.abs(true) > 1e-3
    assert ((field.distances(points) < 0) == (true < 0))[clear].mean() > 0.999
