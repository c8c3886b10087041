"""InterCap's results: written and read back, their conventions, and what is refused."""

import os
from dataclasses import replace

import numpy as np
import pytest

from behave_writer import renamed
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, BodyModelError, ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.readers import can_be_clip, intercap, read_clip
from hoi_retarget.readers.intercap import MALE, OBJECTS
from intercap_writer import (
    NAME,
    frames_of,
    in_camera,
    results_of,
    write_mesh,
    write_model,
    write_results,
    write_saved_mesh,
)
from source_people import assert_same_objects, assert_same_people, in_world
from synthetic import make

CLIP = renamed(make("move_chair", seconds=2.0), NAME)
FRAMES = CLIP.frames
SEEN = in_camera(CLIP)
RESULTS, MODEL = results_of(SEEN)


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    return write_model(tmp_path_factory.mktemp("intercap"), MODEL)


def moved(clip: Clip, step) -> Clip:
    people = tuple(replace(it, joint_positions=it.joint_positions + step) for it in clip.people)
    return replace(
        clip, people=people, objects=tuple(replace(it, positions=it.positions + step) for it in clip.objects)
    )


def written(root, results=RESULTS, seen=SEEN, **where):
    path = write_results(root, results, **where)
    write_saved_mesh(path, seen)
    return path


@pytest.mark.parametrize("results", [RESULTS, frames_of(RESULTS)], ids=["dictionary", "frames"])
def test_what_is_written_is_read_in_the_makers_level_world(tmp_path, models, results):
    clip = read_clip(written(tmp_path, results), ReadOptions(body_models=models))
    assert_same_people(clip, CLIP)
    assert_same_objects(clip, CLIP)
    assert (clip.name, clip.fps, clip.contacts) == ("03_07_Seg_1", 30.0, ())
    assert (clip.source.format, len(clip.source.sha256)) == ("intercap", 64)
    assert "non-commercial" in clip.source.licence
    assert clip.source.notes == (
        "The world is levelled by the floor of the makers' scripts, 9.5 deg off the first camera's y axis; the feet "
        "are on it in 100% of the frames.",
    )


def test_without_feet_on_the_makers_floor_y_is_down_and_that_is_said(tmp_path, models):
    lifted = in_world(moved(CLIP, [0.0, 0.0, 1.0]), "-y")
    results, _ = results_of(lifted)
    clip = read_clip(written(tmp_path, results, lifted), ReadOptions(body_models=models))
    assert_same_people(clip, moved(CLIP, [0.0, 0.0, 1.0]))
    assert_same_objects(clip, moved(CLIP, [0.0, 0.0, 1.0]))
    assert any("on the makers' floor in 0% of the frames only" in note for note in clip.source.notes)


@pytest.mark.parametrize("up", ["y", "z"])
def test_another_axis_up_is_refused(tmp_path, models, up):
    other = in_world(CLIP, up)
    with pytest.raises(ClipError, match=r"stands along .*, turned to z up from -y up"):
        read_clip(written(tmp_path, results_of(other)[0], other), ReadOptions(body_models=models))


def test_the_mesh_beside_the_recording_tells_the_frame_of_the_poses(tmp_path, models):
    path = write_results(tmp_path, RESULTS)
    with pytest.raises(GeometryError, match=r"looked for Mesh/00000_second_obj\.ply"):
        read_clip(path, ReadOptions(body_models=models))
    for kind in ("obj", "ply"):
        objects = write_mesh(tmp_path / kind, CLIP, kind=kind)
        # Not centred: as the makers' scripts move it.
        assert_same_objects(read_clip(path, ReadOptions(objects=objects, body_models=models)), CLIP)
    write_saved_mesh(path, SEEN)
    assert_same_objects(read_clip(path, ReadOptions(objects=objects, body_models=models)), CLIP)
    write_mesh(tmp_path / "ply", CLIP, offset=0.05, kind="ply")
    with pytest.raises(GeometryError, match=r"up to 0\.050 m off the one in Mesh"):
        read_clip(path, ReadOptions(objects=objects, body_models=models))
    with pytest.raises(GeometryError, match=r"07\.obj or .*07\.ply"):
        read_clip(path, ReadOptions(objects=tmp_path, body_models=models))


def test_folders_tell_subject_and_object(tmp_path, models):
    assert (OBJECTS["03"], OBJECTS["10"], MALE) == ("soccerball", "stool", ("01", "02", "04", "05", "10"))
    with pytest.raises(ReadError, match="there is no male smplx model"):
        read_clip(written(tmp_path, subject="04"), ReadOptions(body_models=models))
    assert read_clip(written(tmp_path, thing="09"), ReadOptions(body_models=models)).objects[0].name == "cup"
    for where in ({"subject": "11"}, {"subject": "3"}, {"thing": "chair"}, {"thing": "00"}):
        with pytest.raises(ClipError, match="folders that it is in do not tell"):
            read_clip(written(tmp_path, **where), ReadOptions(body_models=models))
    lone = tmp_path / "res.pkl"
    lone.write_bytes(write_results(tmp_path, RESULTS).read_bytes())
    with pytest.raises(ClipError, match=r"<subject>/<object>/Seg_<n>/res\.pkl"):
        read_clip(lone, ReadOptions(body_models=models))


def test_paths_are_followed_from_wherever_one_stands(tmp_path, models, monkeypatch):
    path = written(tmp_path)
    monkeypatch.chdir(path.parent)
    here = type(path)("res.pkl")
    assert_same_people(read_clip(here, ReadOptions(body_models=models)), CLIP)
    assert os.getcwd() == str(path.parent)  # noqa: PTH109


def test_what_it_holds_is_told_without_models(tmp_path):
    path = write_results(tmp_path, RESULTS)
    assert can_be_clip(path)
    outline = intercap.READER.outline
    assert outline is not None
    facts = outline(SourceFile(path))
    assert (facts.frames, facts.fps, facts.fps_stated, facts.objects) == (FRAMES, 30.0, False, (NAME,))
    assert facts.skeleton == "SMPL-X female, 10 betas"
    with pytest.raises(BodyModelError, match="female SMPL-X body model"):
        write_saved_mesh(path, SEEN)
        read_clip(path)
    with pytest.raises(ArgumentError, match="this one names chair"):
        read_clip(path, ReadOptions(object_name="chair"))


def test_one_row_of_betas_is_enough(tmp_path, models):
    clip = read_clip(written(tmp_path, RESULTS | {"betas": np.zeros((1, 10))}), ReadOptions(body_models=models))
    assert_same_people(clip, CLIP)


LIST = frames_of(RESULTS)
OTHER = np.concatenate([np.zeros((FRAMES - 5, 10)), np.full((5, 10), 3.0)])


@pytest.mark.parametrize(
    ("results", "words"),
    [
        ({key: RESULTS[key] for key in RESULTS if key != "transl"}, "transl, the body's position, is missing"),
        (RESULTS | {"transl": RESULTS["transl"][1:]}, r"transl.* has shape \(60, 3\), expected \(61, 3\)"),
        (RESULTS | {"ob_pose": RESULTS["ob_pose"][1:]}, r"ob_pose.* has shape \(60, 3\)"),
        (RESULTS | {"ob_trans": [np.zeros(3)] * 60 + [np.full(3, np.inf)]}, "ob_trans.*not finite"),
        (RESULTS | {"ob_trans": [np.zeros(3)] * 60 + [np.zeros(2)]}, r"ob_trans has shape \(0,\) of object"),
        (RESULTS | {"ob_trans": [None] * FRAMES}, "ob_trans has shape"),
        (RESULTS | {"ob_trans": "nowhere"}, "ob_trans has shape"),
        (RESULTS | {"ob_trans": np.array(RESULTS["ob_trans"]).T}, r"ob_trans has shape \(3, 61\)"),
        (RESULTS | {"betas": np.zeros((FRAMES, 16))}, r"betas has shape \(61, 16\).*expected 10"),
        (RESULTS | {"betas": np.zeros((5, 10))}, r"betas.* has shape \(5, 10\), expected \(61, 10\)"),
        (RESULTS | {"betas": OTHER}, "Are these frames of several people"),
        (RESULTS | {"left_hand_pose": np.zeros((FRAMES, 45))}, "left_hand_pose has shape .*expected 12"),
        (LIST[:3], r"too few frames \(recording: 3\)"),
        ([*LIST[:-1], {}], "frame 60 has not one global_orient, but 0"),
        ([*LIST[:-1], None], "frame 60 has not one global_orient"),
        ([*LIST[:-1], LIST[0] | {"transl": np.zeros((2, 3))}], "frame 60 has not one transl, but 2"),
        ([*LIST[:-1], LIST[0] | {"ob_pose": np.zeros(4)}], "frame 60.s ob_pose has shape .4,"),
    ],
)
def test_what_cannot_be_used_is_refused(tmp_path, models, results, words):
    with pytest.raises(ClipError, match=words):
        read_clip(written(tmp_path, results), ReadOptions(body_models=models))


@pytest.mark.parametrize("results", [[], {}, [{"body_pose": 1}], {"poses": np.zeros((9, 156))}, [1, 2], "text"])
def test_other_pickles_are_not_ours(tmp_path, results):
    path = write_results(tmp_path, results)
    assert not can_be_clip(path)
    with pytest.raises(ReadError):
        read_clip(path)
