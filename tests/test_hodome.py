"""HODome's sequences: written as the data set has them and read back, and files that are damaged or do not fit."""

import shutil

import numpy as np
import pytest

from hodome_writer import write_sequence
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import BodyModelError, ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.numerics import se3
from hoi_retarget.readers import read_clip, reader_of
from hoi_retarget.readers.hodome import FORMAT, READER
from npz_changes import changed
from short_clips import cut
from source_people import assert_same_objects, assert_same_people
from synthetic import make

SUITCASE = make("drag_suitcase")
SHORT = cut(SUITCASE, 112, first=100)  # While the suitcase is dragged.
NAME = "subject01_suitcase"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A short sequence and the folder of its model, in a folder of theirs."""
    root = tmp_path_factory.mktemp("hodome")
    return root, *write_sequence(root, SHORT, NAME)


@pytest.fixture
def sequence(tmp_path, written):
    """The same, to be changed."""
    root, *paths = written
    shutil.copytree(root, tmp_path, dirs_exist_ok=True)
    return tuple(tmp_path / path.relative_to(root) for path in paths)


def object_file(path):
    return path.parents[1] / "object" / path.name


@pytest.mark.parametrize("scene", ["drag_suitcase", "move_chair"])
def test_what_is_written_is_read(tmp_path, scene):
    made = make(scene)
    path, models = write_sequence(tmp_path, made, f"subject03_{made.objects[0].name}")
    clip = read_clip(path, ReadOptions(body_models=models))
    assert_same_people(clip, made)
    assert_same_objects(clip, made)
    assert (clip.name, clip.fps, clip.frames) == (path.stem, 60.0, made.frames)
    assert (clip.contacts, clip.first_source_frame) == ((), 0)
    assert clip.source.format == FORMAT == reader_of(SourceFile(path)).format
    assert "non-commercial" in clip.source.licence
    assert any("60 frames a second" in note for note in clip.source.notes)
    assert not READER.floor_at_zero


def test_other_conventions_would_be_seen(sequence):
    path, models = sequence
    with np.load(path) as human, np.load(object_file(path)) as thing:
        numbers, poses = dict(human), dict(thing)

    def differs(file, check, **values):
        before = file.read_bytes()
        changed(file, **values)
        with pytest.raises(AssertionError):
            check(read_clip(path, ReadOptions(body_models=models)), SHORT, tolerance=1e-3)
        file.write_bytes(before)

    assert np.abs(poses["object_R"] - poses["object_R"].swapaxes(1, 2)).max() > 0.1
    differs(object_file(path), assert_same_objects, object_R=poses["object_R"].swapaxes(1, 2))
    differs(path, assert_same_people, betas=0 * numbers["betas"])
    differs(path, assert_same_people, left_hand_pose=numbers["right_hand_pose"])
    differs(path, assert_same_people, left_hand_pose=numbers["left_hand_pose"] + 0.1)  # As with a mean hand.


def test_poses_may_be_in_rows_and_the_rate_beside_them(sequence):
    path, models = sequence
    with np.load(path) as human, np.load(object_file(path)) as thing:
        rows = {name: human[name].reshape(12, -1, 3) for name in ("body_pose", "left_hand_pose", "right_hand_pose")}
        positions = thing["object_T"][:, None]
    changed(path, **rows)
    changed(object_file(path), object_T=positions, mocap_frame_rate=np.int64(50))
    clip = read_clip(path, ReadOptions(body_models=models))
    assert_same_people(clip, SHORT)
    assert_same_objects(clip, SHORT)
    assert clip.fps == 50.0
    assert not any("60 frames" in note for note in clip.source.notes)


def test_frames_are_joined_by_their_ids(sequence):
    """The object's row is the frame's id; what it has no pose for is left out at both ends."""
    path, models = sequence
    changed(path, frame_ids=np.arange(20_000_003, 20_000_015))
    with np.load(object_file(path)) as thing:
        poses = dict(thing)
    ids = np.arange(20_000_005, 20_000_017)
    changed(object_file(path), frame_ids=ids, **{name: np.roll(array, -2, axis=0) for name, array in poses.items()})
    clip = read_clip(path, ReadOptions(body_models=models))
    assert_same_people(clip, cut(SHORT, 12, first=2))
    assert_same_objects(clip, cut(SHORT, 12, first=2))
    assert clip.first_source_frame == 2
    assert any("2 frame(s) at the ends are left out" in note for note in clip.source.notes)


def test_an_id_is_the_row_of_the_objects_pose(sequence):
    path, models = sequence
    with np.load(path) as human:
        later = {name: array[4:] for name, array in human.items()}
    changed(path, **later)
    clip = read_clip(path, ReadOptions(body_models=models))
    assert_same_people(clip, cut(SHORT, 12, first=4))
    assert_same_objects(clip, cut(SHORT, 12, first=4))
    assert clip.first_source_frame == 0


def test_the_object_can_be_named(tmp_path):
    path, models = write_sequence(tmp_path, SHORT, "subject01_bag_2")
    with pytest.raises(GeometryError, match=r"scaned_object/2/2_face1000\.obj"):
        read_clip(path, ReadOptions(body_models=models))
    clip = read_clip(path, ReadOptions(body_models=models, object_name="suitcase"))
    assert_same_objects(clip, SHORT)
    assert "The object is suitcase, as was asked for." in clip.source.notes


def test_meshes_can_be_elsewhere(tmp_path, sequence):
    path, models = sequence
    shutil.move(path.parents[1] / "scaned_object", tmp_path / "meshes")
    with pytest.raises(GeometryError, match="no mesh"):
        read_clip(path, ReadOptions(body_models=models))
    assert_same_objects(read_clip(path, ReadOptions(body_models=models, objects=tmp_path / "meshes")), SHORT)


def test_a_name_without_its_folder_will_do(sequence, monkeypatch):
    path, models = sequence
    monkeypatch.chdir(path.parent)
    assert_same_objects(read_clip(path.relative_to(path.parent), ReadOptions(body_models=models)), SHORT)


def test_outline_needs_neither_models_nor_meshes(sequence):
    path, _ = sequence
    shutil.rmtree(path.parents[1] / "scaned_object")
    outline = READER.outline(SourceFile(path))
    assert (outline.frames, outline.fps, outline.fps_stated) == (12, 60.0, False)
    assert outline.objects == ("suitcase",)
    assert outline.skeleton == "SMPL-X neutral, 10 betas"


def test_other_archives_are_not_taken(tmp_path, sequence):
    path, _ = sequence
    assert READER.holds(SourceFile(path))
    assert not READER.holds(SourceFile(object_file(path)))
    changed(path, transl=None)
    assert not READER.holds(SourceFile(path))
    (tmp_path / "x.npz").write_bytes(b"no archive")
    assert not READER.holds(SourceFile(tmp_path / "x.npz"))


def test_the_objects_file_must_be_there(sequence):
    path, models = sequence
    object_file(path).unlink()
    with pytest.raises(ReadError, match=r"object/subject01_suitcase\.npz: there is no such file"):
        read_clip(path, ReadOptions(body_models=models))
    object_file(path).parent.rmdir()
    with pytest.raises(ReadError, match="the object's poses are missing"):
        read_clip(path, ReadOptions(body_models=models))


def test_models_must_be_there_and_right(tmp_path, sequence):
    path, models = sequence
    with pytest.raises(BodyModelError, match="neutral SMPL-X body model"):
        read_clip(path)
    (models / "SMPLX_NEUTRAL.npz").rename(models / "SMPLX_MALE.npz")
    with pytest.raises(ReadError, match="no neutral smplx model"):
        read_clip(path, ReadOptions(body_models=models))


def turned(rotation):
    return lambda root: se3.log(se3.quat_multiply(se3.exp(np.array(rotation)), se3.exp(root)))


def spoiled(array):
    array = np.array(array, dtype=float)
    array[3, 1] = np.nan
    return array


@pytest.mark.parametrize(
    ("whose", "name", "change", "words"),
    [
        ("object", "object_R", None, "object_R, the object's rotation, is missing"),
        ("object", "object_T", None, "object_T, the object's position, is missing"),
        ("object", "object_R", lambda a: a.reshape(12, 9), r"has shape \(12, 9\), expected \(T, 3, 3\)"),
        ("object", "object_R", lambda a: 1.1 * a, "object_R is no rotation in 12 frames"),
        ("object", "object_R", lambda a: -a, "object_R mirrors in 12 frames"),
        ("object", "object_R", spoiled, "object_R, the object's rotation, holds numbers that are not finite"),
        ("object", "object_T", spoiled, "object_T, the object's position, holds numbers that are not finite"),
        ("object", "object_T", lambda a: a[:11], r"object_T, the object's position, has shape \(11, 3\)"),
        ("object", "frame_ids", lambda _: np.arange(11), r"object_R, the object's rotation, has shape \(12, 3, 3\)"),
        ("object", "frame_ids", lambda _: np.arange(50, 62), "have 0 frames in common"),
        ("object", "mocap_frame_rate", lambda _: np.float64(0), "the rate is 0.0 frames a second"),
        ("object", "mocap_frame_rate", lambda _: np.zeros(2), r"the rate, has shape \(2,\)"),
        ("human", "frame_ids", lambda a: 2 * a, "frame_ids goes from 0 to 2"),
        ("human", "frame_ids", lambda a: a[::-1], "frame_ids goes from 11 to 10"),
        ("human", "frame_ids", lambda a: a.astype(float), "frame_ids is no row of whole numbers"),
        ("human", "frame_ids", lambda a: a + 9, "have 3 frames in common"),
        ("human", "frame_ids", lambda a: a[:0], "have 0 frames in common"),
        ("human", "frame_ids", lambda a: a[:11], r"has shape \(12, "),
        ("human", "betas", lambda a: a[:, :9], r"betas, the body's shape, has shape \(12, 9\), expected \(12, 10\)"),
        ("human", "betas", lambda a: 40 * a, "m tall"),
        ("human", "betas", lambda a: a * np.arange(12)[:, None], "several people"),
        ("human", "body_pose", lambda a: a[:, :60], r"body_pose, the body's pose, has shape \(12, 60\)"),
        ("human", "left_hand_pose", lambda a: a[:, :12], r"left_hand_pose, the left hand's pose, has shape \(12, 12\)"),
        ("human", "transl", spoiled, "transl, the body's position, holds numbers that are not finite"),
        ("human", "global_orient", turned([np.pi / 2, 0, 0]), "stands along -?[xyz]"),
        ("human", "global_orient", turned([0, 0, np.pi]), "stands along -z"),
    ],
)
def test_what_is_wrong_is_told(sequence, whose, name, change, words):
    path, models = sequence
    file = path if whose == "human" else object_file(path)
    with np.load(file) as archive:
        value = None if change is None else change(archive.get(name))
    changed(file, **{name: value})
    with pytest.raises(ClipError, match=words) as caught:
        read_clip(path, ReadOptions(body_models=models))
    assert path.stem in str(caught.value)


@pytest.mark.parametrize("whose", ["human", "object"])
def test_damaged_archives_are_told(sequence, whose):
    path, models = sequence
    file = path if whose == "human" else object_file(path)
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(ReadError, match=r"not a readable \.npz"):
        read_clip(path, ReadOptions(body_models=models))


def test_the_digest_is_of_both_files(sequence):
    path, models = sequence
    before = read_clip(path, ReadOptions(body_models=models)).source.sha256
    changed(object_file(path), object_T=np.zeros((12, 3)))
    assert read_clip(path, ReadOptions(body_models=models)).source.sha256 != before
