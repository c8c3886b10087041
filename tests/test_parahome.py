"""ParaHome's own release: intervals of a recording, as the makers' fit of SMPL-X and as their own skeleton."""

import json
import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, BodyModelError, ClipError, GeometryError, HoiRetargetError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.skeleton import JOINT_INDEX, LEFT_FINGERS, RIGHT_FINGERS
from hoi_retarget.numerics import se3
from hoi_retarget.readers import can_be_clip, clips_in, parahome, read_clip, reader_of
from parahome_writer import T_POSE, poses_of, skeleton_of, tensor_pickle, write_model, write_pickle, write_recording
from source_people import assert_same_objects, assert_same_people
from synthetic import make

CHAIR = make("move_chair", seconds=4.0, fps=15.0)
OTHER = make("move_chair", seconds=1.0, height=1.5).people[0]
TABLE = make("push_table", seconds=4.0, fps=15.0).objects[0]
STILL = replace(
    TABLE,
    name="desk_base",
    positions=np.broadcast_to(TABLE.positions[0], TABLE.positions.shape),
    quats=np.broadcast_to(TABLE.quats[0], TABLE.quats.shape),
)
WRITTEN = replace(
    CHAIR, objects=(replace(CHAIR.objects[0], name="chair_base"), STILL, replace(TABLE, name="desk_part1"))
)
INTERVALS = {"30 50": "Sit on the chair", "5 30": "Move the chair"}
FRAMES = slice(5, 30)


def write_world(folder: Path) -> Path:
    write_model(folder / "models", OTHER, CHAIR.people[0])
    return write_recording(folder, WRITTEN, INTERVALS)


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> Path:
    return write_world(tmp_path_factory.mktemp("world"))


@pytest.fixture
def copy(world, tmp_path) -> Path:
    shutil.copytree(world.parents[2], tmp_path, dirs_exist_ok=True)
    return tmp_path / world.relative_to(world.parents[2])


def models_of(sequence: Path) -> Path:
    return sequence.parents[2] / "models"


def chosen(sequence: Path, name: str = "5-30") -> Path:
    return Path(f"{sequence}#{name}")


def cut(clip: Clip, frames: slice = FRAMES) -> Clip:
    """The clip of an interval alone."""
    people = tuple(
        replace(it, joint_positions=it.joint_positions[frames], joint_quats=it.joint_quats[frames])
        for it in clip.people
    )
    tracks = tuple(replace(it, positions=it.positions[frames], quats=it.quats[frames]) for it in clip.objects)
    return replace(clip, people=people, objects=tracks, contacts=())


def test_with_a_body_model(world):
    clip = read_clip(chosen(world), ReadOptions(body_models=models_of(world)))
    assert_same_people(clip, cut(WRITTEN))
    assert_same_objects(clip, cut(WRITTEN))
    assert (clip.name, clip.fps, clip.contacts, clip.first_source_frame) == ("s10_5-30", 30.0, (), 5)
    assert "CC BY-NC-SA 4.0" in clip.source.licence
    for words in ("Described as 'Move the chair'.", "30 frames a second", "Parts that do not move: desk_base."):
        assert any(words in note for note in clip.source.notes)


def test_without_one_it_is_their_own_skeleton(world):
    clip = read_clip(chosen(world, "30-50"))
    written = cut(WRITTEN, slice(30, 50))
    assert_same_objects(clip, written)
    ours, theirs = clip.people[0], written.people[0]
    np.testing.assert_allclose(ours.joint_positions, theirs.joint_positions, atol=1e-6)
    turns = se3.angle_between(ours.joint_quats, theirs.joint_quats)
    hands = [JOINT_INDEX[joint] for joint in ("left_wrist", "right_wrist", *LEFT_FINGERS, *RIGHT_FINGERS)]
    body = [joint for joint in range(22) if joint not in hands]
    assert turns[:, body].max() < 1e-6
    # The palm's frame is the wrist's, up to where the knuckles are in it.
    assert np.rad2deg(turns[:, hands[:2]].max()) < 8.0
    for joint in ("left_thumb2", "left_pinky3"):
        assert np.array_equal(ours.quat(joint), ours.quat("left_wrist"))
    assert any("ParaHome's own skeleton" in note for note in clip.source.notes)


def test_a_folder_holds_the_annotated_intervals(world):
    assert reader_of(SourceFile(world)) is parahome.READER
    assert can_be_clip(world)
    assert not can_be_clip(world.parent)
    assert clips_in(world) == (chosen(world, "5-30"), chosen(world, "30-50"))
    with pytest.raises(ArgumentError, match="there are 2 clips in it"):
        read_clip(world)
    with pytest.raises(ArgumentError, match="names chair, desk"):
        read_clip(chosen(world), ReadOptions(object_name="chair"))
    outline = parahome.READER.outline(SourceFile(chosen(world)))
    assert (outline.frames, outline.objects) == (25, ("chair", "desk"))
    with pytest.raises(ReadError, match="does not say which of its 2 intervals"):
        parahome.READER.outline(SourceFile(world))


def test_either_name_of_the_annotations(copy):
    (copy / "text_annotation.json").rename(copy / "text_annotations.json")
    assert read_clip(chosen(copy)).frames == 25


def test_a_part_that_is_there_now_and_then_is_left_out(copy):
    poses = poses_of(list(WRITTEN.objects))
    del poses[20]["chair_base"]
    write_pickle(copy / "object_transformations.pkl", poses)
    clip = read_clip(chosen(copy))
    assert [track.name for track in clip.objects] == ["desk_base", "desk_part1"]
    assert any(
        "Left out, as they are there in some of the frames only: chair_base (24 frames)." in note
        for note in clip.source.notes
    )
    assert len(read_clip(chosen(copy, "30-50")).objects) == 3


def test_frames_are_joined_by_their_numbers(copy):
    poses = poses_of(list(WRITTEN.objects))
    write_pickle(copy / "object_transformations.pkl", dict(reversed(poses.items())))
    assert_same_objects(read_clip(chosen(copy)), cut(WRITTEN))


def test_objects_are_parsed_once_until_they_change(copy, monkeypatch):
    parsed: list[Path] = []
    whole = parahome.parse_pickle
    monkeypatch.setattr(parahome, "parse_pickle", lambda content, path: parsed.append(path) or whole(content, path))
    for name in ("5-30", "30-50", "5-30"):
        read_clip(chosen(copy, name))
    assert parsed.count(copy / "object_transformations.pkl") <= 1


def test_meshes_are_found_in_the_tree_or_in_the_folder_given(copy, tmp_path):
    (tmp_path / "data" / "scan").rename(tmp_path / "elsewhere")
    with pytest.raises(GeometryError, match="Pass --objects DIR with ParaHome's scans, chair/simplified/base"):
        read_clip(chosen(copy))
    assert_same_objects(read_clip(chosen(copy), ReadOptions(objects=tmp_path / "elsewhere")), cut(WRITTEN))


@pytest.mark.parametrize(
    "axes",
    [
        np.eye(3),  # As SMPL-X: x to the left, y up.
        np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]),
        np.array([[0, 0, -1.0], [-1.0, 0, 0], [0, 1.0, 0]]),
    ],
)
def test_the_t_pose_may_lie_along_any_axes(copy, axes):
    for name, array in skeleton_of(CHAIR.people[0], se3.matrix_to_quat(axes)).items():
        write_pickle(copy / name, array)
    turns = se3.angle_between(read_clip(chosen(copy)).people[0].joint_quats, CHAIR.people[0].joint_quats[FRAMES])
    assert turns[:, :20].max() < 1e-6


def skeleton_changed(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    def apply(sequence: Path) -> None:
        write_pickle(sequence / name, change(pickle.loads((sequence / name).read_bytes())))

    return apply


def poses_changed(change: Callable[[dict], object]) -> Callable[[Path], None]:
    def apply(sequence: Path) -> None:
        poses = poses_of(list(WRITTEN.objects))
        change(poses)
        write_pickle(sequence / "object_transformations.pkl", poses)

    return apply


def annotated(intervals: object) -> Callable[[Path], object]:
    return lambda sequence: (sequence / "text_annotation.json").write_text(json.dumps(intervals))


def with_nan(values: np.ndarray) -> np.ndarray:
    changed = values.copy()
    changed[20, 3] = np.nan
    return changed


def columns(rows: np.ndarray) -> np.ndarray:
    """The first two columns of rotations of which there are rows."""
    first, second = rows[..., :3], rows[..., 3:]
    matrices = np.stack([first, second, np.cross(first, second)], axis=-1)
    return matrices[..., :2, :].reshape(rows.shape)


def renamed(poses: dict, name: str) -> None:
    for parts in poses.values():
        parts[name] = parts.pop("chair_base")


def scaled(poses: dict) -> None:
    for parts in poses.values():
        parts["chair_base"] = parts["chair_base"] * [[2.0], [2.0], [2.0], [1.0]]


def transposed(poses: dict) -> None:
    for parts in poses.values():
        parts["chair_base"] = parts["chair_base"].T


def emptied(poses: dict) -> None:
    for frame in range(25):
        poses[frame] = {}


def on_its_side(sequence: Path) -> None:
    turn = se3.exp(np.array([np.pi / 2, 0.0, 0.0]))
    person = CHAIR.people[0]
    turned = replace(
        person,
        joint_positions=se3.rotate(turn, person.joint_positions),
        joint_quats=se3.quat_multiply(turn, person.joint_quats),
    )
    for name, array in skeleton_of(turned).items():
        write_pickle(sequence / name, array)


BODY_ROWS, JOINTS, POSES = "body_joint_orientations.pkl", "joint_positions.pkl", "object_transformations.pkl"
MISTAKES: dict[str, tuple[Callable[[Path], object], type[HoiRetargetError], str]] = {
    "no annotations": (lambda it: (it / "text_annotation.json").unlink(), ReadError, "which tells its clips"),
    "no intervals": (annotated({}), ReadError, "there are no intervals"),
    "an interval of one frame": (annotated({"10": "a"}), ReadError, "is no interval of frames"),
    "an interval that ends first": (annotated({"30 5": "a"}), ReadError, "is no interval of frames"),
    "an interval without a text": (annotated({"5 30": 3}), ReadError, "is no interval of frames"),
    "a short interval": (annotated({"10 12": "a"}), ClipError, "too few frames (recording: 2); at least 4"),
    "an interval beyond the end": (annotated({"40 200": "a"}), ClipError, "there in all frames of 40-200"),
    "no orientations": (lambda it: (it / BODY_ROWS).unlink(), ReadError, f"{BODY_ROWS}: there is no such file"),
    "no pickle": (lambda it: (it / POSES).write_bytes(b"no"), ReadError, "which no pickle of protocol 2 to 5 does"),
    "no dictionary": (lambda it: write_pickle(it / POSES, [1]), ReadError, "there are no poses of objects"),
    "frames that are names": (poses_changed(lambda it: it.update(a={})), ReadError, "frame 'a' is not a number"),
    "poses of another shape": (
        poses_changed(lambda it: it[3].update(chair_base=np.eye(3))),
        ReadError,
        "frame 3: 'chair_base' is no part with a matrix (4, 4)",
    ),
    "fewer joints": (skeleton_changed(JOINTS, lambda it: it[:, :23]), ClipError, "expected (T, 73, 3)"),
    "the joints are shorter": (skeleton_changed(JOINTS, lambda it: it[:25]), ClipError, "ends after the 25 frames"),
    "rotations are shorter": (skeleton_changed(BODY_ROWS, lambda it: it[:-1]), ClipError, "expected (61, 23, 6)"),
    "no numbers": (skeleton_changed(JOINTS, with_nan), ClipError, "not finite or above 10000 in 1 frame (20)"),
    "rotations that are none": (skeleton_changed(BODY_ROWS, lambda it: 0 * it), ClipError, "zero or parallel"),
    "columns for rows": (skeleton_changed(BODY_ROWS, columns), BodyModelError, "its bones do not keep their place"),
    "rotations of other frames": (
        skeleton_changed(BODY_ROWS, lambda it: np.roll(it, 15, axis=0)),
        BodyModelError,
        "Pass --body-models DIR with SMPL-X",
    ),
    "a frame that is no rotation": (
        skeleton_changed("body_global_transform.pkl", lambda it: 2 * it),
        ClipError,
        "body_global_transform.pkl holds matrices whose last row",
    ),
    "flat palms": (
        skeleton_changed(JOINTS, lambda it: np.concatenate([it[:, :23], 0 * it[:, 23:]], axis=1)),
        ClipError,
        "a palm without length",
    ),
    "another unit": (skeleton_changed(JOINTS, lambda it: 3 * it), ClipError, "another unit than metres"),
    "a part that leads away": (poses_changed(lambda it: renamed(it, "../chair_base")), ReadError, "no plain name"),
    "a part without an object": (poses_changed(lambda it: renamed(it, "base")), ReadError, "no plain name"),
    "an unknown part": (poses_changed(lambda it: renamed(it, "chair_part7")), GeometryError, "simplified/part7.obj"),
    "scaled poses": (poses_changed(scaled), ClipError, "chair_base is no rotation in 25 frames"),
    "transposed poses": (poses_changed(transposed), ClipError, "chair_base holds matrices whose last row"),
    "no objects": (poses_changed(emptied), ClipError, "no part of an object is there in all frames"),
    "y is up": (on_its_side, ClipError, "stands along -y"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_every_mistake_has_one_error(copy, mistake):
    apply, error, words = MISTAKES[mistake]
    apply(copy)
    with pytest.raises(error) as caught:
        read_clip(clips_in(copy)[0])
    assert words in str(caught.value), str(caught.value)


def fit_changed(file: str, change: Callable[[dict], object]) -> Callable[[Path], None]:
    def apply(sequence: Path) -> None:
        path = sequence.parents[1] / "smplx_seq" / "s10" / file
        values = dict(parahome.parse_pickle(path.read_bytes(), path))
        change(values)
        path.write_bytes(tensor_pickle(values))

    return apply


PARAMETERS, POSE = "smplx_params.pkl", "smplx_pose.pkl"
FIT_MISTAKES: dict[str, tuple[Callable[[Path], object], type[HoiRetargetError], str]] = {
    "no fit": (
        lambda it: (it.parents[1] / "smplx_seq").rename(it.parents[1] / "other"),
        ReadError,
        "there is no folder smplx_seq/s10",
    ),
    "no pose": (lambda it: (it.parents[1] / "smplx_seq/s10" / POSE).unlink(), ReadError, "there is no such file"),
    "ten betas": (
        fit_changed(PARAMETERS, lambda it: it.update(beta=it["beta"][:, :10])),
        ClipError,
        "expected (1, 20)",
    ),
    "an unknown gender": (fit_changed(PARAMETERS, lambda it: it.update(gender="f")), ClipError, "no gender 'f'"),
    "another gender": (fit_changed(PARAMETERS, lambda it: it.update(gender="male")), ReadError, "no male smplx model"),
    "a key is missing": (fit_changed(POSE, lambda it: it.pop("hand_pose")), ClipError, "hand_pose, the hands' pose"),
    "one hand": (
        fit_changed(POSE, lambda it: it.update(hand_pose=it["hand_pose"][:, :45])),
        ClipError,
        "expected (61, 90)",
    ),
    "the fit is shorter": (fit_changed(POSE, lambda it: it.update(transl=it["transl"][:-1])), ClipError, "(61, 3)"),
    "the fit is elsewhere": (
        fit_changed(POSE, lambda it: it.update(transl=it["transl"] + 0.2)),
        ClipError,
        "frames or people differ",
    ),
    "a list": (
        lambda it: (it.parents[1] / "smplx_seq/s10" / POSE).write_bytes(tensor_pickle([1])),
        ReadError,
        "expected a dictionary",
    ),
}


@pytest.mark.parametrize("mistake", FIT_MISTAKES)
def test_mistakes_of_the_fit(copy, mistake):
    apply, error, words = FIT_MISTAKES[mistake]
    apply(copy)
    with pytest.raises(error) as caught:
        read_clip(chosen(copy), ReadOptions(body_models=models_of(copy)))
    assert words in str(caught.value), str(caught.value)


def test_rows_by_joint_and_arrays_of_numpy(copy):
    fit_changed(POSE, lambda it: it.update(body_pose=it["body_pose"].reshape(-1, 21, 3)))(copy)
    fit_changed(POSE, lambda it: it.update(hand_pose=it["hand_pose"].reshape(-1, 30, 3)))(copy)
    path = copy.parents[1] / "smplx_seq" / "s10" / PARAMETERS
    values = parahome.parse_pickle(path.read_bytes(), path)
    write_pickle(path, {"beta": np.array(values["beta"][0]), "gender": "female"})
    assert_same_people(read_clip(chosen(copy), ReadOptions(body_models=models_of(copy))), cut(WRITTEN))


def test_the_t_pose_of_the_writer_is_parahomes():
    forward, left, up = np.eye(3)
    for ours, theirs in (([0.0, 0, 1], forward), ([1.0, 0, 0], left), ([0, 1.0, 0], up)):
        np.testing.assert_allclose(se3.rotate(T_POSE, np.array(ours)), theirs, atol=1e-12)
