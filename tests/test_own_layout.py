"""The layout of our own: writing and reading is the identity, and every mistake has one clear error."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.cli import main
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ClipError, GeometryError, ReadError, WriteError
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS
from hoi_retarget.motion.result_file import load
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.readers import can_be_clip, own_layout, read_clip
from hoi_retarget.readers.describe import inspect
from synthetic import SCENES, make

BOX = make("carry_box", seconds=1.5)


def arrays_of(clip: Clip = BOX) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(own_layout.encode(clip, Path()))) as arrays:
        return dict(arrays)


def saved(folder: Path, arrays: dict, name: str = "clip.npz") -> Path:
    np.savez(folder / name, **arrays)
    return folder / name


def assert_same(new: Clip, old: Clip, tolerance: float = 1e-12) -> None:
    assert (new.name, new.fps, new.frames, new.first_source_frame) == (
        old.name,
        old.fps,
        old.frames,
        old.first_source_frame,
    )
    assert (new.source.licence, new.source.notes) == (old.source.licence, old.source.notes)
    for a, b in zip(new.people, old.people, strict=True):
        assert a.name == b.name
        assert np.array_equal(a.joint_positions, b.joint_positions)
        assert np.allclose(a.joint_quats, b.joint_quats, rtol=0, atol=tolerance)
    for a, b in zip(new.objects, old.objects, strict=True):
        assert a.name == b.name
        assert np.array_equal(a.positions, b.positions)
        assert np.allclose(a.quats, b.quats, rtol=0, atol=tolerance)
        assert np.array_equal(a.geometry.points, b.geometry.points)
        assert (a.geometry.faces is None) == (b.geometry.faces is None)
        assert a.geometry.faces is None or np.array_equal(a.geometry.faces, b.geometry.faces)
        assert a.geometry.mesh_path == b.geometry.mesh_path
    for a, b in zip(new.contacts, old.contacts, strict=True):
        assert (a.person, a.object, a.part) == (b.person, b.object, b.part)
        assert np.array_equal(a.active, b.active)
        assert np.array_equal(a.contact_points, b.contact_points, equal_nan=True)


@settings(derandomize=True, deadline=None, max_examples=8, database=None)
@given(
    scene=st.sampled_from(tuple(SCENES)),
    height=st.floats(1.3, 2.1),
    seed=st.integers(0, 99),
    fps=st.floats(10, 120),
    words=st.lists(st.text(st.characters(exclude_characters="\0", exclude_categories=("Cs",)), max_size=9), max_size=3),
)
def test_writing_and_reading_is_the_identity(tmp_path_factory, scene, height, seed, fps, words):  # noqa: PLR0917 - drawn
    path = tmp_path_factory.getbasetemp() / "identity.npz"
    clip = make(scene, height=height, seed=seed, fps=fps, seconds=1.0)
    clip = replace(clip, source=replace(clip.source, notes=tuple(words), licence="".join(words)), first_source_frame=3)
    own_layout.write(clip, path)
    assert_same(read_clip(path), clip)


def test_a_clip_with_a_mesh_beside_it(tmp_path):
    mesh = tmp_path / "meshes" / "box.obj"
    mesh.parent.mkdir()
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    track = replace(BOX.objects[0], geometry=ObjectGeometry(np.eye(3), mesh))
    clip = replace(BOX, objects=(track,))
    own_layout.write(clip, tmp_path / "clip.npz")
    assert_same(read_clip(tmp_path / "clip.npz"), clip)
    with pytest.raises(WriteError, match="not in the folder"):
        own_layout.write(clip, tmp_path / "meshes" / "deeper" / "clip.npz")
    # The file alone is enough: its points are read.
    arrays = {key: value for key, value in arrays_of().items() if not key.startswith("object_0")}
    geometry = read_clip(saved(tmp_path, arrays | {"object_0_mesh": "meshes/box.obj"})).objects[0].geometry
    assert len(geometry.points) == 4
    assert geometry.mesh_path == mesh


@pytest.mark.parametrize("text", ["/etc/passwd.obj", "../box.obj", "a/../../box.obj", "link.obj", "", "c:\\box.obj"])
def test_no_path_leaves_the_clips_folder(tmp_path, text):
    (tmp_path / "box.obj").write_text("v 0 0 0\nf 1 1 1\n")
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "link.obj").symlink_to(tmp_path / "box.obj")
    arrays = {key: value for key, value in arrays_of().items() if not key.startswith("object_0")}
    with pytest.raises(ClipError, match="in the clip's folder"):
        read_clip(saved(tmp_path / "in", arrays | {"object_0_mesh": text}))


def test_what_is_derived(tmp_path):
    arrays = arrays_of()
    body = [JOINT_INDEX[joint] for joint in own_layout.BODY_JOINTS]
    for name in ("joint_pos", "joint_quat"):
        arrays[name] = arrays[name][:, :, body]
    arrays["joint_names"] = arrays["joint_names"][body]
    for name in ("contact_points", "person_names", "notes", "first_source_frame", "contact_person"):
        del arrays[name]
    clip = read_clip(saved(tmp_path, arrays))
    hand = clip.people[0].part_position("left_hand") - BOX.people[0].part_position("left_hand")
    assert np.linalg.norm(hand, axis=1).max() < 0.03
    assert len(clip.source.notes) == 2
    contact, person, track = clip.contacts[0], clip.people[0], clip.objects[0]
    own = track.to_object(person.part_position(contact.part))
    assert np.array_equal(contact.contact_points[contact.active], own[contact.active])
    # Read, written and read again it is the same: nothing is derived twice.
    own_layout.write(clip, tmp_path / "again.npz")
    assert_same(read_clip(tmp_path / "again.npz"), clip)


def test_joints_come_in_any_order(tmp_path):
    order = np.random.default_rng(0).permutation(len(JOINTS))
    arrays = arrays_of()
    arrays |= {name: arrays[name][:, :, order] for name in ("joint_pos", "joint_quat")}
    arrays["joint_names"] = arrays["joint_names"][order]
    assert_same(read_clip(saved(tmp_path, arrays)), BOX)


def test_contacts_as_segments(tmp_path):
    arrays = {key: value for key, value in arrays_of().items() if not key.startswith("contact_")}
    arrays |= {
        "segment_part": np.array(["left_hand", "left_hand", "right_foot"]),
        "segment_frames": np.array([[2, 9], [20, 30], [0, 5]]),
        "segment_points": np.arange(9).reshape(3, 3) / 10,
    }
    clip = read_clip(saved(tmp_path, arrays))
    assert [(track.part, track.segments) for track in clip.contacts] == [
        ("left_hand", ((2, 9), (20, 30))),
        ("right_foot", ((0, 5),)),
    ]
    assert np.array_equal(clip.contacts[0].contact_points[25], [0.3, 0.4, 0.5])
    for frames, words in (([[2, 9], [8, 30], [0, 5]], "overlaps"), ([[2, 9], [9, 99], [0, 5]], "within 0 and")):
        with pytest.raises(ClipError, match=words):
            read_clip(saved(tmp_path, arrays | {"segment_frames": np.array(frames)}))


def with_nan(name):
    def change(arrays):
        values = arrays[name].copy()
        values.reshape(len(values), -1)[7, 0] = np.nan
        return arrays | {name: values}

    return change


MISTAKES = {
    "a key is missing": (lambda a: {k: v for k, v in a.items() if k != "joint_quat"}, "lacks 'joint_quat'"),
    "a key is misspelt": (lambda a: a | {"contact_flag": a["contact_flags"]}, "Did you mean 'contact_flags'"),
    "no licence": (lambda a: {k: v for k, v in a.items() if k != "licence"}, "lacks 'licence'"),
    "the shape": (lambda a: a | {"joint_pos": a["joint_pos"][:, 0]}, "expected (T, P, 52, 3)"),
    "frames disagree": (lambda a: a | {"object_pos": a["object_pos"][:-1]}, "expected (46, 1, 3)"),
    "no numbers": (with_nan("joint_pos"), "not finite, first at row 7"),
    "no numbers in a rotation": (with_nan("object_quat"), "not finite, first at row 7"),
    "an active contact without a point": (
        lambda a: a | {"contact_points": a["contact_points"] * np.nan, "contact_flags": a["contact_flags"] | True},
        "although contact_flags",
    ),
    "rotations not of unit length": (lambda a: a | {"joint_quat": 1.1 * a["joint_quat"]}, "has length 1.1"),
    "scalar-last rotations": (lambda a: a | {"joint_quat": np.roll(a["joint_quat"], -1, -1)}, "T-pose"),
    "y is up": (
        lambda a: (
            a
            | {
                "joint_pos": a["joint_pos"] @ se3.quat_to_matrix(se3.exp(np.array([-np.pi / 2, 0, 0]))).T - [0, 0, 1.0],
                "joint_quat": se3.quat_multiply(se3.exp(np.array([-np.pi / 2, 0, 0])), a["joint_quat"]),
            }
        ),
        "stands along y",
    ),
    "y is said to be up": (lambda a: a | {"up": "y"}, "up is 'y'"),
    "said to be in millimetres": (lambda a: a | {"unit": "mm"}, "unit is 'mm'"),
    "millimetres": (lambda a: a | {"joint_pos": 1e3 * a["joint_pos"]}, "millimetres"),
    "objects in millimetres": (lambda a: a | {"object_0_points": 1e4 * a["object_0_points"]}, "expected metres"),
    "an unknown joint": (
        lambda a: a | {"joint_names": np.array(["pelvis ", *a["joint_names"][1:]])},
        "Did you mean 'pelvis'",
    ),
    "a joint twice": (lambda a: a | {"joint_names": np.array(["head", *a["joint_names"][1:]])}, "'head' twice"),
    "too few frames": (lambda a: {k: v[:3] if v.shape[:1] == (46,) else v for k, v in a.items()}, "3 frame(s)"),
    "an unknown part": (lambda a: a | {"contact_part": np.array(["left_hnd"] * 2)}, "Did you mean 'left_hand'"),
    "an absent object": (lambda a: a | {"contact_object": np.array([0, 1])}, "contact_object has 1"),
    "faces beyond points": (lambda a: a | {"object_0_faces": np.array([[0, 1, 999]])}, "beyond"),
    "contacts given twice": (lambda a: a | {"segment_part": a["contact_part"]}, "in one way"),
    "text for a number": (lambda a: a | {"fps": "thirty"}, "fps, frames a second"),
    "no rate": (lambda a: a | {"fps": 0.0}, "must be 1 to 1000"),
    "an object twice": (lambda a: a | {"object_names": np.array(["box", "box"])}, "a name twice"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_every_mistake_has_one_error(tmp_path, name):
    change, words = MISTAKES[name]
    path = saved(tmp_path, change(arrays_of()))
    with pytest.raises(ClipError) as caught:
        read_clip(path)
    assert str(path) in str(caught.value)
    assert words in str(caught.value), str(caught.value)
    assert words in inspect(path).problems[0]


def turned(clip, angle, lift=0.0):
    """The arrays of a clip turned about x, and lifted [m]."""
    arrays, turn = arrays_of(clip), se3.exp(np.array([angle, 0, 0]))
    for name in ("joint", "object"):
        arrays[f"{name}_pos"] = se3.rotate(turn, arrays[f"{name}_pos"]) + np.array([0, 0, lift])
        arrays[f"{name}_quat"] = se3.quat_multiply(turn, arrays[f"{name}_quat"])
    return arrays


@pytest.mark.parametrize("scene", SCENES)
def test_another_axis_up_is_refused_wherever_the_person_is(tmp_path, scene):
    clip = make(scene, seconds=4.0)
    for angle, axis in ((-np.pi / 2, "y"), (np.pi / 2, "-y"), (np.pi, "-z")):
        with pytest.raises(ClipError, match=f"stands along {axis}"):
            read_clip(saved(tmp_path, turned(clip, angle)))


def test_who_lies_on_the_floor_is_read(tmp_path):
    lying = turned(BOX, np.pi / 2)
    lying = turned(BOX, np.pi / 2, 0.05 - float(lying["joint_pos"][..., 2].min(axis=(1, 2)).mean()))
    still = {name: np.repeat(lying[name][:1], BOX.frames, axis=0) for name in lying if name.endswith(("_pos", "_quat"))}
    still = {name: values for name, values in (lying | still).items() if not name.startswith("contact_")}
    assert read_clip(saved(tmp_path, still)).frames == BOX.frames


def test_other_archives_are_told_apart(tmp_path):
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    np.savez(tmp_path / "result.npz", schema=1)
    np.savez(tmp_path / "newer.npz", clip_schema=2)
    np.savez(tmp_path / "pickled.npz", **arrays_of() | {"name": np.array({}, dtype=object)})
    (tmp_path / "broken.npz").write_bytes(b"PK nothing")
    for name, error, words in (
        ("other", ReadError, "no 'clip_schema', but 'a'"),
        ("result", ReadError, "not a clip. Use `hoi-retarget evaluate`"),
        ("newer", ReadError, "reads 1"),
        ("pickled", ClipError, "cannot be used"),
        ("broken", ReadError, "not a readable"),
        ("absent", ReadError, "no such file"),
    ):
        with pytest.raises(error, match=words):
            read_clip(tmp_path / f"{name}.npz")
    assert not can_be_clip(tmp_path / "result.npz")
    assert not can_be_clip(tmp_path / "broken.npz")
    assert can_be_clip(saved(tmp_path, arrays_of()))
    with pytest.raises(ArgumentError, match=r"this one names box\. Leave the option out"):
        read_clip(tmp_path / "clip.npz", ReadOptions(object_name="box"))
    bare = {key: value for key, value in arrays_of().items() if not key.startswith("object_0")}
    with pytest.raises(GeometryError, match="--objects DIR"):
        read_clip(saved(tmp_path, bare))
    assert "--objects DIR" in inspect(tmp_path / "clip.npz").missing[0]


def test_clips_are_converted_inspected_and_run(tmp_path, capsys):
    clip = tmp_path / "clip.npz"
    assert main(["convert", "builtin:carry_box", "--out", str(clip)]) == 0
    assert main(["inspect", str(clip)]) == 0
    assert main(["contacts", str(clip)]) == 0
    assert main(["run", str(clip), "--contact", "landmark", "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    for words in ("[hoi-retarget-clip]", "Converted from builtin:carry_box (synthetic, SHA-256", "1 solved"):
        assert words in out
    assert load(tmp_path / "out" / "clip.npz").report.source.format == "hoi-retarget-clip"
    before = clip.read_bytes()
    assert main(["run", str(clip), "--out", str(tmp_path)]) == 2
    assert "over the clip" in capsys.readouterr().err
    assert clip.read_bytes() == before
    assert main(["convert", "builtin:carry_box", "--out", str(tmp_path / "clip.pt")]) == 2
