"""InterMimic's clips of several objects: written and read back, real ones, and files that are damaged."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ClipError, GeometryError
from hoi_retarget.human.skeleton import FINGER_PARTS, PARTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers import intermimic_objects, read_clip
from hoi_retarget.readers.describe import inspect
from intermimic_writer import dictionary_of, random_clip, write_box
from torch_writer import torch_bytes

SHARED = Path(__file__).resolve().parents[1].parent / "shared" / "data"
GRAB = sorted((SHARED / "foreign" / "grab").glob("*.pt"))
REAL = sorted((SHARED / "parahome").glob("*.pt"))
NEEDS_SHARED = pytest.mark.skipif(not REAL, reason="no real recordings here")


def clip_of_two(seed: int = 0, frames: int = 12) -> Clip:
    """Return a clip of one person and two objects, every part touching both now and then."""
    clip, rng = random_clip(seed, frames), np.random.default_rng(seed)
    person, first = clip.people[0], clip.objects[0]
    second = ObjectTrack("cup_base", first.positions[::-1] + 0.3, first.quats[::-1], first.geometry)
    contacts = tuple(
        ContactTrack(0, index, part, rng.random(frames) < 0.5, track.to_object(person.part_position(part)))
        for index, track in enumerate((first, second))
        for part in PARTS
    )
    return replace(clip, name="clip", objects=(first, second), contacts=contacts)


@pytest.fixture
def folder(tmp_path):
    for name in ("box", "cup"):
        write_box(tmp_path / "objects", name)
    return tmp_path


def written(folder: Path, value: dict) -> Path:
    (folder / "clip.pt").write_bytes(torch_bytes(value))
    return folder / "clip.pt"


@pytest.mark.parametrize("turned", [True, False])
@pytest.mark.parametrize("seed", range(2))
def test_what_is_written_is_read(folder, seed, turned):
    clip = clip_of_two(seed)
    again = read_clip(written(folder, dictionary_of(clip, turned)), ReadOptions(objects=folder / "objects"))
    assert (again.name, again.fps, again.frames, again.first_source_frame) == ("clip", 30.0, clip.frames, 0)
    assert np.allclose(again.people[0].joint_positions, clip.people[0].joint_positions, atol=1e-6)
    assert np.allclose(again.people[0].joint_quats, clip.people[0].joint_quats, atol=1e-6)
    for new, old in zip(again.objects, clip.objects, strict=True):
        assert new.name == old.name
        assert np.allclose(new.positions, old.positions, atol=1e-6)
        assert np.allclose(new.quats, old.quats, atol=1e-6)
    for new, old in zip(without_fingers(again), clip.contacts, strict=True):
        assert (new.object, new.part) == (old.object, old.part)
        assert np.array_equal(new.active, old.active)
        assert np.allclose(new.contact_points, old.contact_points, atol=1e-5, equal_nan=True)


def without_fingers(clip):
    return [track for track in clip.contacts if track.part in PARTS]


def test_labels_of_fingers_are_their_contacts_unless_they_are_grades(folder):
    clip, value = clip_of_two(), dictionary_of(clip_of_two())
    read = read_clip(written(folder, value), ReadOptions(objects=folder / "objects"))
    fingers = [track for track in read.contacts if track.part in FINGER_PARTS]
    hands = {(track.object, track.part): track.active for track in clip.contacts}
    assert {track.part for track in fingers} == set(FINGER_PARTS)
    for track in fingers:  # The written files label all joints of a hand that touches.
        assert np.array_equal(track.active, hands[track.object, f"{track.part.split('_')[0]}_hand"])
    value["data"][3, 526 + 13 + 1] = 4.0
    graded = read_clip(written(folder, value), ReadOptions(objects=folder / "objects"))
    assert not [track for track in graded.contacts if track.part in FINGER_PARTS]


def test_what_is_not_taken_is_noted(folder):
    value = dictionary_of(clip_of_two())
    value["data"][:, 526 + 13] = 1.0  # the pelvis
    value["data"][3, 526 + 13 + 1] = 4.0
    value["metadata"] = {"scene": "s1", "interval_key": "0 9", "expression": "Sit", "contact_objects": ["pot_base"]}
    value["joints"] = {"lid": {"type": "hinge", "states": np.zeros(3)}}
    clip = read_clip(written(folder, value), ReadOptions(objects=folder / "objects"))
    notes = " ".join(clip.source.notes)
    for words in ("box is also touched by pelvis", "Labels 2 to 6", "two objects at once", "Sit", "pot_base", "lid"):
        assert words in notes
    assert "ParaHome" in clip.source.licence
    assert "not stated" in intermimic_objects.licence_of({})


def test_a_root_at_the_origin_of_the_body_model_is_no_contradiction(folder):
    """The bodies are where they are stored; a way to the pelvis that varies, or is too long, is refused."""
    clip, rest = clip_of_two(), np.array([0.003, -0.351, 0.012])
    value = dictionary_of(clip)
    value["data"][:, :3] -= rest.astype(np.float32)
    read = read_clip(written(folder, value), ReadOptions(objects=folder / "objects"))
    assert np.allclose(read.people[0].joint_positions, clip.people[0].joint_positions, atol=1e-6)
    assert "(0.003, -0.351, 0.012) m from the root in all frames" in " ".join(read.source.notes)
    for frames, shift in ((slice(3, 5), 0.002), (slice(None), 0.6)):
        wrong = {**value, "data": value["data"].copy()}
        wrong["data"][frames, 1] += shift
        with pytest.raises(ClipError, match="contradicts itself"):
            read_clip(written(folder, wrong), ReadOptions(objects=folder / "objects"))


def test_bodies_labels_count_only_where_the_objects_own_label_is_contact(folder):
    """GRAB's files repeat the labels of the held thing for the table, which nobody touches by its own label."""
    clip = clip_of_two()
    value = dictionary_of(clip)
    held, table = slice(526 + 13, 526 + 65), slice(526 + 65 + 13, 526 + 130)
    value["data"][:, table], value["data"][:, 526 + 65 + 12] = value["data"][:, held], 0.0
    read = read_clip(written(folder, value), ReadOptions(objects=folder / "objects"))
    for new, old in zip(without_fingers(read), clip.contacts, strict=True):
        assert np.array_equal(new.active, old.active & (old.object == 0))
    touched = np.any([track.active for track in clip.contacts if track.object == 0], axis=0).sum()
    assert f"cup_base is not touched in {touched} frame(s) by its own label" in " ".join(read.source.notes)


def test_leading_zero_frames_are_dropped_and_counted(folder):
    value = dictionary_of(clip_of_two())
    value["data"] = np.concatenate([np.zeros_like(value["data"][:2]), value["data"]])
    clip = read_clip(written(folder, value), ReadOptions(objects=folder / "objects"))
    assert (clip.frames, clip.first_source_frame) == (12, 2)


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        (200, np.nan, "body positions (columns 162:318) is not finite"),
        (318, 5.0, "body rotations"),
        (526 + 5, 3.0, "box: rotation (columns 529:533)"),
        (526 + 65 + 20, 0.5, "cup_base: body contact labels"),
        (526 + 20, 7.0, "from -1"),
        (0, 9.0, "the file contradicts itself"),
    ],
)
def test_damage_is_named(folder, column, value, words):
    content = dictionary_of(clip_of_two())
    content["data"][4, column] = value
    path = written(folder, content)
    with pytest.raises(ClipError) as caught:
        read_clip(path, ReadOptions(objects=folder / "objects"))
    assert str(path) in str(caught.value)
    assert words in str(caught.value)
    assert words in inspect(path, ReadOptions(objects=folder / "objects")).problems[0]


def test_rotations_that_fit_no_reading_are_refused(folder):
    clip = clip_of_two()
    person = clip.people[0]
    quats = se3.quat_multiply(person.joint_quats, se3.exp(np.array([0.0, 0.0, 1.5])))
    turned = replace(clip, people=(replace(person, joint_quats=quats),))
    with pytest.raises(ClipError, match="T-pose"):
        read_clip(written(folder, dictionary_of(turned)), ReadOptions(objects=folder / "objects"))


def test_what_must_be_told_is_told(folder):
    path = written(folder, dictionary_of(clip_of_two()))
    with pytest.raises(GeometryError, match="cup/cup"):
        read_clip(path)
    with pytest.raises(GeometryError, match="has no geometry"):
        (folder / "objects" / "box" / "box.obj").rename(folder / "box.obj")
        read_clip(path, ReadOptions(objects=folder / "objects"))
    with pytest.raises(ArgumentError, match="box, cup_base"):
        read_clip(path, ReadOptions(objects=folder / "objects", object_name="box"))
    twice = dictionary_of(clip_of_two()) | {"objects": ["box", "box"]}
    with pytest.raises(ClipError, match="one name"):
        read_clip(written(folder, twice), ReadOptions(objects=folder / "objects"))


@NEEDS_SHARED
@pytest.mark.parametrize("path", REAL, ids=[path.stem.split(",")[0] for path in REAL])
def test_real_clips_are_read(path):
    clip = read_clip(path, ReadOptions(objects=SHARED / "parahome" / "objects"))
    assert (len(clip.people), len(clip.objects), clip.fps) == (1, 3, 30.0)
    assert 1.4 < clip.people[0].height < 2.1
    assert "ParaHome" in clip.source.licence
    assert any("those of SMPL-X" in note for note in clip.source.notes)
    moving = [np.ptp(track.positions, axis=0).max() > 0.1 for track in clip.objects]
    assert moving == [True, False, False]
    assert {track.object for track in clip.contacts if track.active.any()} == {0}
    assert inspect(path, ReadOptions(objects=SHARED / "parahome" / "objects")).command


@pytest.mark.skipif(not GRAB, reason="GRAB's real files are not there")
@pytest.mark.parametrize("path", GRAB, ids=lambda path: path.stem)
def test_hands_of_grab_touch_what_they_hold_and_nothing_else(path):
    clip = read_clip(path, ReadOptions(objects=GRAB[0].parent / "objects"))
    touched = {clip.objects[track.object].name for track in clip.contacts if track.active.any()}
    assert touched == {path.stem.split("_")[1].split(",")[0]}
    assert not any("slips" in str(warning) for warning in clip.source.warnings)
