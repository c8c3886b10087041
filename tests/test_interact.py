"""InterAct's canonical sequences: written in the layout of each data set and read back, and files that are damaged."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, BodyModelError, ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.numerics import se3
from hoi_retarget.readers import read_clip, reader_of
from hoi_retarget.readers.interact import FORMAT, READER, SUBSETS
from interact_writer import GENDER, write_sequence
from npz_changes import changed
from short_clips import cut
from source_people import assert_same_objects, assert_same_people
from synthetic import make
from torch_writer import torch_bytes

SUITCASE = make("drag_suitcase")
DRAGGED = cut(SUITCASE, 130, first=100)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A short sequence of OMOMO and the folder of its models, in a folder of theirs."""
    root = tmp_path_factory.mktemp("omomo")
    return root, *write_sequence(root, cut(DRAGGED, 12), "omomo")


@pytest.fixture
def sequence(tmp_path, written):
    """The same, to be changed."""
    root, *paths = written
    shutil.copytree(root, tmp_path, dirs_exist_ok=True)
    return tuple(tmp_path / path.relative_to(root) for path in paths)


@pytest.mark.parametrize("folder", SUBSETS)
def test_what_is_written_is_read(tmp_path, folder):
    place, models = write_sequence(tmp_path, SUITCASE, folder)
    clip = read_clip(place, ReadOptions(body_models=models))
    assert_same_people(clip, SUITCASE)
    assert_same_objects(clip, SUITCASE)
    assert (clip.name, clip.fps, clip.frames, clip.contacts) == ("s1_clip", 30.0, SUITCASE.frames, ())
    assert clip.source.format == FORMAT == reader_of(SourceFile(place)).format
    assert clip.source.licence.startswith(SUBSETS[folder].title)
    assert "InterAct" in clip.source.licence
    assert f"{SUBSETS[folder].title}, as the folder {folder!r} says" in clip.source.notes[0]


def test_the_floor_is_promised():
    assert READER.floor_at_zero


def test_other_conventions_would_be_seen(tmp_path):
    """The recording tells them apart: read as it is written, it is the clip; written otherwise, it is not."""
    place, models = write_sequence(tmp_path, SUITCASE, "behave")
    with np.load(place / "human.npz") as human, np.load(place / "object.npz") as thing:
        poses, betas, angles = human["poses"], human["betas"], thing["angles"]

    def differs(file, check, **values):
        before = (place / file).read_bytes()
        changed(place / file, **values)
        with pytest.raises(AssertionError):
            check(read_clip(place, ReadOptions(body_models=models)), SUITCASE, tolerance=1e-3)
        (place / file).write_bytes(before)

    differs("object.npz", assert_same_objects, angles=-angles)
    differs("human.npz", assert_same_people, betas=0 * betas)
    hands = poses.copy()
    hands[:, 66:111], hands[:, 111:] = poses[:, 111:], poses[:, 66:111]
    differs("human.npz", assert_same_people, poses=hands)
    mesh = place.parents[1] / "objects" / "suitcase" / "suitcase.obj"
    mesh.write_text(
        "\n".join(
            f"v {float(line.split()[1]) + 0.1} {' '.join(line.split()[2:])}" if line.startswith("v ") else line
            for line in mesh.read_text().splitlines()
        )
    )
    clip = read_clip(place, ReadOptions(body_models=models))
    assert any("10.0 cm from its origin" in note for note in clip.source.notes)
    with pytest.raises(AssertionError):
        assert_same_objects(clip, SUITCASE, tolerance=1e-3)


@pytest.mark.parametrize("folder", [name for name, subset in SUBSETS.items() if subset.hand == 45])
def test_hands_are_counted_from_flat_or_mean_ones(tmp_path, folder):
    wrong = replace(SUBSETS[folder], flat_hands=not SUBSETS[folder].flat_hands)
    place, models = write_sequence(tmp_path, cut(DRAGGED, 8), folder, subset=wrong)
    clip = read_clip(place, ReadOptions(body_models=models))
    people, written = clip.people[0], DRAGGED.people[0]
    apart = np.linalg.norm(people.joint_positions - written.joint_positions[:8], axis=-1).max(axis=0)
    assert apart[:22].max() < 1e-6
    assert apart[22:].max() > 5e-3


def test_parts_of_objects_are_objects(tmp_path):
    clip = cut(DRAGGED, 10)
    first = clip.objects[0]
    second = replace(first, positions=first.positions + np.array([0.3, 0.0, 0.1]), quats=first.quats[::-1])
    both = replace(clip, objects=(replace(first, name="drawer_base"), replace(second, name="drawer_part1")))
    names = {track.name: track.name for track in both.objects}
    place, models = write_sequence(tmp_path, both, "parahome", parts=names)
    assert not (place / "object.npz").exists()
    assert (tmp_path / "parahome" / "objects" / "drawer" / "part1.obj").is_file()
    again = read_clip(place, ReadOptions(body_models=models))
    assert_same_people(again, both)
    assert_same_objects(again, both)


@pytest.mark.parametrize(
    ("name", "shaped", "title"),
    [("x", "grab", "GRAB"), ("2025", "intercap", "InterCap"), ("mine", "parahome", "ParaHome")],
)
def test_shapes_tell_the_data_set_where_its_folder_does_not(tmp_path, name, shaped, title):
    clip = cut(DRAGGED, 8)
    place, models = write_sequence(tmp_path, clip, name, subset=SUBSETS[shaped])
    again = read_clip(place, ReadOptions(body_models=models))
    assert_same_people(again, clip)
    assert f"{title}, which alone has poses of" in again.source.notes[0]


@pytest.mark.parametrize("shaped", ["behave", "chairs", "omomo", "imhd", "neuraldome"])
def test_what_cannot_be_told_is_refused(tmp_path, shaped):
    place, models = write_sequence(tmp_path, cut(DRAGGED, 8), "mine", subset=SUBSETS[shaped])
    with pytest.raises(ClipError, match="which data set it is of cannot be told") as caught:
        read_clip(place, ReadOptions(body_models=models))
    assert SUBSETS[shaped].title in str(caught.value)


def test_first_word_of_the_folder_tells_the_data_set(tmp_path):
    clip = cut(DRAGGED, 8)
    place, models = write_sequence(tmp_path, clip, "omomo_correct_v2")
    assert_same_people(read_clip(place, ReadOptions(body_models=models)), clip)


def test_jaw_and_eyes_of_chairs_are_left_out(tmp_path):
    clip = cut(DRAGGED, 8)
    place, models = write_sequence(tmp_path, clip, "chairs")
    with np.load(place / "human.npz") as human:
        poses = np.concatenate([human["poses"], np.ones((8, 9))], axis=1)
    changed(place / "human.npz", poses=poses)
    assert_same_people(read_clip(place, ReadOptions(body_models=models)), clip)


def test_links_in_the_tree_are_followed_by_name(tmp_path, sequence, monkeypatch):
    place, models = sequence
    elsewhere = tmp_path / "disk"
    shutil.move(place.parent, elsewhere)
    place.parent.symlink_to(elsewhere)
    assert read_clip(place, ReadOptions(body_models=models)).name == "s1_clip"
    monkeypatch.chdir(place.parent)
    with pytest.raises(ReadError, match="it lies in a folder 'disk'"):
        read_clip(place.relative_to(place.parent), ReadOptions(body_models=models))


def test_a_name_without_its_folder_will_do(sequence, monkeypatch):
    place, models = sequence
    monkeypatch.chdir(place.parent)
    assert read_clip(place.relative_to(place.parent), ReadOptions(body_models=models)).name == "s1_clip"


def test_meshes_can_be_elsewhere(tmp_path, sequence):
    place, models = sequence
    shutil.move(place.parents[1] / "objects", tmp_path / "meshes")
    with pytest.raises(GeometryError, match=r"omomo/objects/suitcase/suitcase\.obj"):
        read_clip(place, ReadOptions(body_models=models))
    assert_same_objects(
        read_clip(place, ReadOptions(body_models=models, objects=tmp_path / "meshes")), cut(DRAGGED, 12)
    )


def test_only_canonical_sequences_are_read(tmp_path, sequence):
    place, models = sequence
    other = place.parents[1] / "sequences" / "s1_clip"
    shutil.copytree(place, other)
    with pytest.raises(ReadError, match=r"Name .*omomo/sequences_canonical/s1_clip"):
        read_clip(other, ReadOptions(body_models=models))
    (other / "smpl_fit_all.npz").touch()
    assert not READER.holds(SourceFile(other))
    assert READER.holds(SourceFile(place))
    assert not READER.holds(SourceFile(place.parent))


def test_outline_needs_neither_models_nor_meshes(sequence):
    place, _ = sequence
    shutil.rmtree(place.parents[1] / "objects")
    outline = READER.outline(SourceFile(place))
    assert (outline.frames, outline.fps, outline.fps_stated) == (12, 30.0, False)
    assert outline.skeleton == f"SMPL-X {GENDER}, 16 betas"
    assert outline.objects == ("suitcase",)
    assert "OMOMO" in outline.description


def turned(rotation):
    """Rotation vectors of the pelvis, all turned in the world."""
    return lambda poses: np.concatenate(
        [se3.log(se3.quat_multiply(se3.exp(np.array(rotation)), se3.exp(poses[:, :3]))), poses[:, 3:]], axis=1
    )


def spoiled(array):
    array = array.copy()
    array[3, 1] = np.nan
    return array


HUMAN, THING = "human.npz", "object.npz"


@pytest.mark.parametrize(
    ("file", "name", "change", "words"),
    [
        (HUMAN, "poses", None, "poses, the body's pose, is missing"),
        (HUMAN, "trans", None, "trans, the body's position, is missing"),
        (HUMAN, "betas", None, "betas, the body's shape, is missing"),
        (HUMAN, "gender", None, "gender, the body's gender, is missing"),
        (THING, "angles", None, "angles, the object's rotation, is missing"),
        (THING, "trans", None, "trans, the object's position, is missing"),
        (THING, "name", None, "name, what the object is called, is missing"),
        (HUMAN, "poses", lambda a: a[:, :90], "it has poses of 90 numbers with 16 betas, but OMOMO"),
        (HUMAN, "betas", lambda a: a[:10], "it has poses of 156 numbers with 10 betas, but OMOMO"),
        (HUMAN, "trans", lambda a: a[:, :2], r"trans, the body's position, has shape \(12, 2\)"),
        (HUMAN, "poses", lambda a: a[:11], "differ in their number of frames"),
        (THING, "angles", lambda a: a[:11], "differ in their number of frames"),
        (THING, "trans", lambda a: a[:11], r"trans, the object's position, has shape \(11, 3\)"),
        (HUMAN, "poses", spoiled, "poses, the body's pose, holds numbers that are not finite"),
        (THING, "trans", spoiled, "trans, the object's position, holds numbers that are not finite"),
        (HUMAN, "gender", lambda _: "robot", "no gender 'robot'"),
        (HUMAN, "poses", turned([np.pi / 2, 0, 0]), "stands along -?[xyz]"),
        (HUMAN, "poses", turned([0, 0, np.pi]), "stands along -z"),
        (HUMAN, "betas", lambda a: 40 * a, "m tall"),
        (THING, "arti", lambda _: np.zeros(12), "an object of parts with an angle"),
    ],
)
def test_what_is_wrong_is_told(sequence, file, name, change, words):
    place, models = sequence
    with np.load(place / file) as archive:
        value = None if change is None else change(archive.get(name))
    changed(place / file, **{name: value})
    with pytest.raises(ClipError, match=words) as caught:
        read_clip(place, ReadOptions(body_models=models))
    assert str(place) in str(caught.value)


@pytest.mark.parametrize("name", ["../secret", "..", "a/b", "C:\\x", ""])
def test_names_do_not_lead_out_of_the_folder(sequence, name):
    place, models = sequence
    changed(place / THING, name=np.array(name))
    with pytest.raises(ReadError, match="no plain name"):
        read_clip(place, ReadOptions(body_models=models))


def test_a_name_may_be_in_a_row(sequence):
    place, models = sequence
    changed(place / THING, name=np.array(["suitcase"]))
    assert_same_objects(read_clip(place, ReadOptions(body_models=models)), cut(DRAGGED, 12))


def test_two_files_of_one_object_are_refused(sequence):
    place, models = sequence
    for part in ("a", "b"):
        shutil.copy(place / THING, place / f"object_{part}.npz")
    (place / THING).unlink()
    with pytest.raises(ClipError, match="two of its files are of an object 'suitcase'"):
        read_clip(place, ReadOptions(body_models=models))


def test_too_few_frames_are_refused(tmp_path):
    place, models = write_sequence(tmp_path, cut(DRAGGED, 4), "omomo")
    assert read_clip(place, ReadOptions(body_models=models)).frames == 4
    for file, names in ((HUMAN, ("poses", "trans")), (THING, ("angles", "trans"))):
        with np.load(place / file) as archive:
            short = {name: archive[name][:3] for name in names}
        changed(place / file, **short)
    with pytest.raises(ClipError, match="too few frames"):
        read_clip(place, ReadOptions(body_models=models))


def test_models_must_be_there_and_right(tmp_path, sequence):
    place, models = sequence
    with pytest.raises(BodyModelError, match="male SMPL-X body model"):
        read_clip(place)
    with pytest.raises(BodyModelError, match="no such folder"):
        read_clip(place, ReadOptions(body_models=tmp_path / "absent"))
    changed(place / HUMAN, gender=np.array("female"))
    with pytest.raises(ReadError, match="no female smplx model"):
        read_clip(place, ReadOptions(body_models=models))
    shutil.copy(models / "SMPLX_MALE.npz", models / "SMPLH_MALE.npz")
    wrong, _ = write_sequence(tmp_path / "more", cut(DRAGGED, 8), "imhd")
    with pytest.raises(ReadError, match="55 joints, as smplx has"):
        read_clip(wrong, ReadOptions(body_models=models))


def test_an_object_that_is_named_needs_no_name(sequence):
    place, models = sequence
    with pytest.raises(ArgumentError, match="suitcase"):
        read_clip(place, ReadOptions(body_models=models, object_name="box"))


@pytest.mark.parametrize("file", [HUMAN, THING])
def test_damaged_archives_are_told(sequence, file):
    place, models = sequence
    (place / file).write_bytes((place / file).read_bytes()[:100])
    with pytest.raises(ReadError, match=rf"{file}: not a readable \.npz"):
        read_clip(place, ReadOptions(body_models=models))


def test_the_digest_is_of_all_files(sequence):
    place, models = sequence
    before = read_clip(place, ReadOptions(body_models=models)).source.sha256
    changed(place / THING, trans=np.zeros((12, 3)))
    assert read_clip(place, ReadOptions(body_models=models)).source.sha256 != before


@pytest.mark.parametrize(
    "name", ["CoRoleHOI.zip", "CoRoleHOI/seq1/motion.npz", "corolehoi/seq1/clip.pt", "CoRoleHOI/seq1"]
)
def test_an_undocumented_data_set_is_refused_with_the_ways_that_are_open(tmp_path, name):
    path = tmp_path / name
    if path.suffix:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(torch_bytes(np.zeros((3, 3))))
    else:
        path.mkdir(parents=True)
    with pytest.raises(ReadError, match=r"omomo_corole/sequences_canonical/ID, and clips of two people"):
        read_clip(path)
