"""Object geometry: meshes, hulls, surface points, and everything that is none."""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.errors import GeometryError
from hoi_retarget.readers import object_files as objects
from hoi_retarget.readers.object_files import extreme_points, first_mesh, known_objects, load_geometry
from intermimic_writer import write_box
from outcomes import both_outcomes

SHARED = Path(__file__).resolve().parents[1].parent / "shared" / "data"
NEEDS_SHARED = pytest.mark.skipif(not SHARED.is_dir(), reason=f"no real meshes at {SHARED}")
CUBE = 0.2 * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T


def write(folder: Path, name: str, file: str, content: bytes) -> Path:
    (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / name / file).write_bytes(content)
    return folder / name / file


def refused(folder: Path, name: str, *words: str) -> None:
    with pytest.raises(GeometryError) as caught:
        load_geometry(folder, name)
    for word in (str(folder), *words):
        assert word in str(caught.value), str(caught.value)


def support(points: np.ndarray, seed: int = 0) -> np.ndarray:
    """Return how far points reach in many directions."""
    return (points @ np.random.default_rng(seed).normal(size=(3, 100))).max(axis=0)


# What is read


def test_a_mesh_is_reduced_to_its_extreme_points(tmp_path):
    inner = "".join(f"v {x:.3f} 0 0\n" for x in np.linspace(-0.1, 0.1, 50))
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in CUBE)
    path = write(tmp_path, "box", "box.obj", f"# cube\n{inner}vn 0 0 1\n{corners}f 1 2 3\n".encode())
    geometry = load_geometry(tmp_path, "box")
    assert geometry.mesh_path == path
    assert len(geometry.points) == 8
    assert np.allclose(support(geometry.points), support(CUBE))


@pytest.mark.parametrize(
    "line", ["v {} {} {}", "v  {}\t{} {} ", "v {} {} {} 1.0", "v {} {} {} 0.5 0.5 0.5", "v\t{} {} {}", "v {} {} {}\r"]
)
def test_the_ways_to_write_a_vertex(tmp_path, line):
    text = "\n".join(line.format(*corner) for corner in CUBE) + "\nvt 0 0\nf 1/1/1 2/1/1 3/1/1"
    write(tmp_path, "box", "box.obj", text.encode())
    assert np.allclose(support(load_geometry(tmp_path, "box").points), support(CUBE))


def test_vertices_between_other_lines(tmp_path):
    text = "\n".join(f"v {x} {y} {z}\nvn 0 0 1\nvt 0 1" for x, y, z in CUBE) + "\nf 1 2 3\nusemtl v 9 9 9\n"
    write(tmp_path, "box", "box.obj", text.encode())
    assert np.allclose(support(load_geometry(tmp_path, "box").points), support(CUBE))


def test_a_mesh_goes_before_a_hull_before_points(tmp_path):
    (tmp_path / "box").mkdir()
    np.save(tmp_path / "box" / "sample_points.npy", 0.5 * CUBE.astype(np.float32))
    geometry = load_geometry(tmp_path, "box")
    assert geometry.mesh_path is None
    assert np.abs(geometry.points).max() == pytest.approx(0.1)
    write_box(tmp_path / "other", "box", 0.15)
    hull = (tmp_path / "other" / "box" / "box.obj").read_bytes()
    write(tmp_path, "box", "box_hull.obj", hull)
    geometry = load_geometry(tmp_path, "box")
    assert geometry.mesh_path == tmp_path / "box" / "box_hull.obj"
    assert np.abs(geometry.points).max() == pytest.approx(0.15)
    write_box(tmp_path, "box", 0.2)
    assert np.abs(load_geometry(tmp_path, "box").points).max() == pytest.approx(0.2)


@pytest.mark.parametrize("place", ["box/box{}", "box{}"])
@pytest.mark.parametrize("suffix", [".stl", ".ply", ".glb", ".off", ".obj"])
def test_meshes_of_any_kind_are_read_in_their_folder_and_beside_it(place, suffix, tmp_path):
    path = tmp_path / place.format(suffix)
    path.parent.mkdir(exist_ok=True)
    trimesh.creation.box((0.2, 0.4, 0.6)).export(path)
    geometry = load_geometry(tmp_path, "box")
    assert geometry.has_surface
    np.testing.assert_allclose(np.ptp(geometry.points, axis=0), (0.2, 0.4, 0.6))
    assert known_objects(tmp_path) == ("box",)


def test_meshes_of_other_names_in_the_folder_are_parts(tmp_path):
    (tmp_path / "box").mkdir()
    for index, height in enumerate((0.0, 1.0)):
        trimesh.creation.box((0.2, 0.2, 0.2)).apply_translation((0, 0, height)).export(tmp_path / f"box/p{index}.obj")
    geometry = load_geometry(tmp_path, "box")
    np.testing.assert_allclose(np.ptp(geometry.points, axis=0), (0.2, 0.2, 1.2))
    assert geometry.faces is not None and len(geometry.faces) == 24


def test_what_is_there_instead_is_named(tmp_path):
    (tmp_path / "box" / "meshes").mkdir(parents=True)
    (tmp_path / "box" / "meshes" / "box.usda").write_text("#usda")
    with pytest.raises(GeometryError, match=r"expected box/box\.obj \(\.stl, .*It holds box/meshes/box\.usda"):
        load_geometry(tmp_path, "box")


def test_a_file_is_read_once_until_it_changes(tmp_path):
    write_box(tmp_path, "box", 0.2)
    first = load_geometry(tmp_path, "box")
    assert load_geometry(tmp_path, "box") is first
    write_box(tmp_path, "box", 0.3)
    os.utime(tmp_path / "box" / "box.obj", ns=(1, 1))
    assert np.abs(load_geometry(tmp_path, "box").points).max() == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("shape", "count"),
    [
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 0]], 4),  # flat
        ([[0, 0, 0], [1, 1, 1], [2, 2, 2], [0.5, 0.5, 0.5]], 2),  # straight
        ([[1, 2, 3], [1, 2, 3], [1, 2, 3], [1, 2, 3], [1, 2, 3]], 1),  # a point
        ([[1, 2, 3]], 1),
        ([[1, 2, 3], [4, 5, 6]], 2),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], 3),
    ],
)
def test_flat_straight_and_single_shapes(shape, count):
    points = np.array(shape, dtype=float)
    extreme = extreme_points(points)
    assert len(extreme) == count
    assert np.allclose(support(extreme), support(points))


@settings(derandomize=True, deadline=None, max_examples=80, database=None)
@given(st.integers(0, 10_000), st.integers(1, 40), st.sampled_from([0, 1, 2, 3]), st.sampled_from([1e-4, 1.0, 30.0]))
def test_extreme_points_reach_as_far_in_every_direction(seed, count, rank, size):
    rng = np.random.default_rng(seed)
    points = size * rng.normal(size=(count, rank)) @ rng.normal(size=(rank, 3)) + rng.normal(size=3)
    extreme = extreme_points(points)
    assert {tuple(point) for point in extreme} <= {tuple(point) for point in points}
    assert np.allclose(support(extreme, seed), support(points, seed), atol=1e-9 * size + 1e-12)


# What is refused


def test_an_unknown_object_lists_those_that_exist(tmp_path):
    for name in ("largebox", "smallbox", "tripod"):
        write_box(tmp_path, name)
    (tmp_path / "empty").mkdir()
    assert known_objects(tmp_path) == ("largebox", "smallbox", "tripod")
    refused(tmp_path, "largebx", "no object 'largebx'", "Did you mean 'largebox'?", "largebox, smallbox, tripod")
    refused(tmp_path, "zzz", "Objects there: largebox")
    refused(tmp_path, "empty", "no geometry", "empty/empty.obj", "empty/empty_hull.obj", "empty/sample_points.npy")


def test_folders_that_are_none(tmp_path):
    refused(tmp_path / "absent", "box", "no such folder", "box/box.obj")
    (tmp_path / "file").write_text("")
    refused(tmp_path / "file", "box", "no such folder")
    (tmp_path / "nothing").mkdir()
    refused(tmp_path / "nothing", "box", "There are no objects in it")
    write_box(tmp_path / "inner", "stool")
    refused(tmp_path, "stool", f"Try --objects {tmp_path / 'inner'}")


@pytest.mark.parametrize("name", ["../box", "..", ".", "", "a/b", "a\\b", "/etc/passwd", "a\0b"])
def test_names_never_leave_the_folder(tmp_path, name):
    write_box(tmp_path, "box")
    (tmp_path / "objects").mkdir()
    refused(tmp_path / "objects", name, "plain folder name")


def test_names_too_long_for_a_file_system(tmp_path):
    refused(tmp_path, "a" * 5000)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no vertices"),
        (b"f 1 2 3\n", "no vertices"),
        (b"\0" * 100, "no vertices"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces"),
        (b"v 0 0\nf 1 1 1\n", "expected `v x y z`"),
        (b"v 0 0 0\nv 1 1\nf 1 1 1\n", "expected `v x y z`"),
        (b"v 0 0 0 0 0\nv 1 1 1\nf 1 1 1\n", "expected `v x y z`"),
        (b"v \nf 1 1 1\n", "expected `v x y z`"),
        (b"v a b c\nf 1 1 1\n", "not three numbers"),
        (b"v 0 0 \xff\nf 1 1 1\n", "not three numbers"),
        (b"v 0 0 nan\nv 1 1 1\nf 1 1 1\n", "1 of its points are not finite"),
        (b"v 0 0 inf\nf 1 1 1\n", "not finite"),
        (b"v 0 0 1e400\nf 1 1 1\n", "not finite"),
        (b"v 0 0 1500\nv 1 1 1\nf 1 1 1\n", "expected metres"),
        (b"v 0 0 0\nv 1 1 1\nf 1 2 3\n", "names vertex 3; they are counted from 1 to 2"),
        (b"v 0 0 0\nv 1 1 1\nf 1/1/1 2/9/9 12/1/1\n", "names vertex 12"),
        (b"v 0 0 0\nv 1 1 1\nf 0 1 2\n", "names vertex 0"),
        (b"v 0 0 0\nv 1 1 1\nf 1 2 -3\n", "names vertex 3"),
        (b"v 0 0 0\nv 1 1 1\nf 1 2 99999999999999999999999\n", "names vertex 1"),
    ],
)
def test_meshes_that_are_none(tmp_path, content, words):
    path = write(tmp_path, "box", "box.obj", content)
    refused(tmp_path, "box", str(path), words)


def test_corners_of_faces_are_read_in_all_ways_of_writing_them(tmp_path):
    corners = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    ways = (b"f 1 2 3", b"f 1/7 2/8 4/9\r", b"f -1 -2 -4", b"f\t1//99 3//99 4//99 2", b"f 1 2 3 # 9")
    for number, faces in enumerate(ways):
        write(tmp_path, f"box{number}", f"box{number}.obj", corners + faces + b"\n")
        load_geometry(tmp_path, f"box{number}")


@pytest.mark.parametrize(
    "value",
    [
        np.zeros((0, 3)),
        np.zeros((5, 2)),
        np.zeros(3),
        np.zeros((2, 3, 3)),
        np.array([["a", "b", "c"]]),
        np.zeros((2, 3), dtype=complex),
        np.full((4, 3), np.nan),
        np.array([[1, 2, 3], [None, 1, 2]], dtype=object),
    ],
)
def test_arrays_that_are_no_points(tmp_path, value):
    (tmp_path / "box").mkdir()
    np.save(tmp_path / "box" / "sample_points.npy", value)
    refused(tmp_path, "box", "sample_points.npy")


def test_mutated_points_are_read_or_refused(tmp_path):
    (tmp_path / "box").mkdir()
    path = tmp_path / "box" / "sample_points.npy"
    np.save(path, CUBE)
    whole = path.read_bytes()

    @settings(derandomize=True, deadline=None, max_examples=120, database=None)
    @given(st.data())
    def check(data):
        content = bytearray(whole)
        for _ in range(data.draw(st.integers(1, 4))):
            position = data.draw(st.integers(0, 140))
            width = data.draw(st.integers(0, 3))
            junk = data.draw(st.binary(max_size=3) | st.sampled_from([b"999", b"(", b"L,"]))
            content[position : position + width] = junk
        # All of it in half of the examples: no part of the file is a file.
        length = data.draw(st.just(len(content)) | st.integers(0, len(content)))
        path.write_bytes(bytes(content[:length]))
        objects._load.cache_clear()
        attempt(load_geometry, tmp_path, "box")

    with both_outcomes(GeometryError, str(path)) as attempt:
        check()


def test_any_mesh_text_is_read_or_refused(tmp_path):
    words = ["v ", "v 1 2 3\n", "f ", "1 ", "-2.5 ", "3e9 ", "nan ", "\n", "\r", "#", "x", "\0"]

    @settings(derandomize=True, deadline=None, max_examples=200, database=None)
    @given(st.lists(st.sampled_from(words), max_size=40))
    def check(drawn):
        write(tmp_path, "box", "box.obj", "".join(drawn).encode())
        objects._load.cache_clear()
        attempt(load_geometry, tmp_path, "box")

    with both_outcomes(GeometryError, str(tmp_path / "box" / "box.obj")) as attempt:
        check()


# Real meshes


@NEEDS_SHARED
@pytest.mark.parametrize("name", known_objects(SHARED / "objects") if SHARED.is_dir() else [])
def test_a_real_mesh_agrees_with_trimesh(name):
    geometry = load_geometry(SHARED / "objects", name)
    mesh = trimesh.load_mesh(geometry.mesh_path, process=False)
    assert np.allclose(support(geometry.points), support(np.asarray(mesh.vertices)), atol=1e-9)
    samples = np.load(SHARED / "objects" / name / "sample_points.npy")
    assert (support(geometry.points) > support(samples.astype(float)) - 0.002).all()


def test_nothing_is_opened_but_the_mesh(tmp_path, monkeypatch):
    """Not the materials and pictures that it names, wherever they are."""
    opened = []
    monkeypatch.setattr(trimesh.resolvers.FilePathResolver, "get", lambda _, name: opened.append(name) or b"")
    mesh = tmp_path / "mesh.obj"
    mesh.write_text("mtllib ../materials.mtl\nusemtl wood\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    trimesh.load_mesh(mesh)
    assert opened == ["../materials.mtl"]
    assert first_mesh("mesh", [mesh], centred=False).points.shape == (3, 3)
    assert opened == ["../materials.mtl"]
