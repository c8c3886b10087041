"""GRAB's recordings: written and read back, their conventions, and what is refused."""

import os
from dataclasses import replace

import numpy as np
import pytest

from grab_writer import (
    FINGERS,
    MESHES,
    OBJECT,
    PALMS,
    TEMPLATE,
    VERTICES,
    clip_on_table,
    members_of,
    write_members,
    write_model,
    write_tools,
)
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, BodyModelError, ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.skeleton import FINGER_PARTS, PARTS
from hoi_retarget.numerics import se3
from hoi_retarget.readers import can_be_clip, grab, read_clip
from source_people import assert_same_objects, assert_same_people, in_world

CLIP = clip_on_table()
FRAMES = CLIP.frames
MEMBERS, MODEL = members_of(CLIP)


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    return write_model(tmp_path_factory.mktemp("grab_models"), MODEL)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp("grab_tree")
    write_tools(folder, CLIP, MODEL)
    return folder


def changed(where: str, **values) -> dict:
    """What the file holds with other values in one of its tables, such as `body/params`; None leaves one out."""

    def within(table: dict, steps: list[str]) -> dict:
        if steps:
            return table | {steps[0]: within(table[steps[0]], steps[1:])}
        return {name: value for name, value in (table | values).items() if value is not None}

    return within(MEMBERS, [step for step in where.split("/") if step])


def test_what_is_written_is_read(root, models):
    clip = read_clip(write_members(root, MEMBERS), ReadOptions(body_models=models))
    assert_same_people(clip, CLIP)
    assert_same_objects(clip, CLIP)
    assert (clip.name, clip.fps, clip.frames) == ("s1_stool_lift", 120.0, FRAMES)
    assert (clip.source.format, len(clip.source.sha256)) == ("grab", 64)
    assert "non-commercial" in clip.source.licence
    assert clip.source.notes == ("Contact is labelled for the object only, not for the table.",)
    # Meshes are not centred: points are where they are in the files.
    assert np.allclose(clip.objects[0].geometry.points, CLIP.objects[0].geometry.points, atol=1e-7)
    assert np.ptp(clip.objects[1].positions, axis=0).max() == 0.0


def test_contacts_are_those_that_the_object_is_labelled_with(root, models, monkeypatch):
    monkeypatch.setattr(grab, "_ROWS", 50)  # Looked at piece by piece.
    clip = read_clip(write_members(root, MEMBERS), ReadOptions(body_models=models))
    fingers = [part for part in FINGER_PARTS if FINGERS.get(f"{part.split('_')[0]}_hand") in labels_of(part)]
    assert [(it.object, it.part) for it in clip.contacts] == [(0, part) for part in (*PARTS, *fingers)]
    active = {track.part: track.active for track in CLIP.contacts}
    for track in (track for track in clip.contacts if track.part in PARTS):
        assert np.array_equal(track.active, active.get(track.part, np.zeros(FRAMES, dtype=bool)))
        places = clip.objects[0].to_object(clip.people[0].part_position(track.part))
        assert np.array_equal(track.contact_points[track.active], places[track.active])
    assert active["left_hand"].sum() > 60


def labels_of(part):
    """The labels of a finger: its last two joints."""
    return [grab.LABELLED_JOINTS.index(f"{part}{joint}") + 1 for joint in (2, 3)]


def test_labels_name_the_joints_of_smplx_counted_from_one():
    # As the makers' table has them.
    names = {
        1: "pelvis",
        9: "right_ankle",
        11: "left_foot",
        16: "head",
        22: "right_wrist",
        23: "jaw",
        26: "left_index1",
    }
    names |= {32: "left_pinky1", 35: "left_ring1", 38: "left_thumb1", 41: "right_index1", 55: "right_thumb3"}
    assert {label: grab.LABELLED_JOINTS[label - 1] for label in names} == names
    assert len(grab.LABELLED_JOINTS) == 55


@pytest.mark.parametrize(
    ("label", "part"),
    [
        *((label, part) for labels in (PALMS, FINGERS) for part, label in labels.items()),
        (26, "left_hand"),
        (40, "left_hand"),
        (41, "right_hand"),
        (55, "right_hand"),
        (8, "left_foot"),
        (11, "left_foot"),
        (9, "right_foot"),
        (12, "right_foot"),
        (16, None),
        (19, None),
        (23, None),
    ],
)
def test_every_label_means_its_part(root, models, label, part):
    labels = np.zeros((FRAMES, VERTICES), dtype=np.int64)
    labels[3:5, 4] = label
    clip = read_clip(write_members(root, changed("contact", object=labels)), ReadOptions(body_models=models))
    touching = {track.part: track.active.nonzero()[0].tolist() for track in clip.contacts if track.active.any()}
    fingers = {name: [3, 4] for name in FINGER_PARTS if label in labels_of(name)}
    assert touching == ({part: [3, 4], **fingers} if part else {})
    assert any("is also touched by" in note for note in clip.source.notes) == (part is None)


def test_rotations_are_stored_the_wrong_way_round(root, models):
    turns = np.tile([0.0, 0.0, np.pi / 2], (FRAMES, 1))
    members = changed("table/params", global_orient=turns)
    clip = read_clip(write_members(root, members), ReadOptions(body_models=models))
    assert np.allclose(se3.rotate(clip.objects[1].quats[0], np.array([1.0, 0, 0])), [0.0, -1.0, 0.0])


def test_objects_that_are_stored_the_right_way_round_are_refused(root, models):
    with pytest.raises(ClipError, match="with inverse rotations, contact points wander"):
        read_clip(write_members(root, members_of(turning(), inverted=False)[0]), ReadOptions(body_models=models))


def turning():
    """The clip with its object turning in the left hand, so that the grasp tells its rotations."""
    left, track = CLIP.people[0].part_position("left_hand"), CLIP.objects[0]
    angles = np.linspace(0.0, 2.5, FRAMES)
    quats = se3.exp(np.stack([0 * angles, 0 * angles, angles], axis=1))
    positions = left - se3.rotate(quats, np.tile([0.3, 0.1, 0.2], (FRAMES, 1)))
    moved = replace(track, positions=positions, quats=quats)
    contacts = tuple(
        replace(it, active=np.full(FRAMES, it.part == "left_hand"), contact_points=np.zeros((FRAMES, 3)))
        for it in CLIP.contacts
    )
    return replace(CLIP, objects=(moved, CLIP.objects[1]), contacts=contacts)


def test_meshes_and_bodies_are_found_by_their_plain_names(root, models, tmp_path):
    path = write_members(tmp_path, MEMBERS)
    with pytest.raises(ReadError, match=r"subject's own body is missing, looked for .*male/s1\.ply"):
        read_clip(path, ReadOptions(body_models=models))
    (tmp_path / "grab" / "tools" / "subject_meshes").mkdir(parents=True)
    os.link(root / TEMPLATE, tmp_path / "grab" / "tools" / "subject_meshes" / "s1.ply")
    with pytest.raises(GeometryError, match=r"contact_meshes/stool\.ply"):
        read_clip(path, ReadOptions(body_models=models))
    for objects in (root / MESHES, (root / MESHES).parent):
        assert_same_objects(read_clip(path, ReadOptions(objects=objects, body_models=models)), CLIP)
    with pytest.raises(GeometryError, match=r"stool\.ply"):
        read_clip(write_members(root, MEMBERS), ReadOptions(objects=tmp_path, body_models=models))


def test_the_subjects_body_counts_into_the_digest(root, models, tmp_path):
    first = read_clip(write_members(root, MEMBERS), ReadOptions(body_models=models))
    path = write_members(tmp_path, MEMBERS)
    write_tools(tmp_path, CLIP, MODEL | {"v_template": 1.01 * MODEL["v_template"]})
    second = read_clip(path, ReadOptions(body_models=models))
    assert first.source.sha256 != second.source.sha256
    assert second.people[0].height == pytest.approx(1.01 * first.people[0].height)


def test_what_it_holds_is_told_without_models(root):
    path = write_members(root, MEMBERS)
    assert can_be_clip(path)
    outline = grab.READER.outline
    assert outline is not None
    facts = outline(SourceFile(path))
    assert (facts.frames, facts.fps, facts.fps_stated, facts.objects) == (FRAMES, 120.0, True, (OBJECT, "table"))
    assert facts.skeleton == "SMPL-X male, with the body of subject s1"
    with pytest.raises(BodyModelError, match="male SMPL-X body model"):
        read_clip(path)
    with pytest.raises(ArgumentError, match="this one names stool, table"):
        read_clip(path, ReadOptions(object_name="chair"))


LABELS = MEMBERS["contact"]["object"]


@pytest.mark.parametrize(
    ("members", "words"),
    [
        (changed("body/params", transl=None), "body/params/transl, the body's position, is missing"),
        (changed("body/params", body_pose=np.zeros((FRAMES, 3, 21))), r"body_pose.* has shape \(301, 3, 21\)"),
        (changed("body/params", transl=np.full((FRAMES, 3), np.nan)), "transl.*not finite"),
        (changed("body/params", left_hand_pose=np.zeros((FRAMES, 45))), r"left_hand_pose.*expected \(301, 24\)"),
        (changed("", n_comps=50), r"left_hand_pose.*expected \(301, 50\)"),
        (changed("body/params", transl=np.zeros((300, 3))), r"has shape \(301, 3\), expected \(300, 3\)"),
        (changed("body/params", transl=np.zeros((2, 3))), r"too few frames \(recording: 2\)"),
        (changed("", framerate=None), "framerate, frames a second, is missing"),
        (changed("", framerate=0.0), "the rate is 0.0"),
        (changed("", framerate="fast"), "framerate.*expected numbers"),
        (changed("", gender="unknown"), "gender is 'unknown', expected neutral or male or female"),
        (changed("", gender="../.."), "gender is '../..', expected neutral"),
        (changed("", gender=1.0), "gender.* is ndarray, expected a text"),
        (changed("body", vtemp="tools/.."), "names '..', which is no plain name"),
        (changed("body", vtemp="tools\\x.ply"), "which is no plain name"),
        (changed("body", vtemp="tools/s99.ply"), r"looked for .*male/s99\.ply"),
        (
            changed("body", vtemp=f"{MESHES}/../../subject_meshes/male/s1.ply", params=[]),
            "params.*expected a dictionary",
        ),
        (changed("object", object_mesh=None), "object/object_mesh, the mesh's file, is missing"),
        (changed("object", object_mesh="tools/"), "looked for .*/tools"),
        (changed("object/params", global_orient=np.zeros((FRAMES - 1, 3))), r"object/params/global_orient.*\(300, 3\)"),
        (changed("", table=None), "table, the table, is missing"),
        (changed("", contact=None), "contact/object, which part touches each vertex, is no table"),
        (changed("contact", object=LABELS.astype(float)), "is no table of whole numbers"),
        (changed("contact", object=LABELS[:, 0]), "is no table of whole numbers"),
        (changed("contact", object=LABELS[1:]), "contact/object has 300 frames, the recording 301"),
        (changed("contact", object=LABELS + 10), "has labels from 10 to 56, expected 0 to 55"),
        (changed("contact", object=LABELS - 1), "has labels from -1"),
        (members_of(in_world(CLIP, "y"))[0], "stands along -?y, turned to z up from z up"),
    ],
)
def test_what_cannot_be_used_is_refused(root, models, members, words):
    with pytest.raises((ClipError, ReadError, GeometryError), match=words):
        read_clip(write_members(root, members), ReadOptions(body_models=models))


def test_a_template_of_another_body_is_refused(root, models, tmp_path):
    path = write_members(tmp_path, MEMBERS)
    write_tools(tmp_path, CLIP, MODEL | {"v_template": MODEL["v_template"][:-4], "f": MODEL["f"][:4]})
    with pytest.raises(ClipError, match="own body has 216 vertices, the male SMPL-X body model 220"):
        read_clip(path, ReadOptions(body_models=models))
    (tmp_path / TEMPLATE).write_bytes(b"no mesh")
    with pytest.raises(GeometryError, match="not a readable mesh"):
        read_clip(path, ReadOptions(body_models=models))


def test_what_would_be_executed_is_refused(root, models):
    class Payload:
        def __reduce__(self):
            return os.system, ("false",)

    path = write_members(root, MEMBERS | {"contact": {"object": Payload()}})
    with pytest.raises(ReadError, match="contact cannot be read"):
        read_clip(path, ReadOptions(body_models=models))
