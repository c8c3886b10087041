"""OMOMO's own release: one file with many clips, read with and without a body model."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.numerics import se3
from hoi_retarget.readers import can_be_clip, clips_in, omomo, read_clip, reader_of
from hoi_retarget.readers.body_parameters import load_body_model
from mesh_writer import write_mesh
from omomo_writer import clip_values, write_clips, write_scan
from source_people import assert_same_objects, write_models
from synthetic import make

TABLE = make("push_table", seconds=3.0)
CHAIR = make("move_chair", seconds=2.0, height=1.6)
LOWER = replace(make("carry_box", seconds=2.0).objects[0], name="mop_bottom")
MOP = replace(CHAIR, objects=(replace(CHAIR.objects[0], name="mop"), LOWER))
LARGE = replace(TABLE, objects=(replace(TABLE.objects[0], name="largetable"),))
CLIPS = {"sub3_largetable_007": LARGE, "sub4_mop_001": MOP}


def write_world(folder: Path, clips: list[dict] | None = None) -> Path:
    """Write a file of two people's clips, with scans and a body model beside it; the file's path."""
    values = [clip_values(clip, name, body=index) for index, (name, clip) in enumerate(CLIPS.items())]
    write_scan(folder, "largetable_cleaned_simplified", LARGE.objects[0])
    write_scan(folder, "mop_cleaned_simplified_top", MOP.objects[0])
    write_scan(folder, "mop_cleaned_simplified_bottom", LOWER)
    write_models(folder / "models", [clip.people[0] for clip in CLIPS.values()], "smplx", ["male"], shapes=16)
    return write_clips(folder, values if clips is None else clips)


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> Path:
    return write_world(tmp_path_factory.mktemp("world"))


def chosen(path: Path, name: str) -> Path:
    return Path(f"{path}#{name}")


def assert_same_body(read: Clip, written: Clip) -> None:
    ours, theirs = read.people[0], written.people[0]
    np.testing.assert_allclose(ours.joint_positions[:, :22], theirs.joint_positions[:, :22], atol=1e-6)
    assert se3.angle_between(ours.joint_quats[:, :22], theirs.joint_quats[:, :22]).max() < 1e-6


@pytest.mark.parametrize("name", CLIPS)
def test_without_a_body_model(world, name):
    clip = read_clip(chosen(world, name))
    assert_same_body(clip, CLIPS[name])
    assert_same_objects(clip, CLIPS[name])
    assert (clip.name, clip.fps, clip.frames, clip.contacts) == (name, 30.0, CLIPS[name].frames, ())
    assert any("no fingers" in note for note in clip.source.notes)
    assert any("30 frames a second" in note for note in clip.source.notes)
    # Straight fingers are near where hands are.
    gap = clip.people[0].part_position("left_hand") - CLIPS[name].people[0].part_position("left_hand")
    assert np.linalg.norm(gap, axis=1).max() < 0.06


@pytest.mark.parametrize("index", [0, 1])
def test_with_a_body_model(world, index):
    name = list(CLIPS)[index]
    clip = read_clip(chosen(world, name), ReadOptions(body_models=world.parent / "models"))
    assert_same_body(clip, CLIPS[name])
    # Flat hands, of the body that the betas say.
    model = load_body_model(world.parent / "models", "male", "smplx")
    rest = model.rest_joints(np.eye(16)[0] * index)
    bone = rest[26] - rest[25]
    person = clip.people[0]
    wrist = person.quat("left_wrist")
    read = se3.rotate_inverse(wrist, person.position("left_index2") - person.position("left_index1"))
    np.testing.assert_allclose(read, np.broadcast_to(bone, read.shape), atol=1e-9)
    assert "Hands are not recorded; the model's are flat." in clip.source.notes


def test_a_file_holds_many_clips(world):
    assert reader_of(SourceFile(world)) is omomo.READER
    assert can_be_clip(world)
    assert clips_in(world) == tuple(chosen(world, name) for name in CLIPS)
    with pytest.raises(ArgumentError, match="there are 2 clips in it"):
        read_clip(world)
    with pytest.raises(ArgumentError, match="Did you mean 'sub4_mop_001'"):
        read_clip(chosen(world, "sub4_mop_002"))
    outline = omomo.READER.outline(SourceFile(chosen(world, "sub4_mop_001")))
    assert (outline.objects, outline.frames) == (("mop", "mop_bottom"), MOP.frames)
    assert "male" in outline.skeleton
    with pytest.raises(ReadError, match="does not say which of its 2 clips"):
        omomo.READER.outline(SourceFile(world))
    with pytest.raises(ArgumentError, match="this one names mop"):
        read_clip(chosen(world, "sub4_mop_001"), ReadOptions(object_name="mop"))


def test_one_clip_needs_no_name(tmp_path):
    path = write_world(tmp_path, [clip_values(LARGE, "sub3_largetable_007")])
    assert_same_body(read_clip(path), LARGE)


def test_a_file_is_parsed_once_until_it_changes(tmp_path, monkeypatch):
    path, parsed = write_world(tmp_path), []
    whole = omomo.read_joblib
    monkeypatch.setattr(omomo, "read_joblib", lambda it: parsed.append(it) or whole(it))
    before = [read_clip(chosen(path, name)) for name in (*CLIPS, *CLIPS)]
    assert len(parsed) == 1
    write_clips(tmp_path, [clip_values(LARGE, name) for name in ("sub5_largetable_000", *CLIPS)])
    after = read_clip(chosen(path, "sub5_largetable_000"))
    assert len(parsed) == 2
    assert before[0].source.sha256 != after.source.sha256


def test_every_way_of_joblib(tmp_path):
    for options in ({"alignment": None, "protocol": 3}, {"compressed": True}):
        write_world(tmp_path)
        path = write_clips(tmp_path, [clip_values(LARGE, "sub3_largetable_007")], **options)
        assert_same_body(read_clip(path), LARGE)


def test_scans_are_not_centred_meshes(tmp_path):
    path = write_world(tmp_path, [clip_values(LARGE, "sub3_largetable_007")])
    elsewhere = tmp_path / "elsewhere"
    (tmp_path / "captured_objects").rename(elsewhere)
    assert_same_objects(read_clip(path, ReadOptions(objects=elsewhere)), LARGE)
    with pytest.raises(GeometryError, match=r"largetable_cleaned_simplified\.obj"):
        read_clip(path)
    write_mesh(tmp_path / "centred" / "largetable" / "largetable.obj", LARGE.objects[0].geometry)
    with pytest.raises(GeometryError, match="may be InterMimic's mesh"):
        read_clip(path, ReadOptions(objects=tmp_path / "centred"))


def test_a_size_that_hardly_changes_is_its_mean(tmp_path):
    values = clip_values(LARGE, "sub3_largetable_007")
    values["obj_scale"] = values["obj_scale"] * np.linspace(1 - 4e-4, 1 + 4e-4, LARGE.frames)
    clip = read_clip(write_world(tmp_path, [values]))
    assert_same_objects(clip, LARGE)
    assert any("size of largetable varies by 8.0e-04" in note for note in clip.source.notes)


def with_nan(values: np.ndarray) -> np.ndarray:
    changed = values.copy()
    changed[7] = np.nan
    return changed


Y_UP = se3.exp(np.array([-np.pi / 2, 0.0, 0.0]))

MISTAKES: dict[str, tuple[Callable[[dict], object], str]] = {
    "a key is missing": (lambda it: it.pop("pose_body"), "sub3_largetable_007/pose_body, the body's pose, is missing"),
    "no object": (lambda it: it.pop("obj_rot"), "obj_rot, the object's rotation, is missing"),
    "another shape": (lambda it: it.update(pose_body=it["pose_body"].reshape(-1, 21, 3)), "expected (91, 63)"),
    "the object is shorter": (lambda it: it.update(obj_rot=it["obj_rot"][:-1]), "expected (91, 3, 3)"),
    "position without its axis": (lambda it: it.update(obj_trans=it["obj_trans"][..., 0]), "expected (91, 3, 1)"),
    "22 joints at rest": (lambda it: it.update(rest_offsets=it["rest_offsets"][:22]), "expected (24, 3)"),
    "few frames": (lambda it: it.update(trans=it["trans"][:3]), "too few frames (recording: 3); at least 4"),
    "no numbers": (lambda it: it.update(trans=with_nan(it["trans"])), "not finite or above 10000 in 1 frame (7)"),
    "the size changes": (
        lambda it: it.update(obj_scale=it["obj_scale"] * np.linspace(1, 1.01, 91)),
        "goes from 0.4 to 0.404 times its scan's",
    ),
    "no size": (lambda it: it.update(obj_scale=0 * it["obj_scale"]), "goes from 0 to 0 times"),
    "no rotation": (lambda it: it.update(obj_rot=2 * it["obj_rot"]), "is no rotation in 91 frames"),
    "mirrored": (lambda it: it.update(obj_rot=-it["obj_rot"]), "mirrors in 91 frames"),
    "offsets of another pose": (
        lambda it: it.update(rest_offsets=it["rest_offsets"][:, [1, 0, 2]]),
        "knees or elbows elsewhere",
    ),
    "centimetres": (lambda it: it.update(rest_offsets=100 * it["rest_offsets"]), "another unit than metres"),
    "y is up": (
        lambda it: it.update(root_orient=se3.log(se3.quat_multiply(Y_UP, se3.exp(it["root_orient"].astype(float))))),
        "stands along y",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_every_mistake_has_one_error(tmp_path, mistake):
    change, words = MISTAKES[mistake]
    values = clip_values(LARGE, "sub3_largetable_007")
    change(values)
    with pytest.raises(ClipError) as caught:
        read_clip(write_world(tmp_path, [values]))
    assert words in str(caught.value), str(caught.value)


BODY_MISTAKES: dict[str, tuple[Callable[[dict], object], str]] = {
    "another body": (lambda it: it.update(betas=np.full((1, 16), 0.5)), "from where the clip's own skeleton has it"),
    "ten betas": (lambda it: it.update(betas=it["betas"][:, :10]), "expected (1, 16)"),
    "an unknown gender": (lambda it: it.update(gender="unknown"), "no gender 'unknown'"),
    "no gender": (lambda it: it.pop("gender"), "gender, the body model, is missing"),
}


@pytest.mark.parametrize("mistake", BODY_MISTAKES)
def test_mistakes_that_a_body_model_shows(tmp_path, mistake):
    change, words = BODY_MISTAKES[mistake]
    values = clip_values(LARGE, "sub3_largetable_007")
    change(values)
    path = write_world(tmp_path, [values])
    with pytest.raises(ClipError) as caught:
        read_clip(path, ReadOptions(body_models=tmp_path / "models"))
    assert words in str(caught.value), str(caught.value)


def test_a_model_that_differs_a_little_is_noted(tmp_path):
    values = clip_values(LARGE, "sub3_largetable_007")
    values["trans2joint"] = values["trans2joint"] + [0.02, 0.0, 0.0]
    clip = read_clip(write_world(tmp_path, [values]), ReadOptions(body_models=tmp_path / "models"))
    assert any("0.020 m from where the clip's own skeleton" in note for note in clip.source.notes)
    with pytest.raises(ReadError, match="no female smplx model"):
        values["gender"] = "female"
        read_clip(write_world(tmp_path, [values]), ReadOptions(body_models=tmp_path / "models"))


@pytest.mark.parametrize(
    ("clips", "words"),
    [
        ([{"seq_name": "../largetable_1", "rest_offsets": 0, "trans2joint": 0}], "expected a name such as"),
        ([{"seq_name": "sub3", "rest_offsets": 0, "trans2joint": 0}], "expected a name such as"),
        ([{"seq_name": "a_b", "rest_offsets": 0, "trans2joint": 0}] * 2, "two of its clips are called a_b"),
        ([["seq_name", "rest_offsets", "trans2joint"]], "called None"),
    ],
)
def test_files_of_something_else(tmp_path, clips, words):
    with pytest.raises(ReadError, match=words):
        read_clip(write_clips(tmp_path, clips))


def test_files_that_are_not_held(tmp_path):
    other = write_clips(tmp_path, [{"seq_name": "sub3_largetable_007", "motion": np.zeros(3)}])
    assert not can_be_clip(other)
    with pytest.raises(ReadError, match="something else than clips of omomo"):
        read_clip(other)
    other.write_bytes(b"\x78no")
    assert not can_be_clip(other)
    write_clips(tmp_path, [clip_values(LARGE, "sub3_largetable_007") | {"more": print}])
    with pytest.raises(ReadError, match="refused"):
        read_clip(other)
