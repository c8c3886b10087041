"""Clips of our own beside their meshes: a folder is a clip, where it holds one and no other recording."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.batch.jobs import JobDigests, jobs_of
from hoi_retarget.batch.specification import Specification, of_folder
from hoi_retarget.cli import main
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.motion.result_file import load
from hoi_retarget.readers import can_be_clip, has_companions, own_layout, read_clip, reader_of
from hoi_retarget.readers.describe import inspect
from hoi_retarget.readers.open import open_clip, result_stem
from intermimic_writer import write_box
from mesh_writer import write_mesh
from npz_changes import changed
from own_layout_writer import joint_arrays, parameter_arrays
from source_people import assert_same_objects, assert_same_people
from synthetic import make

BOX = make("carry_box", seconds=0.5)


@pytest.fixture
def folder(tmp_path):
    """A folder with a clip that does not hold the shape of its object, and the mesh."""
    place = tmp_path / "lifting"
    write_mesh(place / "box.obj", BOX.objects[0].geometry)
    np.savez(place / "clip.npz", **{name: values for name, values in joint_arrays(BOX).items() if "_0_" not in name})
    return place


def test_a_folder_is_its_clip(folder):
    assert can_be_clip(folder)
    assert reader_of(SourceFile(folder)) is own_layout.READER
    for path in (folder, folder / "clip.npz"):
        clip = read_clip(path)
        assert_same_people(clip, BOX)
        assert_same_objects(clip, BOX)
        assert clip.objects[0].geometry.mesh_path == folder / "box.obj"
    assert clip.source.sha256 == read_clip(folder).source.sha256
    assert str(folder / "box.obj") in read_clip(folder).source.files


def test_a_folder_of_parameters(tmp_path, folder):
    arrays = parameter_arrays(BOX, "smplx", tmp_path / "models")
    np.savez(folder / "clip.npz", **{name: values for name, values in arrays.items() if "_0_" not in name})
    clip = read_clip(folder, ReadOptions(body_models=tmp_path / "models"))
    assert_same_people(clip, BOX)
    assert_same_objects(clip, BOX)
    assert has_companions(folder), "body models may come later"


def test_the_mesh_beside_the_clip_comes_first(tmp_path, folder):
    write_box(tmp_path / "objects", "box", half_size=0.5)
    assert_same_objects(read_clip(folder, ReadOptions(objects=tmp_path / "objects")), BOX)
    (folder / "box.obj").unlink()
    assert np.ptp(read_clip(folder, ReadOptions(objects=tmp_path / "objects")).objects[0].geometry.points) == 1.0
    with pytest.raises(GeometryError, match=r"no box\.obj is beside it\. Put one there, or pass --objects DIR"):
        read_clip(folder)
    facts = inspect(folder)
    assert "box.obj" in facts.missing[0]
    assert facts.command == f"hoi-retarget run {folder} --objects DIR --out out"


def test_what_the_clip_holds_comes_before_the_mesh_beside_it(folder):
    changed(folder / "clip.npz", object_0_points=3 * np.eye(3))
    assert np.array_equal(read_clip(folder).objects[0].geometry.points, 3 * np.eye(3))


@pytest.mark.parametrize("name", ["../box", "a/box", "", ".", "..", "\0", "c:box", 300 * "x"])
def test_names_of_objects_lead_nowhere_else(folder, name):
    shutil.copyfile(folder / "box.obj", folder.parent / "box.obj")
    changed(folder / "clip.npz", object_names=np.array([name]))
    with pytest.raises((GeometryError, ClipError)):
        read_clip(folder)


def test_links_lead_nowhere_else(folder):
    shutil.move(folder / "box.obj", folder.parent / "box.obj")
    (folder / "box.obj").symlink_to(folder.parent / "box.obj")
    with pytest.raises(ClipError, match=r"the mesh of 'box' is 'box\.obj', expected a file in the clip's folder"):
        read_clip(folder)


def test_a_broken_mesh_is_told(folder):
    (folder / "box.obj").write_text("v 1 2\n")
    with pytest.raises(GeometryError, match=r"box\.obj"):
        read_clip(folder)
    assert "box.obj" in inspect(folder).problems[0]


@pytest.mark.parametrize("other", ["another.npz", "more/another.npz", "another.pt", "more/clip.npz"])
def test_a_folder_of_several_recordings_is_no_clip(folder, other):
    path = folder / other
    path.parent.mkdir(exist_ok=True)
    shutil.copyfile(folder / "clip.npz", path)
    assert not can_be_clip(folder)
    with pytest.raises(ReadError, match="not the recording of one clip"):
        read_clip(folder)
    assert len(jobs_of(of_folder(folder))) == 2


def test_results_beside_the_clip_are_no_recordings(folder):
    np.savez(folder / "lifting.npz", schema=1)
    assert can_be_clip(folder)
    (folder / "clip.npz").rename(folder / "other.npz")
    assert not can_be_clip(folder)
    shutil.copyfile(folder / "lifting.npz", folder / "clip.npz")
    (folder / "other.npz").unlink()
    assert not can_be_clip(folder)
    (folder / "clip.npz").write_bytes(b"no archive")
    assert not can_be_clip(folder)


def test_a_damaged_clip_is_told(folder):
    content = bytearray((folder / "clip.npz").read_bytes())
    content[len(content) // 2] ^= 255
    (folder / "clip.npz").write_bytes(bytes(content))
    with pytest.raises(ReadError, match=r"clip\.npz: not a readable \.npz"):
        read_clip(folder)
    assert "clip.npz" in inspect(folder).problems[0]


def test_batches_take_folders_and_see_what_changes_in_them(folder):
    shutil.copytree(folder, folder.parent / "putting")
    first, second = jobs_of(of_folder(folder.parent))
    assert (first.name, second.name) == ("unitree_g1/lifting", "unitree_g1/putting")
    assert jobs_of(Specification(clips=(str(folder),)))[0].clip == str(folder)
    keys = [JobDigests().key(first, ["box"], ())]
    changed(folder / "clip.npz", fps=20.0)
    keys.append(JobDigests().key(first, ["box"], ()))
    write_box(folder.parent, "lifting")
    (folder / "lifting.obj").rename(folder / "box.obj")
    keys.append(JobDigests().key(first, ["box"], ()))
    (folder / "box.obj").unlink()
    keys.append(JobDigests().key(first, ["box"], ()))
    assert len(set(keys)) == 4
    assert not has_companions(folder)


def test_the_current_folder_is_a_clip_with_a_name(folder, monkeypatch):
    monkeypatch.chdir(folder)
    (folder / "sub").mkdir()
    assert read_clip(Path()).frames == BOX.frames
    assert [result_stem(name) for name in (".", "sub/..", "../lifting")] == ["lifting"] * 3
    assert [job.name for job in jobs_of(of_folder(Path()))] == ["unitree_g1/lifting"]


def test_a_folder_is_inspected_and_run(folder, capsys):
    assert "box.obj" in inspect(folder).objects[0].geometry
    assert main(["inspect", str(folder)]) == 0
    assert main(["run", str(folder), "--out", str(folder)]) == 0
    out = capsys.readouterr().out
    assert f" run {folder} --out out" in out
    result = load(folder / "lifting.npz")
    assert open_clip(result.report.source.path).source.sha256 == result.report.source.sha256
    folder.rename(folder.parent / "clip")
    before = (folder.parent / "clip" / "clip.npz").read_bytes()
    assert main(["run", str(folder.parent / "clip"), "--out", str(folder.parent / "clip")]) == 2
    assert "over the clip" in capsys.readouterr().err
    assert (folder.parent / "clip" / "clip.npz").read_bytes() == before
