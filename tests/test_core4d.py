"""CORE4D: two people and an object, written as the makers store them and read back, with and without a body model."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core4d_writer import load_person, save_person, write_world
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ClipError, GeometryError, HoiRetargetError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.numerics import se3
from hoi_retarget.readers import can_be_clip, clips_in, core4d, read_clip, reader_of
from source_people import assert_same_objects, assert_same_people, write_models
from synthetic import make


def turning(clip: Clip) -> Clip:
    """The clip with an object that turns and has no symmetry."""
    suitcase = make("drag_suitcase", fps=15.0).objects[0]
    turns = se3.exp(np.linspace([0.0, 0.2, 0.3], [1.0, -0.7, 2.0], clip.frames))
    positions = clip.objects[0].positions
    return replace(
        clip, objects=(replace(clip.objects[0], geometry=suitcase.geometry, positions=positions, quats=turns),)
    )


CARRIED = turning(make("carry_table", fps=15.0))


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> tuple[Path, Path, Clip]:
    return write_world(tmp_path_factory.mktemp("world"), CARRIED)


@pytest.fixture
def copy(world, tmp_path) -> tuple[Path, Path, Clip]:
    sequence, models, written = world
    shutil.copytree(models.parent, tmp_path, dirs_exist_ok=True)
    return tmp_path / sequence.relative_to(models.parent), tmp_path / models.name, written


def test_with_a_body_model_everything_comes_back(world):
    sequence, models, written = world
    clip = read_clip(sequence, ReadOptions(body_models=models))
    assert_same_people(clip, written)
    assert_same_objects(clip, written)
    assert (clip.fps, clip.frames, clip.contacts, clip.name) == (15.0, CARRIED.frames, (), "20231002_004")
    assert [person.name for person in clip.people] == ["person1", "person2"]
    assert clip.source.format == "core4d"
    assert "CC BY 4.0" in clip.source.licence
    assert any("15 frames a second" in note for note in clip.source.notes)


def test_without_a_body_model_joints_are_those_stored(world):
    sequence, _, written = world
    clip = read_clip(sequence)
    assert_same_objects(clip, written)
    for read, person in zip(clip.people, written.people, strict=True):
        np.testing.assert_allclose(read.joint_positions, person.joint_positions, atol=1e-9)
        turns = se3.angle_between(read.joint_quats, person.joint_quats)
        assert turns[:, :22].max() < 1e-6
        for side in ("left", "right"):
            wrist = read.quat(f"{side}_wrist")
            assert se3.angle_between(read.quat(f"{side}_middle3"), wrist).max() < 1e-9
    assert any("turned as the wrist" in note for note in clip.source.notes)


def test_the_recording_is_told_by_its_folder(world, tmp_path):
    sequence, _, _ = world
    assert reader_of(SourceFile(sequence)) is core4d.READER
    assert can_be_clip(sequence)
    assert clips_in(sequence) == (sequence,)
    assert not can_be_clip(sequence.parent)
    outline = core4d.READER.outline(SourceFile(sequence))
    assert (outline.frames, outline.people, outline.objects) == (CARRIED.frames, 2, ("table021",))
    assert read_clip(sequence).source.sha256 == read_clip(sequence).source.sha256


def test_meshes_are_found_in_the_tree_or_in_the_folder_given(copy, tmp_path):
    sequence, _, written = copy
    moved = tmp_path / "elsewhere"
    (tmp_path / "CORE4D_Real" / "object_models").rename(moved)
    with pytest.raises(GeometryError, match="pass --objects DIR"):
        read_clip(sequence)
    assert_same_objects(read_clip(sequence, ReadOptions(objects=moved)), written)
    assert_same_objects(read_clip(sequence, ReadOptions(objects=moved / "table")), written)


def changed(file: str, change: Callable[[dict], object]) -> Callable[[Path], None]:
    def apply(sequence: Path) -> None:
        values = load_person(sequence / file)
        change(values)
        save_person(sequence / file, values)

    return apply


def poses_changed(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    def apply(sequence: Path) -> None:
        path = sequence / "smooth_objposes.npy"
        np.save(path, change(np.load(path)))

    return apply


def named(name: object) -> Callable[[Path], object]:
    return lambda sequence: (sequence / "object_metadata.json").write_text(json.dumps({"obj_name": name}))


def with_nan(values: dict) -> None:
    values["joints"] = values["joints"].copy()
    values["joints"][7, 3] = np.nan


def shifted(values: dict) -> None:
    values["body_pose"] = np.roll(values["body_pose"], 30, axis=0)


def cut(values: dict) -> None:
    for name, array in values.items():
        values[name] = array[:-1]


def z_up(sequence: Path) -> None:
    """Turn all of a recording: what is up is the second axis no more."""
    turn = se3.exp(np.array([np.pi / 2, 0.0, 0.0]))
    for file in ("person1_poses.npz", "person2_poses.npz"):
        values = load_person(sequence / file)
        values["global_orient"] = se3.log(se3.quat_multiply(turn, se3.exp(values["global_orient"])))
        values["joints"] = se3.rotate(turn, values["joints"])
        save_person(sequence / file, values)


MISTAKES: dict[str, tuple[Callable[[Path], object], type[HoiRetargetError], str]] = {
    "a person is missing": (
        lambda it: (it / "person2_poses.npz").unlink(),
        ReadError,
        "person2_poses.npz: there is no",
    ),
    "no poses": (lambda it: (it / "smooth_objposes.npy").unlink(), ReadError, "smooth_objposes.npy: there is no such"),
    "no name": (lambda it: (it / "object_metadata.json").unlink(), ReadError, "object_metadata.json: there is no such"),
    "no JSON": (lambda it: (it / "object_metadata.json").write_text("{"), ReadError, "not readable as JSON"),
    "a list": (lambda it: (it / "object_metadata.json").write_text("[]"), ReadError, "expected an object"),
    "the key": (lambda it: (it / "object_metadata.json").write_text("{}"), ClipError, "obj_name, the object's name,"),
    "a name that leads away": (named("../../secret001"), ReadError, "no plain name"),
    "a name without digits": (named("table"), ClipError, "a category and three digits"),
    "a name that is none": (named(21), ClipError, "expected a text"),
    "no mesh": (named("chair001"), GeometryError, "chair001_m.obj"),
    "a key is missing": (
        changed("person1_poses.npz", lambda it: it.pop("body_pose")),
        ClipError,
        "body_pose, the body's",
    ),
    "a shape": (
        changed("person1_poses.npz", lambda it: it.update(body_pose=it["body_pose"].reshape(-1, 63))),
        ClipError,
        "expected (113, 21, 3)",
    ),
    "no numbers": (changed("person2_poses.npz", with_nan), ClipError, "not finite or above 10000 in 1 frame (7)"),
    "a person is shorter": (changed("person2_poses.npz", cut), ClipError, "person2: 112"),
    "the object is shorter": (poses_changed(lambda it: it[:-1]), ClipError, "smooth_objposes.npy: 112"),
    "poses of another shape": (poses_changed(lambda it: it[:, :3]), ClipError, "expected (T, 4, 4)"),
    "poses are whole numbers": (poses_changed(lambda it: it.astype(int)), ReadError, "expected numpy kind 'f'"),
    "transposed poses": (poses_changed(lambda it: np.swapaxes(it, 1, 2)), ClipError, "last row is not 0, 0, 0, 1"),
    "scaled poses": (poses_changed(lambda it: it * [[[1.1], [1.1], [1.1], [1]]]), ClipError, "no rotation in 113"),
    "mirrored poses": (poses_changed(lambda it: it * [[[1], [1], [-1], [1]]]), ClipError, "mirrors in 113"),
    "poses of other frames": (changed("person1_poses.npz", shifted), ClipError, "stored joints are up to"),
    "the order of the pose": (
        changed("person1_poses.npz", lambda it: it.update(body_pose=-it["body_pose"])),
        ClipError,
        "from where rigid bones turned by its pose have them",
    ),
    "z is up": (z_up, ClipError, "stands along"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_every_mistake_has_one_error(copy, mistake):
    sequence, _, _ = copy
    apply, error, words = MISTAKES[mistake]
    apply(sequence)
    with pytest.raises(error) as caught:
        read_clip(sequence)
    assert words in str(caught.value), str(caught.value)


BODY_MISTAKES: dict[str, tuple[Callable[[dict], object], str]] = {
    "betas change": (lambda it: it.update(betas=it["betas"] + np.linspace(0, 1, 113)[:, None]), "the betas change"),
    "other betas": (lambda it: it.update(betas=it["betas"][::-1] + 1.0), "from where the body model puts them"),
    "more betas": (lambda it: it.update(betas=np.zeros((113, 16))), "expected (113, 10)"),
    "axis-angle hands": (lambda it: it.update(left_hand_pose=np.zeros((113, 45))), "expected (113, 12)"),
    "no position": (lambda it: it.pop("transl"), "transl, the body's position,"),
    "another position": (lambda it: it.update(transl=it["transl"] + 0.02), "stored joints are up to"),
}


@pytest.mark.parametrize("mistake", BODY_MISTAKES)
def test_mistakes_that_a_body_model_shows(copy, mistake):
    sequence, models, _ = copy
    apply, words = BODY_MISTAKES[mistake]
    changed("person1_poses.npz", apply)(sequence)
    with pytest.raises(ClipError) as caught:
        read_clip(sequence, ReadOptions(body_models=models))
    assert words in str(caught.value), str(caught.value)


def test_models_that_do_not_fit(world, tmp_path):
    sequence, _, _ = world
    with pytest.raises(ReadError, match="no neutral smplx model"):
        read_clip(sequence, ReadOptions(body_models=write_models(tmp_path / "men", CARRIED.people, "smplx", ["male"])))
    few = write_models(tmp_path / "few", CARRIED.people, "smplx", ["neutral"], components=6)
    with pytest.raises(ClipError, match="45 rotation components, or at most 6"):
        read_clip(sequence, ReadOptions(body_models=few))


def test_what_is_not_read_is_named(copy, tmp_path):
    sequence, _, _ = copy
    with pytest.raises(ArgumentError, match=r"names table021\. Leave the option out"):
        read_clip(sequence, ReadOptions(object_name="table"))
    second = tmp_path / "second" / "004"
    (second / "person_1").mkdir(parents=True)
    (second / "person_1" / "result.npz").write_bytes(b"")
    with pytest.raises(ReadError, match=r"CORE4D's second version, person_1/result\.npz"):
        read_clip(second)
    synthetic = tmp_path / "synthetic"
    synthetic.mkdir()
    for name in ("human_poses.npy", "object_poses.npy", "object_mesh.obj"):
        (synthetic / name).write_bytes(b"")
    with pytest.raises(ReadError, match="synthetic part"):
        read_clip(synthetic)
    np.savez(sequence / "person1_poses.npz", joints=np.zeros(3))
    with pytest.raises(ClipError, match=r"arr_0.*is missing\. It has joints"):
        read_clip(sequence)
    np.savez(sequence / "person1_poses.npz", np.zeros(3))
    with pytest.raises(ClipError, match="expected a dictionary"):
        read_clip(sequence)


def test_nothing_pickled_is_executed(copy):
    sequence, _, _ = copy
    values = load_person(sequence / "person1_poses.npz")
    save_person(sequence / "person1_poses.npz", values | {"expression": print})
    with pytest.raises(ReadError, match="refused"):
        read_clip(sequence)


def test_joints_are_in_the_order_of_smplx():
    # Jaw and eyes stand between wrists and fingers.
    assert core4d._SKELETON_JOINTS[JOINTS.index("right_wrist")] == 21
    assert core4d._SKELETON_JOINTS[JOINTS.index("left_index1")] == 25
    assert core4d._SKELETON_JOINTS[-1] == 54
