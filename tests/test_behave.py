"""BEHAVE's recordings: written and read back, their conventions, and what is refused."""

import json

import numpy as np
import pytest

from behave_writer import CATEGORY, FIRST_FRAME, GENDER, SEQUENCE, files_of, renamed, times_of, write_files, write_mesh
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, BodyModelError, ClipError, GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.readers import behave, can_be_clip, clips_in, read_clip
from hoi_retarget.readers.behave import GENDERS, MESHES
from hoi_retarget.readers.body_parameters import load_body_model
from short_clips import cut
from source_people import assert_same_objects, assert_same_people, write_models
from synthetic import make

CLIP = renamed(make("move_chair", seconds=2.0), CATEGORY)
FRAMES = CLIP.frames


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    return write_models(tmp_path_factory.mktemp("models"), CLIP.people, "smplh", ["male", "female"])


@pytest.fixture
def root(tmp_path):
    write_mesh(tmp_path, CLIP)
    return tmp_path


def changed(file: str, **arrays) -> dict:
    """The files with other arrays; None leaves one out."""
    files = files_of(CLIP)
    files[file] = {name: values for name, values in (files[file] | arrays).items() if values is not None}
    return files


def test_what_is_written_is_read(root, models):
    clip = read_clip(write_files(root, files_of(CLIP)), ReadOptions(body_models=models))
    assert_same_people(clip, CLIP)
    assert_same_objects(clip, CLIP)
    assert (clip.name, clip.fps, clip.contacts, clip.first_source_frame) == (SEQUENCE, 30.0, (), 0)
    assert (clip.source.format, len(clip.source.sha256)) == ("behave", 64)
    assert "non-commercial" in clip.source.licence
    assert any("tilted is not known" in note for note in clip.source.notes)
    assert len(clip.source.notes) == 1
    assert np.allclose(clip.objects[0].geometry.points.mean(axis=0), 0.0, atol=1e-7)


def test_meshes_are_found_where_the_user_says_beside_the_recording_and_above_it(root, models, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    folder = write_files(elsewhere, files_of(CLIP))
    with pytest.raises(GeometryError, match=r"chairwood_f2500\.ply"):
        read_clip(folder, ReadOptions(body_models=models))
    for objects in (root / "objects", root / "objects" / CATEGORY):
        assert_same_objects(read_clip(folder, ReadOptions(objects=objects, body_models=models)), CLIP)
    write_mesh(elsewhere / "sequences", CLIP)
    assert_same_objects(read_clip(folder, ReadOptions(body_models=models)), CLIP)


def test_the_meshes_are_those_of_the_makers():
    assert MESHES["monitor"] == "monitor_closed_f1000.ply"
    assert MESHES["tablesquare"] == "tablesquare_f2000.ply"
    assert MESHES["backpack"] == "backpack_f1000.ply"
    assert len(MESHES) == 20
    assert (GENDERS["05"], GENDERS["06"], "09" in GENDERS) == ("male", "female", False)


def test_frames_are_joined_by_their_times(root, models):
    files = files_of(CLIP)
    # The object could not be fitted in some frames at the end and at the beginning.
    files["object_fit_all"] |= {key: files["object_fit_all"][key][3:-5] for key in ("angles", "trans", "frame_times")}
    files["smpl_fit_all"] |= {
        key: files["smpl_fit_all"][key][:-1] for key in ("poses", "betas", "trans", "frame_times")
    }
    clip = read_clip(write_files(root, files), ReadOptions(body_models=models))
    assert_same_people(clip, cut(CLIP, FRAMES - 5, 3))
    assert_same_objects(clip, cut(CLIP, FRAMES - 5, 3))
    assert clip.first_source_frame == 3
    assert any("7 frame(s) that only smpl_fit_all.npz has are left out" in note for note in clip.source.notes)


def test_each_stretch_between_gaps_is_a_clip(root, models):
    files, kept = files_of(CLIP), np.r_[0:20, 23:25, 30:FRAMES]
    files["object_fit_all"] |= {key: files["object_fit_all"][key][kept] for key in ("angles", "trans", "frame_times")}
    folder = write_files(root, files)
    names = [path.name for path in clips_in(folder)]
    assert names == [f"{SEQUENCE}#0090-0109", f"{SEQUENCE}#0120-{FIRST_FRAME + FRAMES - 1:04d}"]
    for name, rows in zip(names, (slice(0, 20), slice(30, FRAMES)), strict=True):
        clip = read_clip(folder.parent / name, ReadOptions(body_models=models))
        assert_same_people(clip, cut(CLIP, rows.stop, rows.start))
        assert_same_objects(clip, cut(CLIP, rows.stop, rows.start))
        assert (clip.first_source_frame, clip.name) == (rows.start, name.replace("#", "_"))
        assert any(f"has gaps; this is the stretch from {3 + rows.start / 30:.3f}" in it for it in clip.source.notes)
    with pytest.raises(ArgumentError, match="2 clips in it"):
        read_clip(folder, ReadOptions(body_models=models))
    with pytest.raises(ArgumentError, match="no clip '0090-0111'"):
        read_clip(folder.parent / f"{SEQUENCE}#0090-0111", ReadOptions(body_models=models))
    outline = behave.READER.outline
    assert outline is not None
    assert outline(SourceFile(folder.parent / names[0])).frames == 20
    assert outline(SourceFile(folder)).frames == 20 + FRAMES - 30


def test_betas_of_every_frame_are_used(root, models):
    rng = np.random.default_rng(0)
    betas = 0.3 * rng.normal(size=(FRAMES, 10))
    files = changed("smpl_fit_all", betas=betas)
    clip = read_clip(write_files(root, files), ReadOptions(body_models=models))
    model, poses = load_body_model(models, GENDER, "smplh"), files["smpl_fit_all"]["poses"]
    pose = model.pose(poses[:, :66], poses[:, 66:111], poses[:, 111:], flat_hands=True)
    for frame in range(0, FRAMES, 7):
        row = slice(frame, frame + 1)
        positions, _ = model.joints(betas[frame], pose[row], files["smpl_fit_all"]["trans"][row])
        x, y, z = positions[0].T
        assert np.allclose(clip.people[0].joint_positions[frame], np.stack([x, z, -y], axis=1), atol=1e-9)
    assert any("betas change by up to" in note for note in clip.source.notes)


def test_info_tells_where_the_name_does_not(root, models):
    folder = write_files(root, files_of(CLIP), "mine")
    with pytest.raises(ClipError, match=r"neither the folder's name nor info\.json tells the person's gender"):
        read_clip(folder, ReadOptions(body_models=models))
    (folder / "info.json").write_text(json.dumps({"gender": GENDER, "cat": CATEGORY, "beta": None}))
    assert_same_people(read_clip(folder, ReadOptions(body_models=models)), CLIP)


def test_what_it_holds_is_told_without_models(root):
    folder = write_files(root, files_of(CLIP))
    assert can_be_clip(folder)
    assert not can_be_clip(folder.parent)
    outline = behave.READER.outline
    assert outline is not None
    facts = outline(SourceFile(folder))
    assert (facts.frames, facts.fps, facts.fps_stated, facts.objects) == (FRAMES, 30.0, True, (CATEGORY,))
    assert "SMPL-H male, 10 betas" in facts.skeleton


POSES = files_of(CLIP)["smpl_fit_all"]["poses"]
OTHER = np.concatenate([np.zeros((FRAMES - 5, 10)), np.tile(np.full(10, 3.0), (5, 1))])


@pytest.mark.parametrize(
    ("files", "words"),
    [
        (changed("smpl_fit_all", poses=None), "poses, the body.s pose.* is missing"),
        (changed("smpl_fit_all", poses=POSES[:, :72]), r"poses.* has shape \(61, 72\), expected \(61, 156\)"),
        (changed("smpl_fit_all", poses=POSES[1:]), r"poses.* has shape \(60, 156\)"),
        (changed("smpl_fit_all", betas=np.zeros((FRAMES, 16))), r"betas.* has shape \(61, 16\), expected \(61, 10\)"),
        (changed("smpl_fit_all", betas=OTHER), "Are these frames of several people"),
        (changed("smpl_fit_all", trans=np.full((FRAMES, 3), np.nan)), "trans.*not finite"),
        (changed("smpl_fit_all", trans=np.array("no")), "trans.*expected numbers"),
        (changed("object_fit_all", angles=np.zeros((FRAMES, 3, 3))), r"angles.* has shape \(61, 3, 3\)"),
        (changed("object_fit_all", trans=None), "trans, the object's position, is missing"),
        (changed("object_fit_all", frame_times=None), "frame_times, when the frames are, is no list of texts"),
        (changed("object_fit_all", frame_times=np.arange(FRAMES)), "frame_times.* is no list of texts"),
        (changed("object_fit_all", frame_times=np.array(["soon"] * FRAMES)), "are not times in order"),
        (changed("object_fit_all", frame_times=times_of(range(FRAMES))[::-1]), "are not times in order"),
        (changed("object_fit_all", frame_times=times_of(np.arange(FRAMES) + 0.3)), "only.*at 30 frames a second"),
        (changed("object_fit_all", frame_times=times_of(range(3000, 3000 + FRAMES))), "have no 4 frames in common"),
        (changed("object_fit_all", frame_times=times_of(range(0, 3 * FRAMES, 3))), "have no 4 frames in common"),
        (files_of(CLIP, up="y"), "stands along -z, turned to z up from -y up"),
        (files_of(CLIP, up="z"), "stands along -?y, turned to z up from -y up"),
    ],
)
def test_what_cannot_be_used_is_refused(root, models, files, words):
    with pytest.raises(ClipError, match=f"(?i){words}"):
        read_clip(write_files(root, files), ReadOptions(body_models=models))


@pytest.mark.parametrize(
    ("sequence", "info", "words"),
    [
        ("Date03_Sub09_chairwood", None, "tells the person's gender"),
        ("Date03_Sub04", None, "tells the person's gender"),
        ("Date03_Sub04_sofa", None, "'sofa' is none of BEHAVE's objects"),
        (SEQUENCE, {"gender": "female"}, "gender is 'female', but the folder's name says 'male'"),
        (SEQUENCE, {"cat": "backpack"}, "cat is 'backpack', but the folder's name says 'chairwood'"),
        (SEQUENCE, {"gender": 1}, "gender.* is int, expected a text"),
        ("mine", {"gender": "other", "cat": CATEGORY}, "no gender 'other'"),
        ("mine", {"gender": "neutral", "cat": CATEGORY}, "no neutral smplh model"),
        ("mine", {"gender": "male", "cat": "../../etc"}, "is none of BEHAVE's objects"),
        (SEQUENCE, [], "expected an object"),
    ],
)
def test_subject_and_object_are_not_guessed(root, models, sequence, info, words):
    folder = write_files(root, files_of(CLIP), sequence)
    if info is not None:
        (folder / "info.json").write_text(json.dumps(info))
    with pytest.raises((ClipError, ReadError), match=words):
        read_clip(folder, ReadOptions(body_models=models))


def test_what_is_missing_is_named(root, models):
    folder = write_files(root, files_of(CLIP))
    with pytest.raises(BodyModelError, match="male SMPL-H body model"):
        read_clip(folder)
    with pytest.raises(ArgumentError, match="this one names chairwood"):
        read_clip(folder, ReadOptions(object_name="chair", body_models=models))
    (folder / "object_fit_all.npz").write_bytes(b"PK no archive")
    with pytest.raises(ReadError, match=r"object_fit_all\.npz: not a readable \.npz"):
        read_clip(folder, ReadOptions(body_models=models))
    (folder / "object_fit_all.npz").unlink()
    with pytest.raises(ReadError, match="looks like a recording of behave, but lacks object_fit_all"):
        read_clip(folder, ReadOptions(body_models=models))
