"""HUMOTO's glTF files: what is written is read, at the capture's rate, with rotations from the T-pose."""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from glb_writer import SKIN_OFFSETS, Glb, bound_arms_down, humoto
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.label_contacts import part_object_distances
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human import t_pose
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS
from hoi_retarget.human.skinned_mesh import SkinnedMesh
from hoi_retarget.numerics import se3
from hoi_retarget.readers import can_be_clip, own_layout, read_clip, reader_of
from hoi_retarget.readers import humoto as reader
from hoi_retarget.readers.open import open_clip
from source_people import assert_same_objects, assert_same_people
from synthetic import make

CLIP = make("move_chair", seconds=1.5)
REAL = sorted((Path(__file__).resolve().parents[1].parent / "shared" / "data" / "foreign" / "humoto").glob("*.glb"))
FURNITURE = ("side_table", "floor_lamp", "dining_chair", "shelf", "organizer_medium", "basket")
"""Objects that stand on the floor in the first frame."""
CLOSE = 2e-6
"""[m]; files hold single precision, bones in centimetres."""


def read(tmp_path, glb: Glb) -> Clip:
    return read_clip(glb.write(tmp_path / "clip.glb"))


# What is written is read


@pytest.mark.parametrize("scene", ["carry_box", "drag_suitcase", "push_table"])
def test_a_clip_is_read_as_it_was_written(tmp_path, scene):
    clip = make(scene, seconds=3.0)
    path = humoto(clip).write(tmp_path / f"{scene}-012.glb")
    new = read_clip(path)
    assert_same_people(new, clip, tolerance=CLOSE)
    assert_same_objects(new, clip, tolerance=CLOSE)
    assert (new.name, new.fps, new.frames, new.contacts) == (f"{scene}-012", 30.0, clip.frames, ())
    assert (new.source.format, new.source.licence) == (reader.FORMAT, reader.LICENCE)
    assert t_pose.agreement(new.people[0].joint_positions, new.people[0].joint_quats) > 0.999


@pytest.mark.parametrize(("stamp", "first"), [(24.0, 1), (24.0, 0), (24.0, 977), (30.0, 1)])
def test_every_key_is_one_frame_of_a_capture_of_30(tmp_path, stamp, first):
    clip = read(tmp_path, humoto(CLIP, stamp=stamp, first=first))
    assert (clip.fps, clip.frames) == (30.0, CLIP.frames)
    assert_same_people(clip, CLIP, tolerance=CLOSE)
    speed = np.abs(np.diff(clip.people[0].position("pelvis"), axis=0)).max() * clip.fps
    assert speed == pytest.approx(np.abs(np.diff(CLIP.people[0].position("pelvis"), axis=0)).max() * 30.0, rel=1e-3)
    assert any(f"says {stamp:g} frames a second" in note for note in clip.source.notes)


@pytest.mark.parametrize("degrees", [10.0, 45.0])
def test_a_bind_pose_near_the_t_pose_is_accounted_for(tmp_path, degrees):
    clip = read(tmp_path, humoto(CLIP, bound=bound_arms_down(degrees)))
    assert_same_people(clip, CLIP, tolerance=CLOSE)
    assert any(f"up to {degrees:.0f} deg" in note for note in clip.source.notes)


@pytest.mark.parametrize("degrees", [0.0, 45.0])
def test_the_skin_goes_with_the_joints(tmp_path, degrees):
    """Whatever the bind pose and the frames of bones are; bones that the skeleton lacks are parts of those above."""
    turned = se3.exp(np.array([np.pi / 2, 0.0, 0.0]))
    person = read(tmp_path, humoto(CLIP, bound=bound_arms_down(degrees), turned=turned)).people[0]
    assert person.shape is not None
    skin = person.shape.skin(person.joint_positions, person.joint_quats)
    joints = [*range(len(JOINTS)), JOINT_INDEX["head"]]
    offsets = se3.rotate(CLIP.people[0].joint_quats[:, joints, None], SKIN_OFFSETS)
    wanted = CLIP.people[0].joint_positions[:, joints, None] + offsets
    np.testing.assert_allclose(skin, wanted.reshape(skin.shape), atol=5e-6)
    np.testing.assert_array_equal(person.shape.owners, np.repeat(joints, 3))


def test_vertices_of_two_joints_go_half_way(tmp_path):
    person = read(tmp_path, humoto(CLIP)).people[0]
    assert isinstance(person.shape, SkinnedMesh)
    weights, (elbow, wrist) = person.shape.weights.copy(), (JOINT_INDEX["left_elbow"], JOINT_INDEX["left_wrist"])
    alone = [np.zeros_like(weights), np.zeros_like(weights)]
    alone[0][:, elbow], alone[1][:, wrist] = 1.0, 1.0
    first, second, both = (
        replace(person.shape, weights=of).skin(person.joint_positions, person.joint_quats)
        for of in (*alone, 0.5 * (alone[0] + alone[1]))
    )
    np.testing.assert_allclose(both, 0.5 * (first + second), atol=1e-9)


def test_a_file_without_the_mesh_has_a_person_without_a_skin(tmp_path):
    glb = humoto(CLIP)
    del node_named(glb, "body")["mesh"]
    assert read(tmp_path, glb).people[0].shape is None


@pytest.mark.parametrize("height", [1.55, 1.85])
@pytest.mark.parametrize("above", [0.0, 0.04])
def test_the_floor_is_at_zero_and_the_height_is_that_of_the_top_of_the_head(tmp_path, height, above):
    """Whatever feet and limbs say: people whose toe joints lie on the floor do not lower it."""
    up = np.array([0.0, 0.0, above])
    people = tuple(replace(person, joint_positions=person.joint_positions + up) for person in CLIP.people)
    clip = open_clip(humoto(replace(CLIP, people=people), height=height).write(tmp_path / "clip.glb"))
    assert_same_objects(clip, CLIP, tolerance=CLOSE)
    assert clip.people[0].height == pytest.approx(height, abs=1e-5)
    own_layout.write(clip, tmp_path / "clip.npz")
    assert read_clip(tmp_path / "clip.npz").people[0].height == clip.people[0].height


def test_without_the_top_of_the_head_the_height_is_estimated(tmp_path):
    glb = humoto(CLIP, height=1.2)
    node_named(glb, reader.HEAD_TOP)["name"] = "mixamorig:Hat"
    assert read(tmp_path, glb).people[0].height == pytest.approx(CLIP.people[0].height, abs=1e-5)


@pytest.mark.parametrize("axis", [(np.pi / 2, 0, 0), (0, np.pi / 2, 0), (0, 0, np.pi), (np.pi, 0, 0)])
def test_the_armature_may_be_turned(tmp_path, axis):
    clip = read(tmp_path, humoto(CLIP, turned=se3.exp(np.array(axis))))
    assert_same_people(clip, CLIP, tolerance=CLOSE)


def test_a_node_that_rests_is_where_it_stands(tmp_path):
    glb = humoto(CLIP)
    body, chair = glb.tables["animations"]
    glb.tables["animations"] = [body]
    turn = se3.exp(np.array([0.0, 0.7, 0.0]))
    node = glb.tables["nodes"][chair["channels"][0]["target"]["node"]]
    node |= {"translation": [1.0, 2.0, 3.0], "rotation": se3.quat_to_xyzw(turn).tolist(), "scale": [2.0] * 3}
    track = read(tmp_path, glb).objects[0]
    np.testing.assert_allclose(track.positions, np.tile([1.0, -3.0, 2.0], (CLIP.frames, 1)), atol=1e-6)
    assert np.ptp(track.geometry.points, axis=0) == pytest.approx(
        2.0 * np.ptp(CLIP.objects[0].geometry.points, axis=0), rel=1e-5
    )


def test_keys_between_frames_are_interpolated_and_ends_are_held(tmp_path):
    glb = humoto(CLIP)
    chair = glb.tables["animations"][1]
    times = np.array([1.0, CLIP.frames]) / 24.0
    turns = se3.exp(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    chair |= {"channels": [], "samplers": []}
    node = next(i for i, item in enumerate(glb.tables["nodes"]) if item["name"] == "chair")
    glb.animate(chair, node, "translation", times, np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    glb.animate(chair, node, "rotation", times, turns)
    track = read(tmp_path, glb).objects[0]
    share = np.linspace(0.0, 1.0, CLIP.frames)
    np.testing.assert_allclose(track.positions[:, 0], 2.0 * share, atol=1e-6)
    up = se3.exp(np.array([np.pi / 2, 0.0, 0.0]))
    wanted = se3.quat_multiply(up, se3.exp(share[:, None] * [0.0, 0.0, 1.0]))
    assert se3.angle_between(track.quats, wanted).max() < 1e-6
    chair["samplers"][0]["interpolation"] = "STEP"
    track = read(tmp_path, glb).objects[0]
    assert set(track.positions[:-1, 0]) == {0.0}
    assert track.positions[-1, 0] == 2.0


def test_parts_of_an_object_are_objects_of_their_own(tmp_path):
    glb = humoto(CLIP)
    chair = next(i for i, node in enumerate(glb.tables["nodes"]) if node["name"] == "chair")
    glb.node("lid", parent=chair, mesh=glb.tables["nodes"][chair]["mesh"], translation=[0.0, 0.5, 0.0])
    glb.node("lamp")  # Carries nothing.
    clip = read(tmp_path, glb)
    assert [track.name for track in clip.objects] == ["chair", "lid"]
    whole, lid = clip.objects
    np.testing.assert_allclose(
        lid.positions, whole.positions + se3.rotate(whole.quats, np.array([[0, 0.5, 0]])), atol=1e-6
    )
    assert "lid is a part of chair, with poses of its own." in clip.source.notes
    facts = reader.READER.outline(SourceFile(tmp_path / "clip.glb"))
    assert (facts.objects, facts.frames, facts.fps, facts.fps_stated) == (("chair", "lid"), CLIP.frames, 30.0, False)


def test_files_are_told_apart(tmp_path):
    path = humoto(CLIP).write(tmp_path / "clip.glb")
    assert reader_of(SourceFile(path)) is reader.READER
    assert can_be_clip(path)
    other = Glb()
    other.node("Cube")
    assert not can_be_clip(other.write(tmp_path / "cube.glb"))
    with pytest.raises(ReadError, match="something else than clips of humoto"):
        read_clip(tmp_path / "cube.glb")
    (tmp_path / "clip.fbx").write_bytes(b"Kaydara FBX Binary  \0")
    with pytest.raises(ReadError, match=r"same sequence as \.glb.*Blender"):
        read_clip(tmp_path / "clip.fbx")
    assert not can_be_clip(tmp_path / "clip.fbx")
    with pytest.raises(ArgumentError, match="names chair"):
        read_clip(path, ReadOptions(object_name="chair"))


# What is wrong has one error


def node_named(glb: Glb, name: str) -> dict:
    return next(node for node in glb.tables["nodes"] if node["name"] == name)


def rename_bone(glb: Glb) -> None:
    node_named(glb, "mixamorig:LeftArm")["name"] = "mixamorig:LeftWing"


def without_body_animation(glb: Glb) -> None:
    glb.tables["animations"] = glb.tables["animations"][1:]


def animated_twice(glb: Glb) -> None:
    glb.tables["animations"].append(glb.tables["animations"][0])


def other_frames(glb: Glb) -> None:
    glb.tables["animations"][1] |= {"channels": [], "samplers": []}
    node = glb.tables["nodes"].index(node_named(glb, "chair"))
    times = np.arange(1, CLIP.frames + 20) / 24.0
    glb.animate(glb.tables["animations"][1], node, "translation", times, np.outer(times, [1.0, 0.0, 0.0]))


def growing(glb: Glb) -> None:
    node = glb.tables["nodes"].index(node_named(glb, "chair"))
    chair = glb.tables["animations"][1]
    chair["channels"] = chair["channels"][:2]
    times = np.arange(1, CLIP.frames + 1) / 24.0
    glb.animate(chair, node, "scale", times, np.outer(times, [1.0, 1.0, 1.0]))


def uneven_scale(glb: Glb) -> None:
    chair = glb.tables["animations"][1]
    chair["channels"] = chair["channels"][:2]
    node_named(glb, "chair")["scale"] = [1.0, 2.0, 1.0]


def in_centimetres(glb: Glb) -> None:
    node_named(glb, "Armature")["scale"] = [1.0, 1.0, 1.0]


def huge_object(glb: Glb) -> None:
    uneven_scale(glb)
    node_named(glb, "chair")["scale"] = [1000.0] * 3


def without_skin(glb: Glb) -> None:
    glb.tables["skins"] = []


def unbound(glb: Glb) -> None:
    del glb.tables["skins"][0]["inverseBindMatrices"]


def bones_that_are_not_there(glb: Glb) -> None:
    attributes = glb.tables["meshes"][0]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = glb.array(np.full((3 * (len(JOINTS) + 1), 4), 200), "VEC4")


def two_of_a_name(glb: Glb) -> None:
    glb.node("chair", mesh=node_named(glb, "chair")["mesh"])


def spline(glb: Glb) -> None:
    glb.tables["animations"][0]["samplers"][4]["interpolation"] = "CUBICSPLINE"


def compressed(glb: Glb) -> None:
    glb.tables["extensionsRequired"] = ["KHR_draco_mesh_compression"]


def sparse(glb: Glb) -> None:
    del glb.tables["accessors"][0]["bufferView"]


def a_ring(glb: Glb) -> None:
    glb.tables["nodes"][1].setdefault("children", []).append(0)


def a_matrix(glb: Glb) -> None:
    node_named(glb, "body").update(matrix=np.eye(4).ravel().tolist())


def absent_child(glb: Glb) -> None:
    glb.tables["nodes"][0]["children"] = [999]


def beyond_the_bytes(glb: Glb) -> None:
    glb.tables["accessors"][0]["count"] = 10**9


def lines(glb: Glb) -> None:
    glb.tables["meshes"][1]["primitives"][0]["mode"] = 1


def absent_corners(glb: Glb) -> None:
    accessor = glb.tables["meshes"][1]["primitives"][0]["indices"]
    view = glb.tables["bufferViews"][glb.tables["accessors"][accessor]["bufferView"]]
    glb.blob[view["byteOffset"] : view["byteOffset"] + 4] = struct.pack("<I", 10**6)


def not_finite(glb: Glb) -> None:
    glb.blob[:4] = struct.pack("<f", np.nan)


def doubled_rotations(glb: Glb) -> None:
    accessor = glb.tables["animations"][0]["samplers"][1]["output"]
    view = glb.tables["bufferViews"][glb.tables["accessors"][accessor]["bufferView"]]
    part = slice(view["byteOffset"], view["byteOffset"] + view["byteLength"])
    glb.blob[part] = (2.0 * np.frombuffer(bytes(glb.blob[part]), "<f4")).astype("<f4").tobytes()


MISTAKES = {
    rename_bone: (ClipError, "lacks mixamorig:LeftArm"),
    without_body_animation: (ClipError, "the body is not animated"),
    animated_twice: (ReadError, "animated twice"),
    other_frames: (ClipError, "'chair' is animated from frame 1.0 to 65.0, the body from 1 to 46"),
    growing: (GeometryError, "changes its size"),
    uneven_scale: (ReadError, "scaled unevenly"),
    in_centimetres: (ClipError, "m tall"),
    huge_object: (GeometryError, "another unit"),
    without_skin: (ClipError, "no skin binds"),
    unbound: (ReadError, "no inverse bind matrices"),
    bones_that_are_not_there: (ReadError, "the weights of mesh body"),
    two_of_a_name: (ClipError, "two objects are called 'chair'"),
    spline: (ReadError, "interpolated by CUBICSPLINE"),
    compressed: (ReadError, "needs extensions"),
    sparse: (ReadError, "sparsely or compressed"),
    a_ring: (ReadError, "own ancestors"),
    a_matrix: (ReadError, "has a matrix"),
    absent_child: (ReadError, "refers to a node 999"),
    beyond_the_bytes: (ReadError, "cut off"),
    lines: (ReadError, "expected triangles"),
    absent_corners: (ReadError, "vertices that are not there"),
    not_finite: (ReadError, "not finite"),
    doubled_rotations: (ReadError, "no unit quaternion"),
}


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.__name__)
def test_every_mistake_has_one_error(tmp_path, mistake):
    kind, words = MISTAKES[mistake]
    glb = humoto(CLIP)
    mistake(glb)
    with pytest.raises(kind) as caught:
        read(tmp_path, glb)
    assert words in str(caught.value)
    assert "clip.glb" in str(caught.value)


def test_a_body_that_lies_along_another_axis_is_refused(tmp_path):
    turn = se3.exp(np.array([0.0, np.pi / 2, 0.0]))
    person, track = CLIP.people[0], CLIP.objects[0]
    lying = replace(
        CLIP,
        people=(
            replace(
                person,
                joint_positions=se3.rotate(turn, person.joint_positions),
                joint_quats=se3.quat_multiply(turn, person.joint_quats),
            ),
        ),
        objects=(track,),
    )
    with pytest.raises(ClipError, match="stands along x"):
        read(tmp_path, humoto(lying))


def test_another_pose_than_the_t_pose_is_refused(tmp_path):
    with pytest.raises(ClipError, match=r"rest pose is no T-pose: its (left|right)_shoulder is 75 deg"):
        read(tmp_path, humoto(CLIP, bound=bound_arms_down(75.0)))


def test_a_giant_is_refused(tmp_path):
    with pytest.raises(ClipError, match=r"3\.5 m tall"):
        read(tmp_path, humoto(CLIP, height=3.5))


@pytest.mark.parametrize("stamp", [25.0, 60.0, 7.3])
def test_other_rates_are_refused(tmp_path, stamp):
    with pytest.raises(ClipError, match="expected one for every frame, 24 or 30 a second"):
        read(tmp_path, humoto(CLIP, stamp=stamp))


def test_rotations_are_not_those_of_the_bones_themselves(tmp_path):
    """The bones' own axes are arbitrary: taken as they are, limbs would not lie as in the T-pose."""
    glb = humoto(CLIP)
    clip = read(tmp_path, glb)
    inverse = glb.tables["accessors"][glb.tables["skins"][0]["inverseBindMatrices"]]
    view = glb.tables["bufferViews"][inverse["bufferView"]]
    columns = np.frombuffer(bytes(glb.blob[view["byteOffset"] :][: view["byteLength"]]), "<f4").reshape(-1, 4, 4)
    bound = se3.matrix_to_quat(columns[JOINT_INDEX["left_elbow"], :3, :3].astype(float) * 0.01)
    assert np.rad2deg(se3.angle_between(bound[None], se3.IDENTITY_QUAT)) > 20.0
    assert se3.angle_between(clip.people[0].quat("left_elbow"), CLIP.people[0].quat("left_elbow")).max() < 1e-5


# Real files


@pytest.mark.skipif(not REAL, reason="HUMOTO's own files are not there")
@pytest.mark.slow
@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem[-3:])
def test_real_files_have_their_floor_at_zero_and_a_person_of_157_cm(path):
    clip = open_clip(path)
    assert clip.people[0].height == pytest.approx(1.572, rel=0.02)
    resting = [track.lowest[0] for track in clip.objects if track.name in FURNITURE]
    np.testing.assert_allclose(resting, 0.0, atol=0.01)


@pytest.mark.skipif(not REAL, reason="HUMOTO's own files are not there")
def test_hands_of_real_files_hold_with_their_skin():
    """It lies on the objects; capsules of a hand are up to 8 mm inside or 12 mm off."""
    clip = open_clip(next(path for path in REAL if "cutting_board_with" in path.name))
    held = next(item for item in part_object_distances(clip) if item.part == "right_hand")
    assert np.abs(held.distances).max() < 0.001
