"""InterMimic's clips: written and read back, real ones, and every bad one that was thought of."""

import pickle
import re
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, GeometryError, ReadError
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT, PARTS
from hoi_retarget.numerics import se3
from hoi_retarget.readers import intermimic, read_clip
from hoi_retarget.readers.intermimic import FIELDS
from intermimic_writer import columns_of, random_clip, write_box, write_clip
from torch_writer import torch_bytes

SHARED = Path(__file__).resolve().parents[1].parent / "shared" / "data"
NEEDS_SHARED = pytest.mark.skipif(not SHARED.is_dir(), reason=f"no real recordings at {SHARED}")
REAL = sorted((SHARED / "omomo").glob("*.pt"))


@pytest.fixture
def folder(tmp_path):
    write_box(tmp_path / "objects", "box")
    return tmp_path


def refused(folder, matrix, error, *words, name="sub1_box_000.pt"):
    """Check that a clip of these columns raises this error, naming the file and these words."""
    path = folder / name
    path.write_bytes(torch_bytes(matrix))
    with pytest.raises(error) as caught:
        read_clip(path, ReadOptions(objects=folder / "objects"))
    for word in (str(path), *words):
        assert word in str(caught.value), str(caught.value)


# What is read


@pytest.mark.parametrize("seed", range(3))
def test_what_is_written_is_read(folder, seed):
    clip = random_clip(seed)
    write_clip(clip, folder / "sub1_box_000.pt")
    again = read_clip(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects"))
    assert (again.name, again.fps, again.frames, again.first_source_frame) == ("sub1_box_000", 30.0, clip.frames, 0)
    assert np.allclose(again.people[0].joint_positions, clip.people[0].joint_positions, atol=1e-6)
    assert np.allclose(again.people[0].joint_quats, clip.people[0].joint_quats, atol=1e-6)
    assert again.objects[0].name == "box"
    assert np.allclose(again.objects[0].positions, clip.objects[0].positions, atol=1e-6)
    assert np.allclose(again.objects[0].quats, clip.objects[0].quats, atol=1e-6)
    assert [contact.part for contact in again.contacts] == list(PARTS)
    for new, old in zip(again.contacts, clip.contacts, strict=True):
        assert np.array_equal(new.active, old.active)
        assert np.allclose(new.contact_points, old.contact_points, atol=1e-5, equal_nan=True)
    # Writing what was read changes nothing more.
    assert np.allclose(columns_of(again), columns_of(clip), atol=1e-6)


def test_the_source_is_recorded(folder):
    write_clip(random_clip(), folder / "sub1_box_000.pt")
    source = read_clip(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects")).source
    assert source.format == intermimic.FORMAT
    assert len(source.sha256) == 64
    assert "MIT" in source.licence
    assert "CC BY-NC-SA" in source.licence
    assert any("file name" in note for note in source.notes)


def test_fingers_three_places_late_are_put_right(folder):
    clip = random_clip()
    write_clip(clip, folder / "sub1_box_000.pt", late_fingers=True)
    again = read_clip(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects"))
    # The lost right thumb mirrors the left one, as it does in the clip that was written.
    assert np.allclose(again.people[0].joint_positions, clip.people[0].joint_positions, atol=1e-5)
    assert any("three places late" in note for note in again.source.notes)


def test_leading_zero_frames_are_dropped_and_counted(folder):
    matrix = columns_of(random_clip())
    (folder / "sub1_box_000.pt").write_bytes(torch_bytes(np.concatenate([np.zeros_like(matrix[:2]), matrix])))
    clip = read_clip(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects"))
    assert (clip.frames, clip.first_source_frame) == (len(matrix), 2)
    assert any("2 leading" in note for note in clip.source.notes)


def test_disagreeing_labels_are_counted(folder):
    matrix = columns_of(random_clip())
    contact = matrix[:, FIELDS["object contact label"]][:, 0] == 1
    matrix[:, FIELDS["object contact label"]] = 0
    matrix[~contact, 330] = 1
    (folder / "sub1_box_000.pt").write_bytes(torch_bytes(matrix))
    notes = " ".join(read_clip(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects")).source.notes)
    assert f"{contact.sum()} frame(s) label a body in contact, but not the object" in notes
    if (~contact).any():
        assert f"{(~contact).sum()} frame(s) label the object in contact, but no body" in notes


@pytest.mark.parametrize(
    ("file", "name", "expected"),
    [
        ("sub12_mop_top_003.pt", None, "mop_top"),
        ("sub1_box_2_000.pt", None, "box_2"),
        ("sub1_sub2_3_000.pt", None, "sub2_3"),
        ("anything.pt", "box", "box"),
        ("sub1_other_000.pt", "box", "box"),
        ("scaled_sub1_box_2_000.pt", None, "box_2"),
    ],
)
def test_the_object_is_named_by_argument_or_file(folder, file, name, expected):
    write_box(folder / "objects", expected)
    write_clip(random_clip(), folder / file)
    clip = read_clip(folder / file, ReadOptions(objects=folder / "objects", object_name=name))
    assert clip.objects[0].name == expected


# What is refused


def test_missing_empty_and_cut_files(folder):
    with pytest.raises(ReadError, match="no such file"):
        read_clip(folder / "sub1_box_000.pt")
    (folder / "sub1_box_000.pt").write_bytes(b"")
    with pytest.raises(ReadError, match="empty"):
        read_clip(folder / "sub1_box_000.pt")
    content = torch_bytes(columns_of(random_clip()))
    (folder / "sub1_box_000.pt").write_bytes(content[: len(content) // 2])
    with pytest.raises(ReadError, match="damaged or cut off"):
        read_clip(folder / "sub1_box_000.pt")


def test_other_content_than_one_tensor(folder):
    refused(folder, [1, 2], ReadError, "holds a list", "one tensor of 591 columns")
    refused(folder, {"a": 1}, ReadError, "a dictionary ('a')")
    refused(folder, np.zeros(591), ReadError, "shape (591,)")
    refused(folder, np.zeros((10, 591), dtype=int), ReadError, "type int64")
    refused(folder, {"data": np.zeros((9, 721)), "objects": ["a", "b"]}, ReadError, "multi-object", "3 object(s)")


@pytest.mark.parametrize(
    ("columns", "words"),
    [(337, "SkillMimic"), (656, "2 objects"), (721, "3 objects"), (100, "no layout known"), (0, "0 columns")],
)
def test_other_numbers_of_columns(folder, columns, words):
    refused(folder, np.zeros((10, columns)), ReadError, f"has {columns} columns", words, "expected one tensor of 591")


def test_the_multi_object_layout_of_one_object_has_591_columns_too(folder):
    matrix = columns_of(random_clip())
    other = matrix.copy()
    other[:, 318:526] = matrix[:, FIELDS["body rotations"]]
    other[:, 526:533] = matrix[:, 318:325]
    other[:, 538:591] = matrix[:, 330:383]
    refused(folder, other, ReadError, "multi-object layout")


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
def test_too_few_frames(folder, frames):
    matrix = columns_of(random_clip())
    refused(folder, matrix[:frames], ClipError, f"recording: {frames}", "at least 4")
    refused(
        folder, np.concatenate([np.zeros_like(matrix), matrix[:frames]]), ClipError, "12 of them zero", "at least 4"
    )


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e20])
@pytest.mark.parametrize("field", FIELDS)
def test_numbers_that_are_none(folder, field, value):
    matrix = columns_of(random_clip())
    matrix[[3, 7], FIELDS[field].start] = value
    refused(folder, matrix, ClipError, field, f"columns {FIELDS[field].start}:", "2 frames (3, 7)")


def test_zero_frames_in_the_middle(folder):
    matrix = columns_of(random_clip())
    matrix[5:7] = 0.0
    refused(folder, np.concatenate([np.zeros_like(matrix[:1]), matrix]), ClipError, "2 frames (6, 7)", "in the middle")
    ended = np.concatenate([columns_of(random_clip()), np.zeros_like(matrix[:2])])
    refused(folder, ended, ClipError, "2 frames (12, 13) at the end", "tensor[:12]")


def test_other_layouts_come_with_advice(folder):
    refused(folder, columns_of(random_clip())[:, :590], ReadError, "590 columns", "interact2mimic.py")
    refused(folder, 3, ReadError, "an int", "interact2mimic.py")


def test_a_plain_pickle_is_called_so_with_what_it_imports(folder):
    for protocol in (2, 4):
        for value, words in ((Path("x"), "pathlib."), ({"a": 1}, "refused: it could run code")):
            (folder / "sub1_box_000.pt").write_bytes(pickle.dumps(value, protocol=protocol))
            with pytest.raises(ReadError, match="plain Python pickle, refused") as caught:
                read_clip(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects"))
            assert words in str(caught.value)


@pytest.mark.parametrize("field", ["root rotation", "object rotation", "body rotations"])
def test_rotations_that_are_none(folder, field):
    matrix = columns_of(random_clip())
    matrix[4, FIELDS[field].start : FIELDS[field].start + 4] = 0.0
    refused(folder, matrix, ClipError, field, "1 frame (4)", "is zero", "unit quaternions")
    matrix[4, FIELDS[field].start] = 2.0
    refused(folder, matrix, ClipError, field, "1 frame (4)", "length 2")


def test_a_zero_rotation_names_its_body(folder):
    matrix = columns_of(random_clip())
    matrix[4, 383 + 4 * 13 : 383 + 4 * 14] = 0.0
    refused(folder, matrix, ClipError, "of head")


def test_labels_that_mean_nothing(folder):
    matrix = columns_of(random_clip())
    matrix[2, 340], matrix[9, 341] = 2.0, 0.5
    refused(folder, matrix, ClipError, "body contact labels", "0.5, 2", "2 frames (2, 9)", "-1 (far)")
    matrix = columns_of(random_clip())
    matrix[1, 330] = 7.0
    refused(folder, matrix, ClipError, "object contact label", "value(s) 7", "1 frame (1)")


def test_a_root_that_is_not_the_pelvis(folder):
    matrix = columns_of(random_clip())
    matrix[3, 0] += 0.01
    refused(folder, matrix, ClipError, "0.01 m apart", "1 frame (3)", "contradicts itself")
    matrix = columns_of(random_clip())
    matrix[3, 3:7] = matrix[4, 3:7]
    refused(folder, matrix, ClipError, "root rotation", "deg in 1 frame (3)", "contradicts itself")


def test_fingers_that_belong_to_no_hand(folder):
    matrix = columns_of(random_clip())
    body = FIELDS["body positions"].start
    matrix[5, body + 3 * 18 : body + 3 * 19] += 1.0
    refused(folder, matrix, ClipError, "m from their wrists", "1 frame (5)")


def test_objects_that_cannot_be_had(folder):
    write_clip(random_clip(), folder / "sub1_box_000.pt")
    with pytest.raises(GeometryError, match=r"--objects DIR with box/box\.obj"):
        read_clip(folder / "sub1_box_000.pt")
    with pytest.raises(GeometryError, match="Did you mean 'box'"):
        read_clip(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects", object_name="boxx"))
    write_clip(random_clip(), folder / "clip.pt")
    with pytest.raises(GeometryError, match="--object NAME"):
        read_clip(folder / "clip.pt", ReadOptions(objects=folder / "objects"))


def test_other_files_are_refused_with_what_is_supported(folder):
    for name in ("clip.csv", "clip"):
        (folder / name).write_bytes(b"1,2")
        with pytest.raises(ReadError, match=re.escape("*.pt (intermimic-591")):
            read_clip(folder / name)


# Real recordings

HEIGHTS = {1: 1.66, 2: 1.84, 3: 1.94, 4: 1.79, 5: 1.82, 6: 1.76, 7: 1.81, 8: 1.85, 9: 1.75, 10: 1.65}


@NEEDS_SHARED
@pytest.mark.parametrize("path", REAL, ids=[path.stem for path in REAL])
def test_a_real_clip_follows_the_conventions(path):
    clip = read_clip(path, ReadOptions(objects=SHARED / "objects"))
    person = clip.people[0]
    subject = int(re.fullmatch(r"sub(\d+)_.*", path.stem)[1])
    assert abs(person.height - HEIGHTS[subject]) < 0.025
    bones = {}
    for joint, parent in PARENT.items():
        if parent is not None:
            offset = person.position(joint) - person.position(parent)
            bone = se3.rotate_inverse(person.quat(parent), offset)
            assert np.abs(bone - bone.mean(axis=0)).max() < 1e-5, (parent, joint)
            bones[joint] = bone.mean(axis=0) / np.linalg.norm(bone.mean(axis=0))
    # The T-pose of SMPL-X: stands along +y, looks along +z, its left is +x.
    for joint, direction in (
        ("left_knee", (0, -1, 0)),
        ("right_ankle", (0, -1, 0)),
        ("spine2", (0, 1, 0)),
        ("left_elbow", (1, 0, 0)),
        ("right_elbow", (-1, 0, 0)),
        ("left_middle1", (1, 0, 0)),
        ("right_middle1", (-1, 0, 0)),
    ):
        assert bones[joint] @ direction > 0.9, joint
    assert bones["left_foot"][2] > 0.8
    # Fingers lie beside each other, the index in front.
    for side in ("left", "right"):
        order = [bones[f"{side}_{finger}1"][2] for finger in ("index", "middle", "ring", "pinky")]
        assert order == sorted(order, reverse=True)
    assert person.joint_positions[..., 2].min() > -0.03
    assert any(contact.active.any() for contact in clip.contacts)
    for contact in clip.contacts[:2]:
        points = contact.contact_points[contact.active]
        size = np.abs(clip.objects[0].geometry.points).max()
        assert len(points) == 0 or np.abs(points).max() < size + 0.2


@NEEDS_SHARED
def test_all_real_clips_are_there():
    assert len(REAL) == 33


def test_joint_orders_cover_each_other():
    matrix = columns_of(random_clip())
    assert matrix.shape[1] == 591
    assert sorted(JOINT_INDEX[name] for name in JOINTS) == list(range(52))


@pytest.mark.parametrize(
    ("name", "stature"),
    [
        ("sub1_largebox_000", "subject 1 1.66 m"),
        ("scaled_sub17_largebox_000", "subject 17 1.74 m"),
        ("sub8_largebox_000", ""),
        ("sub18_largebox_000", ""),
        ("sub1_ball_000", ""),
    ],
)
def test_a_skeleton_of_another_stature_than_the_subject_is_noted(folder, name, stature):
    for item in ("largebox", "ball"):
        write_box(folder / "objects", item)
    write_clip(random_clip(), folder / f"{name}.pt")  # 1.89 m tall; subject 8 is 1.845 m.
    notes = read_clip(folder / f"{name}.pt", ReadOptions(objects=folder / "objects")).source.notes
    said = " ".join(note for note in notes if "m tall" in note)
    assert (stature in said) if stature else not said


def test_first_frames_with_labels_alone_hold_no_data(folder):
    matrix = columns_of(random_clip())
    empty = np.zeros_like(matrix[:1])
    empty[:, FIELDS["body contact labels"]] = -1.0
    (folder / "sub1_box_000.pt").write_bytes(torch_bytes(np.concatenate((empty, matrix))))
    clip = read_clip(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects"))
    assert (clip.frames, clip.first_source_frame) == (len(matrix), 1)
