"""What `inspect` says of data sets' own files: whole, lacking something, of several clips, or of somebody else."""

import json
from pathlib import Path

import numpy as np
import pytest

import behave_writer
import core4d_writer
import omomo_writer
from hoi_retarget.batch.jobs import jobs_of
from hoi_retarget.batch.specification import of_folder
from hoi_retarget.cli import main
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError
from hoi_retarget.motion.result_file import load
from hoi_retarget.readers.describe import inspect
from hoi_retarget.readers.open import result_stem
from hoi_retarget.synthetic import make
from npz_changes import changed
from source_people import write_models


@pytest.fixture(scope="module")
def two_people(tmp_path_factory):
    sequence, _, _ = core4d_writer.write_world(tmp_path_factory.mktemp("core4d"), make("carry_table", fps=15.0))
    return sequence


@pytest.fixture(scope="module")
def many_clips(tmp_path_factory):
    folder = tmp_path_factory.mktemp("omomo")
    clip = make("carry_box", seconds=2.0)
    omomo_writer.write_scan(folder, "box_cleaned_simplified", clip.objects[0])
    return omomo_writer.write_clips(folder, [omomo_writer.clip_values(clip, f"sub3_box_00{i}") for i in range(2)])


def test_a_whole_recording_is_described(two_people):
    facts = inspect(two_people)
    assert facts.format == "core4d" and facts.frames == 113 and facts.fps == 15.0 and not facts.problems
    assert "two people" in facts.description and facts.contacts_from == "none stored"
    assert {contact.part for contact in facts.contacts if contact.frames} == {
        *("left_hand", "right_hand"),
        *("p1.left_hand", "p1.right_hand"),
    }
    assert facts.command == f"hoi-retarget run {two_people} --out out"
    assert any(note.startswith("The floor is at z = ") for note in facts.notes)
    assert any(note.startswith("Contacts are found from distances") for note in facts.notes)


def test_what_is_asked_for_is_in_the_command(two_people):
    facts = inspect(
        two_people, ReadOptions(objects=None, object_name=None, body_models=None, floor=0.1, labels="interact")
    )
    assert facts.command == f"hoi-retarget run {two_people} --floor 0.1 --labels interact --out out"


def test_a_recording_that_lacks_its_body_model_or_mesh_says_so_and_what_it_is(tmp_path):
    clip = make("carry_box", seconds=2.0)
    folder = behave_writer.write_files(tmp_path, behave_writer.files_of(clip))
    mesh = behave_writer.write_mesh(tmp_path, clip)
    facts = inspect(folder)
    assert facts.format == "behave" and facts.frames == clip.frames and not facts.problems
    assert len(facts.missing) == 1 and "body model" in facts.missing[0] and "--body-models DIR" in facts.command
    models = write_models(tmp_path / "models", clip.people, "smplh", ["male", "female"])
    assert not inspect(folder, ReadOptions(body_models=models)).missing
    mesh.unlink()
    facts = inspect(folder, ReadOptions(body_models=models))
    assert len(facts.missing) == 1 and "mesh" in facts.missing[0] and "--objects DIR" in facts.command
    assert not facts.objects[0].has_geometry and facts.objects[0].moved is None


def test_a_recording_that_cannot_be_used_is_still_told_from_others(tmp_path):
    folder = behave_writer.write_files(tmp_path, behave_writer.files_of(make("carry_box", seconds=2.0)))
    changed(folder / "object_fit_all.npz", frame_times=np.zeros(3))
    facts = inspect(folder)
    assert facts.format == "behave" and not facts.command
    assert len(facts.problems) == 1 and "frame_times" in facts.problems[0]


def test_a_file_of_several_clips_names_them_and_each_can_be_chosen(many_clips, capsys):
    facts = inspect(many_clips)
    assert facts.description == "2 clips in one recording" and not facts.command
    assert any("sub3_box_000, sub3_box_001" in note for note in facts.notes)
    one = Path(f"{many_clips}#sub3_box_001")
    assert inspect(one).command == f"hoi-retarget run '{one}' --out out" and result_stem(one) == "sub3_box_001"
    for name, message in (("sub3_box_002", "Did you mean 'sub3_box_00"), ("", "no clip ''")):
        with pytest.raises(ArgumentError, match=message):
            inspect(Path(f"{many_clips}#{name}"))
    assert main(["inspect", str(many_clips)]) == 0
    assert "One of them: hoi-retarget inspect" in capsys.readouterr().out


def test_clips_are_run_by_their_names_alone_or_all_by_a_batch(many_clips, tmp_path, capsys):
    assert main(["run", str(many_clips), "--out", str(tmp_path)]) == 2
    assert "there are 2 clips in it (sub3_box_000, sub3_box_001)" in capsys.readouterr().err
    assert main(["run", f"{many_clips}#sub3_box_000", "--out", str(tmp_path)]) == 0
    motion = load(tmp_path / "sub3_box_000.npz")
    assert motion.report.source.format == "omomo" and np.isfinite(motion.qpos).all()
    names = [job.name for job in jobs_of(of_folder(many_clips.parent))]
    assert names == ["unitree_g1/sub3_box_000", "unitree_g1/sub3_box_001"]


@pytest.mark.slow
def test_a_batch_makes_anew_what_any_file_of_a_recording_changed(tmp_path, capsys):
    """And tries again what lacked a file, which is not known until it is there."""
    clip = make("carry_box", seconds=1.0)
    recordings, out = tmp_path / "recordings", tmp_path / "out"
    folder = behave_writer.write_files(recordings, behave_writer.files_of(clip))
    write_models(tmp_path / "models", clip.people, "smplh", ["male", "female"])
    specification = tmp_path / "set.toml"
    specification.write_text(f'clips = ["{folder}"]\nbody_models = "models"\n')
    words = ["batch", str(specification), "--workers", "1", "--out", str(out)]

    def entries() -> list[dict]:
        main(words)
        return [json.loads(line) for line in (out / "manifest.jsonl").read_text().splitlines()]

    (lacking,) = entries()
    assert lacking["status"] == "failed" and lacking["error"] == "GeometryError"
    mesh = behave_writer.write_mesh(recordings, clip)
    (done,) = entries()
    assert done["status"] == "solved" and str(mesh) in done["source"]["files"]
    assert any(name.endswith("object_fit_all.npz") for name in done["source"]["files"])
    assert entries() == [done]
    mesh.write_bytes(mesh.read_bytes().replace(b"end_header", b"comment changed\nend_header"))
    (again,) = entries()
    assert again["key"] != done["key"] and again["results"][0]["figures"] == done["results"][0]["figures"]
    capsys.readouterr()


def test_folders_that_are_clips_are_jobs_of_a_batch(two_people):
    """The files in them are not, although some end like clips."""
    (job,) = jobs_of(of_folder(two_people.parents[1]))
    assert Path(job.clip) == two_people.absolute()
    assert job.name == f"unitree_g1/{two_people.parent.name}/{two_people.name}"


def test_a_folder_of_recordings_is_counted_with_the_command_that_makes_all(two_people, tmp_path, capsys):
    top = two_people.parents[1]
    facts = inspect(top)
    assert facts.description == "1 recording: 1 core4d" and facts.command == f"hoi-retarget batch {top} --out out"
    assert f"{two_people.parent.name}/{two_people.name}" in facts.notes[0]
    (tmp_path / "broken.pt").write_bytes(b"PK")
    (tmp_path / "text.txt").write_text("nothing")
    assert inspect(tmp_path).description == "1 recording: 1 unreadable"
    (tmp_path / "broken.pt").unlink()
    assert main(["inspect", str(tmp_path)]) == 1
    assert "There is no clip in it or below" in capsys.readouterr().err
