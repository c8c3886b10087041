"""People without objects, as AMASS and GVHMR have them: written, read back, and files that do not fit."""

import re
from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import BodyModelError, ClipError, HoiRetargetError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.numerics import se3
from hoi_retarget.readers import read_clip, reader_of
from hoi_retarget.readers.describe import inspect
from hoi_retarget.readers.open import open_clip, result_stem
from npz_changes import changed
from people_writer import alone, amass_arrays, gvhmr_arrays, write_amass, write_gvhmr, write_model
from short_clips import cut
from source_people import assert_same_people, in_world

WALK = alone("carry_box")
SHORT = cut(WALK, 20)
BODY = slice(22)
"""The joints without fingers."""


def assert_same_bodies(read, written, *, tolerance=1e-6):
    """Positions [m] and rotations of all joints but fingers agree."""
    ours, theirs = read.people[0], written.people[0]
    np.testing.assert_allclose(ours.joint_positions[:, BODY], theirs.joint_positions[:, BODY], atol=tolerance)
    angles = se3.angle_between(ours.joint_quats[:, BODY], theirs.joint_quats[:, BODY])
    assert angles.max() < 10 * tolerance


@pytest.fixture
def amass(tmp_path):
    path, models = write_amass(tmp_path, SHORT, "smplx")
    return path, ReadOptions(body_models=models)


@pytest.fixture
def gvhmr(tmp_path):
    path, models = write_gvhmr(tmp_path, SHORT)
    return path, ReadOptions(body_models=models)


@pytest.mark.parametrize("family", ["smplh", "smplx"])
@pytest.mark.parametrize("fps", [30.0, 120.0])
def test_amass_as_written_is_the_person_read(tmp_path, family, fps):
    made = cut(alone("push_table", fps=fps), 60)
    path, models = write_amass(tmp_path, made, family)
    clip = read_clip(path, ReadOptions(body_models=models))
    assert_same_people(clip, made)
    assert (clip.name, clip.fps, clip.frames, clip.objects, clip.contacts) == (path.stem, fps, 60, (), ())
    assert reader_of(SourceFile(path)).format == clip.source.format == "amass"
    assert "non-commercial" in clip.source.licence


def test_poses_of_smpl_are_those_of_a_body_with_flat_hands(tmp_path):
    path, models = write_amass(tmp_path, SHORT, "smplh")
    with np.load(path) as arrays:
        poses = arrays["poses"]
        np.savez(tmp_path / "smpl.npz", **{**arrays, "poses": np.concatenate([poses[:, :66], poses[:, :6]], axis=1)})
    clip = read_clip(tmp_path / "smpl.npz", ReadOptions(body_models=models))
    assert_same_bodies(clip, SHORT)
    assert any("SMPL's, with 24 joints" in note for note in clip.source.notes)


def test_gvhmr_as_written_is_the_person_read(tmp_path):
    path, models = write_gvhmr(tmp_path, WALK)
    clip = read_clip(path, ReadOptions(body_models=models))
    assert_same_bodies(clip, WALK, tolerance=2e-6)  # Numbers are in single precision.
    assert (clip.name, clip.fps, clip.objects, clip.contacts) == ("walk", 30.0, (), ())
    assert reader_of(SourceFile(path)).format == clip.source.format == "gvhmr"
    assert result_stem(path) == "walk"
    assert any("hands are flat" in note for note in clip.source.notes)


@pytest.mark.parametrize("dropped", [("poses",), ("root_orient", "pose_body", "pose_hand"), ("poses", "pose_hand")])
def test_arrays_that_are_there_twice_are_needed_once(amass, dropped):
    path, options = amass
    whole = read_clip(path, options)
    assert_same_bodies(read_clip(changed(path, **dict.fromkeys(dropped)), options), whole)


def test_as_converters_write_it(tmp_path):
    arrays = amass_arrays(SHORT, "smplx")
    names = ("root_orient", "pose_body", "trans", "betas", "mocap_frame_rate")
    np.savez(tmp_path / "converted.npz", gender=np.array(b"female"), **{name: arrays[name] for name in names})
    clip = read_clip(
        tmp_path / "converted.npz", ReadOptions(body_models=write_model(tmp_path, SHORT, "smplx", "female"))
    )
    assert_same_bodies(clip, SHORT)
    assert any("does not name its body model" in note for note in clip.source.notes)
    assert any("hands are flat" in note for note in clip.source.notes)


@pytest.mark.parametrize("nested", [True, False])
def test_gvhmr_as_npz(tmp_path, nested):
    arrays = gvhmr_arrays(SHORT)
    np.savez(tmp_path / "walk.npz", **({"smpl_params_global": arrays} if nested else arrays | {"fps": np.array(60.0)}))
    options = ReadOptions(body_models=write_model(tmp_path, SHORT, "smplx", "neutral"))
    clip = read_clip(tmp_path / "walk.npz", options)
    assert_same_bodies(clip, SHORT, tolerance=2e-6)
    assert (clip.name, clip.fps) == ("walk", 30.0 if nested else 60.0)
    np.savez(tmp_path / "walk.npz", **gvhmr_arrays(SHORT, "z"))
    with pytest.raises(ClipError, match="this copy has another axis up"):
        read_clip(tmp_path / "walk.npz", options)


def test_the_body_of_a_video_is_one(tmp_path):
    betas = np.repeat([[1.0, *9 * [0.0]]], SHORT.frames, axis=0).astype(np.float32)
    betas[:, 0] += np.linspace(-0.3, 0.3, SHORT.frames, dtype=np.float32)
    path, models = write_gvhmr(tmp_path, SHORT, betas=betas)
    clip = read_clip(path, ReadOptions(body_models=models))
    assert_same_bodies(clip, SHORT, tolerance=2e-6)
    assert any("betas change by up to 0.6" in note for note in clip.source.notes)


def test_other_conventions_would_be_seen(amass):
    path, options = amass
    arrays = amass_arrays(SHORT, "smplx")
    for values in (
        {"betas": 0 * arrays["betas"]},
        {"trans": arrays["trans"] + 0.01},
        {"pose_hand": np.roll(arrays["pose_hand"], 45, axis=1)},
        {"root_orient": arrays["poses"][:, 3:6]},
        {"pose_body": -arrays["pose_body"]},
    ):
        whole = path.read_bytes()
        with pytest.raises((AssertionError, ClipError)):
            assert_same_people(read_clip(changed(path, **values), options), SHORT, tolerance=1e-3)
        path.write_bytes(whole)


def lying(clip, up="z"):
    """The clip, turned to lie on its back on the floor at 0, then in a world where another axis is up."""
    person = clip.people[0]
    turn = se3.exp(np.array([-np.pi / 2, 0.0, 0.0]))
    positions = se3.rotate(turn, person.joint_positions - person.joint_positions[:1, :1])
    positions -= [0.0, 0.0, positions[..., 2].min()]
    quats = se3.quat_multiply(turn, person.joint_quats)
    return in_world(replace(clip, people=(replace(person, joint_positions=positions, joint_quats=quats),)), up)


def test_people_who_lie_are_read(tmp_path):
    """Crawling and lying is common there; a copy with another axis up is not on the floor for long."""
    clip = cut(WALK, 60, first=30)
    path, models = write_amass(tmp_path, lying(clip), "smplh")
    options = ReadOptions(body_models=models)
    assert_same_people(read_clip(path, options), lying(clip))
    turned, _ = write_amass(tmp_path, in_world(clip, "y"), "smplh")
    with pytest.raises(ClipError, match=r"stands along y.*another axis up"):
        read_clip(turned, options)


@pytest.mark.parametrize(
    ("values", "said"),
    {
        "another model": ({"surface_model_type": "star"}, "surface_model_type is 'star', expected smplx or smplh"),
        "no gender": ({"gender": None}, "gender, the body's gender, is missing"),
        "an unknown gender": ({"gender": "other"}, "no gender 'other'"),
        "another width": (
            {"poses": np.zeros((20, 75)), "surface_model_type": None, "root_orient": None},
            "poses has 75 numbers a frame; expected 72 for SMPL-H, 156 for SMPL-H, 165 for SMPL-X",
        ),
        "frames that disagree": ({"trans": np.zeros((19, 3))}, "(20, 90), expected (19, 90)"),
        "not finite": ({"trans": np.full((20, 3), np.nan)}, "not finite"),
        "no frames": ({name: np.zeros((0, n)) for name, n in (("trans", 3), ("pose_hand", 90))}, "too few frames"),
        "rates": ({"mocap_frame_rate": np.zeros(2)}, "mocap_frame_rate, frames a second, has shape (2,)"),
        "a rate of zero": ({"mocap_frame_rate": 0.0}, "must be 1 to 1000"),
        "another unit": ({"betas": np.full(16, 900.0)}, "another unit than metres"),
    }.values(),
)
def test_what_cannot_be_used_is_said(amass, values, said):
    path, options = amass
    with pytest.raises(HoiRetargetError, match=re.escape(said)):
        read_clip(changed(path, **values), options)


@pytest.mark.parametrize("recording", ["amass", "gvhmr"])
def test_without_models_it_is_said_which_is_needed(request, recording):
    path, options = request.getfixturevalue(recording)
    with pytest.raises(BodyModelError, match=r"SMPL-X body model.*--body-models DIR"):
        read_clip(path)
    facts = inspect(path)
    assert (facts.frames, facts.objects, facts.problems) == (20, (), ())
    assert "--body-models DIR" in facts.command and "SMPL-X" in facts.skeleton
    told = inspect(path, options)
    assert told.height == pytest.approx(SHORT.people[0].height, abs=1e-3) and not told.missing


def test_an_object_cannot_be_named_where_there_is_none(amass):
    path, options = amass
    with pytest.raises(HoiRetargetError, match="this one names none"):
        read_clip(path, replace(options, object_name="box"))


def test_the_floor_is_found(tmp_path):
    (person,) = WALK.people
    raised = replace(person, joint_positions=person.joint_positions + np.array([0.0, 0.0, 0.07]))
    read = []
    for clip in (WALK, replace(WALK, people=(raised,))):
        path, models = write_amass(tmp_path, clip, "smplx")
        read.append(open_clip(path, ReadOptions(body_models=models)))
    assert_same_people(*read)
    assert any("estimated from" in note and "standing feet" in note for note in read[0].source.notes)
