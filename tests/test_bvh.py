"""BVH: forward kinematics of any tree, people on known rigs written and read back, and files that do not fit."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bvh_writer import (
    LAFAN1,
    MIXAMO,
    MIXAMO_FINGERS,
    SMPL,
    SOMA,
    SOMA_FINGERS,
    XSENS,
    Bone,
    Rig,
    bvh_text,
    depth_first,
    hanging_arms,
    lafan1_axes,
    write_person,
)
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.files.bvh_file import parse_bvh
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.skeleton import JOINTS
from hoi_retarget.numerics import se3
from hoi_retarget.readers import read_clip, reader_of
from hoi_retarget.readers.open import open_clip
from people_writer import alone
from short_clips import cut
from source_people import assert_same_people

WALK = alone("carry_box")
SHORT = cut(WALK, 60, first=40)
PATH = Path("a.bvh")
ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
LAFAN1_RIG = Rig(LAFAN1, axes=lafan1_axes(), order="ZYX", root_between_hips=True)
RIGS = {
    "LAFAN1": LAFAN1_RIG,
    "Mixamo with fingers": Rig(MIXAMO | MIXAMO_FINGERS, prefix="mixamorig:", top=0.18),
    "Mixamo with hanging arms": Rig(MIXAMO | MIXAMO_FINGERS, axes=hanging_arms(), order="XYZ"),
    "Mixamo in metres, z up": Rig(MIXAMO, prefix="Model_", unit=1.0, up="z"),
    "Xsens": Rig(XSENS, order="YXZ", unit=0.001),
    "SMPL": Rig(SMPL, order="XZY", unit=1.0),
    "SOMA": Rig(SOMA | SOMA_FINGERS, top=0.18),
    "inches": Rig(MIXAMO, unit=0.0254),
    "CMU's unit": Rig(MIXAMO, unit=0.0254 / 0.45),
}


@st.composite
def trees(draw):
    """Any tree of bones, with positions and angles of some frames."""
    count, frames = draw(st.integers(1, 7)), draw(st.integers(1, 3))
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    bones = [
        Bone(
            f"bone {index}",
            draw(st.integers(0, index - 1)) if index else -1,
            rng.normal(size=3),
            draw(st.sampled_from(ORDERS)),
            moves=draw(st.booleans()),
            end=rng.normal(size=3) if draw(st.booleans()) else None,
        )
        for index in range(count)
    ]
    return bones, rng.normal(size=(count, frames, 3)), rng.uniform(-400.0, 400.0, size=(frames, count, 3))


@given(trees())
@settings(deadline=None)
def test_joints_are_where_matrices_put_them(tree):
    bones, positions, angles = tree
    motion = parse_bvh(bvh_text(bones, dict(enumerate(positions)), angles, digits=12).encode(), PATH)
    places, quats = motion.poses()
    order = depth_first(bones)
    for frame in range(len(angles)):
        worlds = {}
        for index in order:
            bone = bones[index]
            local = np.eye(4)
            local[:3, :3] = Rotation.from_euler(bone.order, angles[frame, index], degrees=True).as_matrix()
            local[:3, 3] = positions[index][frame] if bone.moves else bone.offset
            worlds[index] = local if bone.parent < 0 else worlds[bone.parent] @ local
            joint = motion.names.index(bone.name)
            np.testing.assert_allclose(places[frame, joint], worlds[index][:3, 3], atol=1e-8)
            np.testing.assert_allclose(se3.quat_to_matrix(quats[frame, joint]), worlds[index][:3, :3], atol=1e-8)
            if bone.end is not None:
                end = motion.names.index(f"{bone.name} end")
                np.testing.assert_allclose(places[frame, end], (worlds[index] @ [*bone.end, 1.0])[:3], atol=1e-8)


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)
def test_a_person_as_written_is_the_person_read(tmp_path, rig):
    clip = read_clip(write_person(tmp_path / "walk.bvh", SHORT, rig))
    made, read = SHORT.people[0], clip.people[0]
    joints = [index for index, joint in enumerate(JOINTS) if joint in rig.names]
    # LAFAN1's spine has a bone less than the person's, which bends a little there.
    tolerance = 5e-3 if rig is LAFAN1_RIG else 1e-6
    np.testing.assert_allclose(read.joint_positions[:, joints], made.joint_positions[:, joints], atol=tolerance)
    assert se3.angle_between(read.joint_quats[:, joints], made.joint_quats[:, joints]).max() < 1e-6
    assert read.fingers_recorded == ("left_index1" in rig.names)
    assert (clip.name, clip.fps, clip.objects, clip.contacts) == ("walk", 30.0, (), ())
    assert reader_of(SourceFile(tmp_path / "walk.bvh")).format == clip.source.format == "bvh"
    assert any(f"{rig.up} is up: the person stands along it" in note for note in clip.source.notes)
    unit = {0.01: "a centimetre", 1.0: "a metre", 0.001: "a millimetre", 0.0254: "an inch"}.get(rig.unit, "0.05644 m")
    assert any(note.startswith(f"A unit of length is {unit}") for note in clip.source.notes)


@given(order=st.sampled_from(ORDERS), degrees=st.floats(0.0, 95.0), unit=st.sampled_from([1.0, 0.01, 0.001]))
@settings(max_examples=6, deadline=None)
def test_neither_orders_nor_rest_poses_nor_units_matter(tmp_path_factory, order, degrees, unit):
    rig = Rig(MIXAMO | MIXAMO_FINGERS, axes=hanging_arms(degrees), order=order, unit=unit)
    clip = read_clip(write_person(tmp_path_factory.mktemp("bvh") / "walk.bvh", cut(SHORT, 5), rig))
    assert_same_people(clip, cut(SHORT, 5))


def test_the_root_may_be_far_from_its_offset(tmp_path):
    """Position channels stand for the offset: LAFAN1 has the first frame's place there, others have zero."""
    path = write_person(tmp_path / "walk.bvh", SHORT, RIGS["Xsens"])
    text = path.read_text()
    path.write_text(re.sub("OFFSET .*", "OFFSET 100.0 -2.0 3e2", text, count=1))
    assert_same_people_of_body(read_clip(path), SHORT)
    assert "OFFSET 100.0" in path.read_text()


def assert_same_people_of_body(read, made):
    body = slice(22)
    np.testing.assert_allclose(
        read.people[0].joint_positions[:, body], made.people[0].joint_positions[:, body], atol=1e-6
    )


def test_a_foot_without_toes_has_an_end(tmp_path):
    path = write_person(tmp_path / "walk.bvh", SHORT, RIGS["Xsens"])
    whole = read_clip(path)
    text = path.read_text()
    for side in ("Left", "Right"):
        text = re.sub(rf"JOINT {side}Toe\n(\s*{{\n\s*OFFSET .*\n)\s*CHANNELS.*\n", r"End Site\n\1", text)
    rows = text.split("MOTION\n")[1].splitlines()
    names = re.findall(r"(?:ROOT|JOINT) (\w+)", path.read_text())
    gone = [3 + 3 * names.index(f"{side}Toe") + axis for side in ("Left", "Right") for axis in range(3)]
    table = [[number for column, number in enumerate(row.split()) if column not in gone] for row in rows[2:]]
    motion = [*rows[:2], *(" ".join(row) for row in table)]
    path.write_text(text.split("MOTION\n")[0] + "\n".join(["MOTION", *motion]))
    np.testing.assert_allclose(
        read_clip(path).people[0].position("left_foot"), whole.people[0].position("left_foot"), atol=1e-9
    )


def test_the_stature_is_that_of_the_rest_pose_where_its_head_has_a_top(tmp_path):
    person = SHORT.people[0]
    top = read_clip(write_person(tmp_path / "walk.bvh", SHORT, Rig(MIXAMO, top=0.2))).people[0]
    without = read_clip(write_person(tmp_path / "walk.bvh", SHORT, Rig(MIXAMO))).people[0]
    assert without.height == pytest.approx(person.height)
    chain = [person.position(joint)[0] for joint in ("left_hip", "left_knee", "left_ankle")]
    leg = sum(np.linalg.norm(np.diff(chain, axis=0), axis=1))
    trunk = np.linalg.norm(person.position("head") - person.position("pelvis"), axis=1).max()
    assert leg + trunk + 0.2 < top.height < leg + trunk + 0.2 + 0.15


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("raised", [0.0, 0.4])
def test_the_floor_is_where_toes_stand(tmp_path, up, raised):
    (person,) = WALK.people
    lifted = replace(WALK, people=(replace(person, joint_positions=person.joint_positions + np.array([0, 0, raised])),))
    clip = open_clip(write_person(tmp_path / "walk.bvh", lifted, Rig(MIXAMO, up=up)))
    heights = clip.people[0].position("left_foot")[:, 2]
    assert abs(np.percentile(heights, 20)) < 0.005
    asked = open_clip(tmp_path / "walk.bvh", ReadOptions(floor=raised))
    np.testing.assert_allclose(asked.people[0].position("head"), person.position("head"), atol=1e-6)


@pytest.mark.parametrize(
    ("text", "rate"),
    {
        "0.033333": 30.0,
        "0.0333333": 30.0,
        "0.033": 30.0,
        "0.008333": 120.0,
        "0.0083333333333": 120.0,
        "0.00416667": 240.0,
        "0.01": 100.0,
        "0.016667": 60.0,
        "0.04": 25.0,
        "0.041667": 24.0,
        "0.0166834": 1 / 0.0166834,
        "0.03": 1 / 0.03,
        "1": 1.0,
    }.items(),
)
def test_rates_are_whole_where_the_file_rounds_them(text, rate):
    motion = bvh_text([Bone("a", -1, np.zeros(3))], {}, np.zeros((4, 1, 3)), frame_time=text)
    assert parse_bvh(motion.encode(), PATH).rate == pytest.approx(rate, rel=1e-9)


DAMAGED = {
    "no hierarchy": (lambda text: text[10:], "holds something else than clips of hiphi, omnicontact, bvh"),
    "cut in the hierarchy": (lambda text: text[:500], "the file ends there"),
    "a brace too few": (lambda text: text.replace("}", "", 1), "is no part of a hierarchy|not complete"),
    "a brace too many": (lambda text: text.replace("MOTION", "}\nMOTION"), "'}' is no part of a hierarchy"),
    "two roots": (lambda text: text.replace("JOINT LeftUpLeg", "ROOT LeftUpLeg"), "one skeleton with one root"),
    "an unknown channel": (lambda text: text.replace("Zrotation", "Wrotation", 1), "the channels of 'Hips'"),
    "a channel twice": (lambda text: text.replace("Zrotation", "Xrotation", 1), "the channels of 'Hips'"),
    "an offset of two": (
        lambda text: re.sub(r"OFFSET (\S+) (\S+) \S+", r"OFFSET \1 \2", text, count=2),
        "the offset of",
    ),
    "no offset": (lambda text: re.sub("OFFSET .*\n", "", text, count=1), "stands in the place of OFFSET"),
    "frames missing": (lambda text: text.rsplit("\n", 3)[0], "20 frames are promised, 18 rows"),
    "a frame cut": (lambda text: text.rstrip().rsplit(" ", 1)[0], "no table of numbers"),
    "letters": (lambda text: text[:-30] + "x" + text[-30:], "no table of numbers"),
    "not finite": (lambda text: text.rstrip().rsplit(" ", 1)[0] + " nan", "numbers of 1 frame .19. are not finite"),
    "no rate": (lambda text: text.replace("Frame Time: 0.033333", "Frame Time: 0"), "it must be positive"),
    "a rate in words": (
        lambda text: text.replace("Frame Time: 0.033333", "Frame Time: fast"),
        "seconds between frames",
    ),
    "no frames": (lambda text: text.split("Frames:")[0] + "Frames: 0\nFrame Time: 0.1\n", "too few frames"),
    "a column less": (
        lambda text: text.replace("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 2 Zrotation Xrotation", 1),
        "but the channels are",
    ),
    "another skeleton": (lambda text: text.replace("LeftUpLeg", "Thigh"), "lacks LeftUpLeg"),
    "another unit": (
        lambda text: re.sub(
            "OFFSET (.*)", lambda match: "OFFSET " + " ".join(str(5 * float(n)) for n in match[1].split()), text
        ),
        "units tall",
    ),
}


@pytest.mark.parametrize(("damage", "said"), DAMAGED.values(), ids=DAMAGED)
def test_damaged_files_are_refused_in_words(tmp_path, written, damage, said):
    path = tmp_path / "walk.bvh"
    path.write_text(damage(written))
    with pytest.raises(HoiRetargetError, match=said) as caught:
        read_clip(path)
    assert "walk.bvh" in str(caught.value)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return write_person(tmp_path_factory.mktemp("bvh") / "walk.bvh", SHORT, Rig(MIXAMO)).read_text()


def test_rest_poses_that_tell_nothing_are_refused(tmp_path):
    seated = {
        f"{side}_{joint}": se3.exp(np.array([2.0, 0.0, 0.0])) for side in ("left", "right") for joint in ("hip", "knee")
    }
    with pytest.raises(HoiRetargetError, match=r"rest pose is no T-pose.*Export it with a T-pose"):
        read_clip(write_person(tmp_path / "seated.bvh", SHORT, Rig(MIXAMO, axes=seated)))


@pytest.mark.parametrize("limb", ["hip knee", "shoulder elbow"])
def test_limbs_that_bend_the_wrong_way_are_refused(tmp_path, limb):
    """As where LAFAN1's names come with other axes of the bones."""
    turned = {
        joint: se3.quat_multiply(axes, se3.exp(np.array([np.pi, 0.0, 0.0])))
        if joint.partition("_")[2] in limb.split()
        else axes
        for joint, axes in lafan1_axes().items()
    }
    with pytest.raises(HoiRetargetError, match=rf"the left {limb.split()[1]} bends the wrong way"):
        read_clip(write_person(tmp_path / "walk.bvh", SHORT, replace(LAFAN1_RIG, axes=turned)))


def test_spaces_braces_and_marks_do_not_matter(tmp_path, written):
    text = "\ufeff" + written.replace("\n\t{\n", " {\n").replace("\n", "\r\n").replace("MOTION", "\r\nmotion")
    path = tmp_path / "walk.bvh"
    path.write_bytes(text.encode())
    assert_same_people_of_body(read_clip(path), SHORT)
