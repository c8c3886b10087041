"""The layout of our own with people as parameters of a body model: the same people as joints, or one clear error."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from hoi_retarget.cli import main
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import BodyModelError, ClipError, ReadError
from hoi_retarget.human.skeleton import JOINT_INDEX, LEFT_FINGERS, PARENT, RIGHT_FINGERS
from hoi_retarget.motion.result_file import load
from hoi_retarget.numerics import se3
from hoi_retarget.readers import own_layout, read_clip
from hoi_retarget.readers.body_parameters import load_body_model
from hoi_retarget.readers.describe import inspect
from mesh_writer import write_mesh
from npz_changes import changed
from own_layout_writer import joint_arrays, parameter_arrays
from source_people import assert_same_objects, assert_same_people, in_world
from synthetic import make

DOCUMENT = Path(__file__).parents[1] / "docs" / "sources.md"
BOX = make("carry_box", seconds=1.0)
TABLE = make("carry_table", seconds=1.0)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A clip of two people and the folder of their models."""
    folder = tmp_path_factory.mktemp("parameters")
    np.savez(folder / "clip.npz", **parameter_arrays(TABLE, "smplx", folder / "models"))
    return folder


@pytest.fixture
def clip(tmp_path, written):
    """The same, to be changed."""
    return shutil.copyfile(written / "clip.npz", tmp_path / "clip.npz"), written / "models"


@pytest.mark.parametrize("made", [BOX, TABLE], ids=["one person", "two people"])
@pytest.mark.parametrize(
    ("family", "flat", "components"),
    [("smplx", True, 0), ("smplx", False, 0), ("smplx", False, 24), ("smplh", True, 24), ("smplh", False, 0)],
)
def test_people_are_those_given_as_joints(tmp_path, made, family, flat, components):
    path = tmp_path / "clip.npz"
    np.savez(path, **parameter_arrays(made, family, tmp_path / "models", flat=flat, components=components))
    clip = read_clip(path, ReadOptions(body_models=tmp_path / "models"))
    np.savez(path, **joint_arrays(made))
    as_joints = read_clip(path)
    assert_same_people(clip, as_joints)
    assert_same_people(clip, made)
    assert_same_objects(clip, as_joints)
    assert [person.name for person in clip.people] == [person.name for person in as_joints.people]
    assert (clip.name, clip.fps, clip.source.notes) == (as_joints.name, as_joints.fps, as_joints.source.notes)
    for ours, theirs in zip(clip.contacts, as_joints.contacts, strict=True):
        assert np.array_equal(ours.active, theirs.active)
        assert np.array_equal(ours.contact_points, theirs.contact_points, equal_nan=True)
    for person in clip.people:
        assert person.shape is not None
        np.testing.assert_allclose(
            np.linalg.norm(person.shape.rest_joints[1] - person.shape.rest_joints[0]),
            np.linalg.norm(person.position("left_hip") - person.position("pelvis"), axis=1).mean(),
        )


def test_without_hand_poses_hands_are_flat(clip):
    path, models = clip
    changed(path, left_hand_pose=None, right_hand_pose=None, flat_hands=None)
    read = read_clip(path, ReadOptions(body_models=models))
    for person, theirs in zip(read.people, TABLE.people, strict=True):
        body = [JOINT_INDEX[joint] for joint in own_layout.BODY_JOINTS]
        np.testing.assert_allclose(person.joint_positions[:, body], theirs.joint_positions[:, body], atol=1e-6)
        for finger in (*LEFT_FINGERS, *RIGHT_FINGERS):
            turns = np.abs(np.sum(person.quat(finger) * person.quat(str(PARENT[finger])), axis=-1))
            np.testing.assert_allclose(turns, 1.0, atol=1e-9)
    assert any("the hands are flat" in note for note in read.source.notes)
    said = read_clip(changed(path, flat_hands=True), ReadOptions(body_models=models))
    assert_same_people(said, read)


@pytest.mark.parametrize(
    "change",
    [
        lambda a: {"betas": 0 * a["betas"]},
        lambda a: {"flat_hands": ~a["flat_hands"]},
        lambda a: {"left_hand_pose": a["right_hand_pose"], "right_hand_pose": a["left_hand_pose"]},
        lambda a: {"body_gender": a["body_gender"][::-1]},
        lambda a: {"body_pose": a["body_pose"][:, ::-1]},
        lambda a: {"body_translation": a["body_translation"][:, ::-1]},
        lambda a: {"body_pose": np.concatenate([-a["body_pose"][:, :, :1], a["body_pose"][:, :, 1:]], axis=2)},
    ],
    ids=["betas", "mean hands", "other hands", "genders", "poses of another person", "places of another", "inverted"],
)
def test_other_conventions_would_be_seen(clip, change):
    path, models = clip
    with np.load(path) as archive:
        changed(path, **change(dict(archive)))
    with pytest.raises((AssertionError, ClipError)):
        assert_same_people(read_clip(path, ReadOptions(body_models=models)), TABLE, tolerance=1e-3)


def test_the_documents_example_turns_from_y_up(tmp_path, monkeypatch):
    arrays = parameter_arrays(in_world(BOX, "y"), "smplx", tmp_path / "models", flat=False)
    write_mesh(tmp_path / "box.obj", BOX.objects[0].geometry)
    values = {
        "pose": arrays["body_pose"][:, 0],
        "translation": arrays["body_translation"][:, 0],
        "betas": arrays["betas"][0],
        "left_hand": arrays["left_hand_pose"][:, 0],
        "right_hand": arrays["right_hand_pose"][:, 0],
        "positions": BOX.objects[0].positions,
        "quats": BOX.objects[0].quats,
    }
    monkeypatch.chdir(tmp_path)
    (example,) = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    exec(example, {"np": np, "se3": se3, "Path": Path, "load_body_model": load_body_model, **values})
    clip = read_clip(Path("clip.npz"), ReadOptions(body_models=Path("models")))
    assert_same_people(clip, BOX)
    assert_same_objects(clip, BOX)


def test_what_was_read_is_written_as_joints(tmp_path, clip):
    path, models = clip
    read = read_clip(path, ReadOptions(body_models=models))
    own_layout.write(read, tmp_path / "joints.npz")
    again = read_clip(tmp_path / "joints.npz")
    for ours, theirs in zip(again.people, read.people, strict=True):
        assert np.array_equal(ours.joint_positions, theirs.joint_positions)
        np.testing.assert_allclose(ours.joint_quats, theirs.joint_quats, rtol=0, atol=1e-12)


def test_the_model_must_be_there_and_right(tmp_path, clip):
    path, models = clip
    with pytest.raises(BodyModelError, match=r"female SMPL-X body model, not joints.* pass --body-models DIR"):
        read_clip(path)
    with pytest.raises(BodyModelError, match="there is no such folder"):
        read_clip(path, ReadOptions(body_models=tmp_path / "nowhere"))
    with pytest.raises(ReadError, match="no female smplh model in this folder"):
        read_clip(changed(path, body_family="smplh"), ReadOptions(body_models=models))
    (tmp_path / "models").mkdir()
    shutil.copyfile(models / "SMPLX_FEMALE.npz", tmp_path / "models" / "SMPLH_FEMALE.npz")
    with pytest.raises(ReadError, match="55 joints, as smplx has; smplh has 52"):
        read_clip(path, ReadOptions(body_models=tmp_path / "models"))


def spoiled(values):
    values = np.array(values, dtype=float)
    values[-1, 0] = np.nan
    return values


def both_hands(values):
    return {"left_hand_pose": values, "right_hand_pose": values}


def y_up(arrays):
    """As somebody gives parameters who forgot to turn them."""
    back = se3.exp(np.array([-np.pi / 2, 0, 0]))
    pose = arrays["body_pose"].copy()
    pose[:, :, 0] = se3.log(se3.quat_multiply(back, se3.exp(pose[:, :, 0])))
    return {"body_pose": pose, "body_translation": se3.rotate(back, arrays["body_translation"])}


MISTAKES = {
    "people given twice": (
        lambda _: {"joint_pos": np.zeros((31, 2, 52, 3))},
        "as joints (joint_pos) and as parameters",
    ),
    "another family": (lambda _: {"body_family": "smpl"}, "body_family has 'smpl', expected one of smplx, smplh"),
    "no family": (lambda _: {"body_family": None}, "lacks 'body_family'"),
    "an unknown gender": (
        lambda _: {"body_gender": np.array(["female", "man"])},
        "body_gender has 'man', expected one",
    ),
    "one gender for two": (lambda _: {"body_gender": np.array(["female"])}, "has shape (1,), expected (2,)"),
    "betas of one": (lambda a: {"betas": a["betas"][:1]}, "has shape (1, 10), expected (2, b)"),
    "too many betas": (lambda _: {"betas": np.zeros((2, 31))}, "31 betas are given; this female smplx model has 30"),
    "betas of each frame": (lambda a: {"betas": a["betas"][None]}, "has shape (1, 2, 10), expected (2, b)"),
    "betas of another body": (lambda a: {"betas": 90 * a["betas"]}, "m tall. Check the betas"),
    "no pose": (lambda _: {"body_pose": None}, "lacks 'body_pose'"),
    "the pose without the pelvis": (lambda a: {"body_pose": a["body_pose"][:, :, 1:]}, "expected (T, P, 22, 3)"),
    "the pose in rows": (lambda a: {"body_pose": a["body_pose"].reshape(31, 2, 66)}, "expected (T, P, 22, 3)"),
    "too few frames": (lambda a: {"body_pose": a["body_pose"][:3]}, "3 frame(s) of 2 people"),
    "nobody": (lambda a: {"body_pose": a["body_pose"][:, :0]}, "31 frame(s) of 0 people"),
    "frames that disagree": (lambda a: {"body_translation": a["body_translation"][1:]}, "expected (31, 2, 3)"),
    "frames of the object": (lambda a: {"object_pos": a["object_pos"][1:]}, "expected (31, 1, 3)"),
    "one hand": (lambda _: {"left_hand_pose": None}, "has right_hand_pose, but no left_hand_pose"),
    "another hand": (lambda a: {"left_hand_pose": a["left_hand_pose"][:, :, 1:]}, "expected (31, 2, 15, 3)"),
    "a hand's frames": (lambda a: {"left_hand_pose": a["left_hand_pose"][1:]}, "expected (31, 2, 15, 3)"),
    "a hand in a row": (
        lambda a: {"left_hand_pose": a["left_hand_pose"].reshape(31, 2, 45)},
        "Rotation vectors have the shape (T, P, 15, 3)",
    ),
    "hands that differ": (
        lambda _: {"left_hand_pose": np.zeros((31, 2, 24))},
        "left_hand_pose has 24 numbers for each person and frame, right_hand_pose 45",
    ),
    "too many components": (lambda _: both_hands(np.zeros((31, 2, 46))), "46 numbers a frame"),
    "no components": (lambda _: both_hands(np.zeros((31, 2, 0))), "0 numbers a frame"),
    "a hand as text": (lambda _: {"left_hand_pose": "flat"}, "cannot be used"),
    "nobody says which hands": (lambda _: {"flat_hands": None}, "lacks 'flat_hands'"),
    "a number for a truth": (lambda _: {"flat_hands": 1}, "flat_hands, whether hands are counted"),
    "mean hands without poses": (
        lambda _: {"flat_hands": False, "left_hand_pose": None, "right_hand_pose": None},
        "flat_hands is false, but there are no hand poses",
    ),
    "names of others": (lambda _: {"person_names": np.array(["a", "b", "c"])}, "has shape (3,), expected (2,)"),
    "a misspelt name": (lambda _: {"flat_hand": True}, "Did you mean 'flat_hands'"),
    "y is up": (y_up, "stands along y"),
    **{
        f"no numbers in {name}": (lambda a, name=name: {name: spoiled(a[name])}, f"{name}, ")
        for name in ("betas", "body_pose", "body_translation", "left_hand_pose", "right_hand_pose")
    },
}


@pytest.mark.parametrize("name", MISTAKES)
def test_every_mistake_has_one_error(clip, name):
    change, words = MISTAKES[name]
    path, models = clip
    with np.load(path) as archive:
        changed(path, **change(dict(archive)))
    with pytest.raises(ClipError) as caught:
        read_clip(path, ReadOptions(body_models=models))
    assert str(path) in str(caught.value)
    assert words in str(caught.value), str(caught.value)
    assert "not finite" in str(caught.value) or "no numbers" not in name
    assert words in inspect(path, ReadOptions(body_models=models)).problems[0]


def test_a_clip_with_nobody_in_it(clip):
    path, models = clip
    with np.load(path) as archive:
        changed(path, **dict.fromkeys(name for name in archive if name.startswith(("bo", "be", "le", "ri", "fl"))))
    with pytest.raises(ClipError, match=r"there is nobody in the clip: it has neither joints .* nor parameters"):
        read_clip(path, ReadOptions(body_models=models))


def test_parameters_are_inspected(clip):
    path, models = clip
    facts = inspect(path)
    assert "--body-models DIR" in facts.missing[0]
    assert facts.command == f"hoi-retarget run {path} --body-models DIR --out out"
    facts = inspect(path, ReadOptions(body_models=models))
    assert facts.skeleton == "52 joints of 2 people, from parameters of SMPL-X female and male, 10 betas"
    assert facts.command == f"hoi-retarget run {path} --body-models {models} --out out"


def test_parameters_are_converted_and_run(tmp_path, capsys):
    path, models, joints, out = (tmp_path / name for name in ("clip.npz", "models", "joints.npz", "out"))
    np.savez(path, **parameter_arrays(make("carry_box", seconds=0.5), "smplh", models))
    assert main(["convert", str(path), "--body-models", str(models), "--out", str(joints)]) == 0
    assert main(["run", str(path), "--body-models", str(models), "--out", str(out)]) == 0
    assert "1 solved" in capsys.readouterr().out
    assert_same_people(read_clip(joints), read_clip(path, ReadOptions(body_models=models)))
    assert load(out / "clip.npz").report.source.format == "hoi-retarget-clip"
