"""IMHD2's recordings: written in worlds with any axis up and read back, and files that are damaged."""

import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import BodyModelError, ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.numerics import se3
from hoi_retarget.readers import read_clip, reader_of
from hoi_retarget.readers.imhd import FORMAT, READER
from imhd_writer import write_recording
from short_clips import cut
from source_people import assert_same_objects, assert_same_people, in_world
from synthetic import make

SUITCASE = make("drag_suitcase")
SHORT = cut(SUITCASE, 112, first=100)  # While the suitcase is dragged.


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A short recording and the folder of its model, in a folder of theirs."""
    root = tmp_path_factory.mktemp("imhd")
    return root, *write_recording(root, SHORT)


@pytest.fixture
def recording(tmp_path, written):
    """The same, to be changed."""
    root, *paths = written
    shutil.copytree(root, tmp_path, dirs_exist_ok=True)
    return tuple(tmp_path / path.relative_to(root) for path in paths)


def changed(path, **values):
    content = pickle.loads(path.read_bytes()) | values
    path.write_bytes(pickle.dumps({name: value for name, value in content.items() if value is not None}))


def turned(clip, rotation):
    """The clip in a world turned by a rotation vector, or by one for each frame."""
    turn = se3.exp(np.broadcast_to(np.array(rotation, dtype=float), (clip.frames, 3)))
    people = tuple(
        replace(
            person,
            joint_positions=se3.rotate(turn[:, None], person.joint_positions),
            joint_quats=se3.quat_multiply(turn[:, None], person.joint_quats),
        )
        for person in clip.people
    )
    tracks = tuple(
        replace(track, positions=se3.rotate(turn, track.positions), quats=se3.quat_multiply(turn, track.quats))
        for track in clip.objects
    )
    return replace(clip, people=people, objects=tracks)


@pytest.mark.parametrize("up", ["z", "y", "-y"])
def test_what_is_written_is_read(tmp_path, up):
    path, models = write_recording(tmp_path, in_world(SUITCASE, up))
    clip = read_clip(path, ReadOptions(body_models=models))
    assert_same_people(clip, SUITCASE)
    assert_same_objects(clip, SUITCASE)
    assert (clip.fps, clip.frames, clip.contacts) == (60.0, SUITCASE.frames, ())
    assert clip.name == "20230910_af_suitcase_freestyle1_gt_0_338_2309"
    assert clip.source.format == FORMAT == reader_of(SourceFile(path)).format
    assert clip.source.licence.startswith("IMHD2: CC BY-NC-SA 4.0")
    assert any(f"{up} is up: the person stands along it in 100%" in note for note in clip.source.notes)
    assert not READER.floor_at_zero


def test_a_world_upside_down_is_turned(tmp_path):
    """z down: heights are those of the clip; headings are turned around, as y becomes -y."""
    path, models = write_recording(tmp_path, turned(SHORT, [np.pi, 0.0, 0.0]))
    clip = read_clip(path, ReadOptions(body_models=models))
    assert_same_people(clip, SHORT)
    assert_same_objects(clip, SHORT)
    assert any("-z is up" in note for note in clip.source.notes)


@pytest.mark.parametrize("rotation", [[0.0, np.pi / 2, 0.0], [0.0, -np.pi / 2, 0.0], [np.radians(45), 0.0, 0.0]])
def test_a_world_with_no_axis_up_is_refused(tmp_path, rotation):
    path, models = write_recording(tmp_path, turned(SHORT, rotation))
    with pytest.raises(ClipError, match="which axis is up cannot be told"):
        read_clip(path, ReadOptions(body_models=models))


def test_somebody_who_hardly_ever_stands_shows_no_axis(tmp_path):
    leaning = np.radians(45.0) * (np.arange(12) >= 5)
    path, models = write_recording(tmp_path, turned(SHORT, leaning[:, None] * [1.0, 0.0, 0.0]))
    with pytest.raises(ClipError, match="z: 42%"):
        read_clip(path, ReadOptions(body_models=models))


def test_a_small_tilt_is_kept_and_its_possibility_noted(tmp_path):
    tilted = turned(SHORT, [np.radians(8), 0.0, 0.0])
    path, models = write_recording(tmp_path, tilted)
    clip = read_clip(path, ReadOptions(body_models=models))
    assert_same_people(clip, tilted)
    assert any("the floor may be tilted" in note for note in clip.source.notes)


def test_other_conventions_would_be_seen(recording):
    path, models = recording
    values = pickle.loads(path.read_bytes())

    def differs(check, **changes):
        changed(path, **changes)
        with pytest.raises(AssertionError):
            check(read_clip(path, ReadOptions(body_models=models)), SHORT, tolerance=1e-3)
        changed(path, **values)

    differs(assert_same_objects, objectRot=-values["objectRot"])
    differs(assert_same_people, smplShape=0 * values["smplShape"])
    differs(assert_same_people, smplHandPose=np.roll(values["smplHandPose"], 45, axis=1))
    differs(assert_same_people, smplHandPose=values["smplHandPose"] + 0.1)  # As with a mean hand.


def test_the_object_bat_is_a_baseball(tmp_path):
    bat = replace(SHORT, objects=(replace(SHORT.objects[0], name="baseball"),))
    path, models = write_recording(tmp_path, bat, Path("20230825", "20230825_zr_bat", "swing", "gt_1_0_-1.pkl"))
    clip = read_clip(path, ReadOptions(body_models=models))
    assert_same_objects(clip, bat)
    assert any("20230825_zr_bat" in note for note in clip.source.notes)
    assert READER.outline(SourceFile(path)).objects == ("baseball",)


def test_the_object_can_be_named(tmp_path, recording):
    path, models = recording
    lone = tmp_path / "elsewhere" / path.name
    lone.parent.mkdir()
    shutil.move(path, lone)
    shutil.move(tmp_path / "object_templates", tmp_path / "meshes")
    with pytest.raises(ClipError, match="its object is not told"):
        read_clip(lone, ReadOptions(body_models=models, objects=tmp_path / "meshes"))
    with pytest.raises(GeometryError, match="no folder object_templates"):
        read_clip(lone, ReadOptions(body_models=models, object_name="suitcase"))
    with pytest.raises(GeometryError, match=r"meshes/box/box_simplified_transformed\.obj"):
        read_clip(lone, ReadOptions(body_models=models, objects=tmp_path / "meshes", object_name="box"))
    clip = read_clip(lone, ReadOptions(body_models=models, objects=tmp_path / "meshes", object_name="suitcase"))
    assert_same_objects(clip, SHORT)


def test_a_name_without_its_folder_will_do(recording, monkeypatch):
    path, models = recording
    monkeypatch.chdir(path.parent)
    clip = read_clip(path.relative_to(path.parent), ReadOptions(body_models=models))
    assert_same_objects(clip, SHORT)
    assert clip.name.startswith("20230910_af_suitcase")


def test_outline_needs_neither_models_nor_meshes(recording):
    path, _ = recording
    shutil.rmtree(path.parents[4] / "object_templates")
    outline = READER.outline(SourceFile(path))
    assert (outline.frames, outline.fps, outline.fps_stated) == (12, 60.0, False)
    assert outline.objects == ("suitcase",)
    assert outline.skeleton == "SMPL-H neutral, 16 betas"


def test_other_pickles_are_not_taken(tmp_path, recording):
    path, _ = recording
    assert READER.holds(SourceFile(path))
    changed(path, smplTrans=None)
    assert not READER.holds(SourceFile(path))
    for content in (b"", b"no pickle", pickle.dumps({"body_pose": np.zeros(3)}), pickle.dumps(["smplHandPose"])):
        (tmp_path / "x.pkl").write_bytes(content)
        assert not READER.holds(SourceFile(tmp_path / "x.pkl"))


def test_nothing_in_a_pickle_is_executed(recording, tmp_path):
    path, models = recording

    class Touch:
        def __reduce__(self):
            return Path.touch, (tmp_path / "executed",)

    changed(path, more=Touch())
    with pytest.raises(ReadError, match="refused"):
        read_clip(path, ReadOptions(body_models=models))
    assert not (tmp_path / "executed").exists()


def test_models_must_be_there_and_right(recording):
    path, models = recording
    with pytest.raises(BodyModelError, match="neutral SMPL-H body model"):
        read_clip(path)
    (models / "SMPLH_NEUTRAL.npz").rename(models / "SMPLX_NEUTRAL.npz")
    with pytest.raises(ReadError, match="no neutral smplh model"):
        read_clip(path, ReadOptions(body_models=models))


def test_a_mesh_must_be_a_mesh(recording):
    path, models = recording
    mesh = path.parents[4] / "object_templates" / "suitcase" / "suitcase_simplified_transformed.obj"
    mesh.write_text("v 0 0 0\n")
    with pytest.raises(GeometryError, match="suitcase_simplified"):
        read_clip(path, ReadOptions(body_models=models))


def spoiled(array):
    array = array.copy()
    array[3, 1] = np.nan
    return array


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("objectRot", spoiled, "objectRot, the object's rotation, holds numbers that are not finite"),
        ("objectRot", lambda a: a[:, :2], r"objectRot, the object's rotation, has shape \(12, 2\)"),
        ("objectTrans", lambda a: a[:11], r"objectTrans, the object's position, has shape \(11, 3\)"),
        ("smplTrans", lambda a: a[:11], "differ in their number of frames"),
        ("smplTrans", spoiled, "smplTrans, the body's position, holds numbers that are not finite"),
        ("smplPose", lambda a: a[:, :63], "has 63 numbers a frame, expected at least 66"),
        ("smplPose", lambda a: a[:11], r"smplPose, the body's pose, has shape \(11, 72\)"),
        ("smplPose", lambda a: a.tolist(), None),
        ("smplPose", lambda _: "text", "holds <U4, expected numbers"),
        ("smplHandPose", lambda a: a[:, :24], r"the pose of both hands, has shape \(12, 24\), expected \(12, 90\)"),
        ("smplShape", lambda a: a[:, :10], r"smplShape, the body's shape, has shape \(12, 10\), expected \(12, 16\)"),
        ("smplShape", lambda a: a[0], r"smplShape, the body's shape, has shape \(16,\)"),
        ("smplShape", lambda a: 40 * a, "m tall"),
        ("smplShape", lambda a: a * np.arange(12)[:, None], "several people"),
    ],
)
def test_what_is_wrong_is_told(recording, name, change, words):
    path, models = recording
    changed(path, **{name: change(pickle.loads(path.read_bytes())[name])})
    if words is None:
        assert_same_people(read_clip(path, ReadOptions(body_models=models)), SHORT)
        return
    with pytest.raises(ClipError, match=words) as caught:
        read_clip(path, ReadOptions(body_models=models))
    assert str(path) in str(caught.value)


def test_too_few_frames_are_refused(recording):
    path, models = recording
    changed(path, **{name: array[:3] for name, array in pickle.loads(path.read_bytes()).items()})
    with pytest.raises(ClipError, match="too few frames"):
        read_clip(path, ReadOptions(body_models=models))
