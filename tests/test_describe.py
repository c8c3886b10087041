"""What `inspect` says of real, written, damaged and foreign files, and of data sets' own."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import behave_writer
import core4d_writer
import motion_writers
import omomo_writer
from hoi_retarget.batch.jobs import jobs_of
from hoi_retarget.batch.specification import of_folder
from hoi_retarget.cli import main
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.human.skeleton import FINGER_PARTS, PARTS
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.motion.result_file import load, save
from hoi_retarget.readers import read_clip
from hoi_retarget.readers.describe import Inspection, inspect
from hoi_retarget.readers.open import result_stem
from hoi_retarget.robots import load_robot
from intermimic_writer import columns_of, random_clip, write_box, write_clip
from npz_changes import changed
from source_people import write_models
from synthetic import make
from torch_writer import legacy_bytes, torch_bytes

SHARED = Path(__file__).resolve().parents[1].parent / "shared" / "data"
NEEDS_SHARED = pytest.mark.skipif(not SHARED.is_dir(), reason=f"no real recordings at {SHARED}")


@pytest.fixture
def folder(tmp_path):
    write_box(tmp_path / "objects", "box")
    return tmp_path


def multi(frames: int = 6, names: tuple[str, ...] = ("cup_base", "desk_base")) -> dict:
    """Return a dictionary of several objects as InterMimic's forks write it."""
    single = columns_of(random_clip(frames=frames))
    data = np.zeros((frames, 526 + 65 * len(names)), dtype=np.float32)
    data[:, :318] = single[:, :318]
    data[:, 318:526] = single[:, 383:591]
    for index in range(len(names)):
        block = data[:, 526 + 65 * index : 526 + 65 * (index + 1)]
        block[:, :7] = single[:, 318:325]
        block[:, 12:65] = single[:, 330:383]
    states = {"type": "hinge", "states": np.zeros(9)}
    return {"objects": list(names), "data": data, "joints": {"lid": states}, "metadata": {"expression": "Pour"}}


def result() -> Motion:
    return Motion(
        robot="unitree_g1",
        fps=50.0,
        joint_names=load_robot("unitree_g1").joint_names,
        stages=(Stage("ik", np.full((6, 36), 0.5)), Stage("trajectory", np.full((6, 36), 0.5))),
        object_names=("box",),
        object_pos=np.linspace(0, 1, 18).reshape(6, 1, 3),
        object_quat=np.full((6, 1, 4), 0.5),
        object_scale=np.ones(1),
        contact_links=("left_palm",),
        contact_flags=np.array([[0], [1], [1], [0], [1], [0]], dtype=bool),
        contact_object=np.zeros((6, 1), dtype=int),
        contact_points=np.zeros((6, 1, 3)),
        stance_flags=np.zeros((6, 2), dtype=bool),
        first_source_frame=0,
        human_height=1.7,
    )


def test_a_written_clip_is_described(folder):
    path = folder / "sub1_box_000.pt"
    clip = random_clip()
    write_clip(clip, path)
    facts = inspect(path, ReadOptions(objects=folder / "objects"))
    assert (facts.format, facts.frames, facts.fps, facts.fps_stated) == ("intermimic-591", 12, 30.0, False)
    assert facts.height == pytest.approx(clip.people[0].height, abs=1e-5)
    assert facts.lowest_joint == pytest.approx(clip.people[0].joint_positions[..., 2].min(), abs=1e-5)
    (item,) = facts.objects
    assert (item.name, item.has_geometry) == ("box", True)
    assert item.lowest is not None
    assert "box.obj" in item.geometry
    again = read_clip(path, ReadOptions(objects=folder / "objects"))
    assert {fact.part: (fact.frames, fact.segments) for fact in facts.contacts} == {
        contact.part: (contact.active.sum(), len(contact.segments)) for contact in again.contacts
    }
    assert facts.contacts_from == "labels of the bodies: 0, 1"
    assert facts.problems == facts.missing == ()
    assert facts.command == f"hoi-retarget run {path} --objects {folder / 'objects'} --out out"


def test_without_the_objects_the_rest_is_described(folder):
    write_clip(random_clip(), folder / "sub1_box_000.pt")
    facts = inspect(folder / "sub1_box_000.pt")
    assert (facts.frames, facts.objects[0].name, facts.objects[0].has_geometry) == (12, "box", False)
    assert "Pass --objects DIR with box/box.obj" in facts.missing[0]
    assert facts.command.endswith("--objects DIR --out out")
    facts = inspect(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects", object_name="cube"))
    assert "no object 'cube'" in facts.missing[0]
    assert "--object cube" in facts.command


@pytest.mark.parametrize("content", [b"", b"v 0 0 0\nv 1 1 1\nf 1 2 9\n"])
def test_a_mesh_that_cannot_be_used_is_a_problem_and_no_command_ignores_it(folder, content):
    write_clip(random_clip(), folder / "sub1_box_000.pt")
    mesh = folder / "objects" / "box" / "box.obj"
    mesh.write_bytes(content)
    facts = inspect(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects"))
    assert str(mesh) in facts.problems[0] and not facts.missing and not facts.command


def test_without_a_name_it_asks_for_one(folder):
    write_clip(random_clip(), folder / "my clip.pt")
    facts = inspect(folder / "my clip.pt")
    assert "--object NAME" in facts.missing[0]
    assert "--object NAME" in facts.command
    assert "my clip.pt'" in facts.command  # quoted


def test_late_fingers_and_zero_frames_are_noted(folder):
    matrix = columns_of(random_clip(), late_fingers=True)
    (folder / "sub1_box_000.pt").write_bytes(torch_bytes(np.concatenate([np.zeros_like(matrix[:2]), matrix])))
    facts = inspect(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects"))
    assert any("three places late" in note for note in facts.notes)
    assert any(note.startswith("2 leading frame(s) without data") for note in facts.notes)
    assert facts.command


@pytest.mark.parametrize(
    ("row", "columns", "value", "words"),
    [
        (3, slice(0, 3), np.nan, "not finite in 1 frame (3)"),
        (3, slice(383, 387), 0.0, "is zero"),
        (3, slice(331, 332), 5.0, "value(s) 5"),
        (3, slice(321, 325), 0.0, "is zero"),
        (slice(None), slice(None), np.inf, "not finite"),
        (slice(None), slice(None), 0.0, "12 frame(s), 12 of them zero"),
    ],
)
def test_problems_are_named_and_the_rest_is_described(folder, row, columns, value, words):
    matrix = columns_of(random_clip())
    matrix[row, columns] = value
    (folder / "sub1_box_000.pt").write_bytes(torch_bytes(matrix))
    facts = inspect(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects"))
    assert facts.format == "intermimic-591"
    assert facts.frames == 12
    assert words in facts.problems[0]
    assert facts.command == ""


@pytest.mark.parametrize("writer", [torch_bytes, legacy_bytes])
def test_several_objects_are_described(folder, writer):
    (folder / "clip.pt").write_bytes(writer(multi()))
    write_box(folder / "objects", "cup")
    facts = inspect(folder / "clip.pt", ReadOptions(objects=folder / "objects"))
    assert (facts.format, facts.frames) == ("intermimic-multi-object", 6)
    assert [item.name for item in facts.objects] == ["cup_base", "desk_base"]
    assert "'desk" in facts.missing[0] and not facts.problems
    write_box(folder / "objects", "desk")
    facts = inspect(folder / "clip.pt", ReadOptions(objects=folder / "objects"))
    assert [item.has_geometry for item in facts.objects] == [True, True]
    assert len(facts.contacts) == 2 * len(PARTS) + 2 * len(FINGER_PARTS)  # All joints of hands are labelled.
    assert any("lid" in note for note in facts.notes)
    assert any("Pour" in note for note in facts.notes)


def test_results_are_described(folder):
    save(result(), folder / "clip.npz")
    facts = inspect(folder / "clip.npz")
    assert (facts.format, facts.frames, facts.fps, facts.fps_stated) == ("hoi-retarget-motion", 6, 50.0, True)
    assert "unitree_g1" in facts.description
    assert facts.objects[0].moved > 1.0
    assert [(fact.part, fact.frames, fact.segments) for fact in facts.contacts] == [("left_palm", 3, 2)]


@pytest.mark.parametrize("name", ["gmr", "hdmi", "unitree-csv", "protomotions", "holosoma-wbt"])
def test_a_robots_motion_is_named_with_the_command_that_reads_it(name, tmp_path):
    path = motion_writers.write(name, tmp_path)
    facts = inspect(path)
    assert (facts.format, facts.frames, facts.problems) == (name, motion_writers.motion().frames, ())
    assert facts.command == f"hoi-retarget check-motion {path}"


def test_files_of_no_known_format(folder):
    np.savez(folder / "other.npz", a=np.zeros(3))
    (folder / "table.csv").write_text("a,b\n1,2\n")
    (folder / "skillmimic.pt").write_bytes(torch_bytes(np.zeros((4, 337))))
    (folder / "flat.pt").write_bytes(torch_bytes(np.zeros(4)))
    (folder / "list.pt").write_bytes(torch_bytes([1, 2]))
    (folder / "dict.pt").write_bytes(torch_bytes({**multi(), "objects": ["one"]}))
    (folder / "whole.pt").write_bytes(torch_bytes({"data": 1, "objects": 2}))
    for name, words in (
        ("other.npz", "'a'"),
        ("table.csv", "8 bytes"),
        ("skillmimic.pt", "SkillMimic"),
        ("flat.pt", "(4,)"),
        ("list.pt", "a list"),
        ("dict.pt", "dictionary"),
        ("whole.pt", "'data', 'objects'"),
    ):
        facts = inspect(folder / name)
        assert facts.format == "unknown"
        assert words in facts.description
        assert facts.problems
        assert facts.command == ""


def test_integer_tensors_are_a_problem_not_a_crash(folder):
    (folder / "sub1_box_000.pt").write_bytes(torch_bytes(np.ones((5, 591), dtype=np.int64)))
    assert "int64" in inspect(folder / "sub1_box_000.pt").problems[0]
    (folder / "sub1_box_000.pt").write_bytes(torch_bytes(np.ones((5, 591), dtype=bool)))
    assert "bool" in inspect(folder / "sub1_box_000.pt").problems[0]


def test_missing_and_damaged_files(folder):
    for name, content in (("a.pt", b""), ("b.npz", b""), ("c.npz", b"PK\x03\x04xx"), ("d.pt", b"PK\x03\x04xx")):
        (folder / name).write_bytes(content)
        with pytest.raises(ReadError, match=name):
            inspect(folder / name)
    with pytest.raises(ReadError, match="no such file"):
        inspect(folder / "absent.pt")


def _seeds() -> dict[str, bytes]:
    return {".pt": torch_bytes(columns_of(random_clip(frames=4))), "multi.pt": torch_bytes(multi(frames=4))}


@pytest.mark.slow
@settings(derandomize=True, deadline=None, max_examples=100, database=None)
@given(st.data())
def test_damaged_bytes_are_described_or_refused(tmp_path_factory, data):
    folder = tmp_path_factory.getbasetemp() / "inspected"
    write_box(folder / "objects", "box")
    save(result(), folder / "seed.npz")
    seeds = {**_seeds(), ".npz": (folder / "seed.npz").read_bytes()}
    suffix = data.draw(st.sampled_from(sorted(seeds)))
    content = bytearray(seeds[suffix])
    for _ in range(data.draw(st.integers(1, 4))):
        position = data.draw(st.integers(0, len(content)))
        content[position : position + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    path = folder / f"sub1_box_000{suffix}"
    path.write_bytes(bytes(content[: data.draw(st.integers(0, len(content)) | st.just(len(content)))]))
    try:
        assert isinstance(inspect(path, ReadOptions(objects=folder / "objects")), Inspection)
    except ReadError as error:
        assert str(path) in str(error)


@settings(derandomize=True, deadline=None, max_examples=80, database=None)
@given(st.data())
def test_any_numbers_are_described(tmp_path_factory, data):
    folder = tmp_path_factory.getbasetemp() / "numbers"
    write_box(folder / "objects", "box")
    matrix = columns_of(random_clip(frames=5)).astype(float)
    for _ in range(data.draw(st.integers(1, 4))):
        row = data.draw(st.integers(0, 4) | st.just(slice(None)))
        first = data.draw(st.integers(0, 590))
        matrix[row, first : first + data.draw(st.integers(1, 300))] = data.draw(st.floats(width=64))
    path = folder / "sub1_box_000.pt"
    path.write_bytes(torch_bytes(matrix))
    facts = inspect(path, ReadOptions(objects=folder / "objects"))
    assert bool(facts.command) != bool(facts.problems)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda points: points, None),
        (lambda points: points[..., [1, 2, 0]], "along y"),
        (lambda points: points * [1.0, -1.0, -1.0], "along -z"),
        (lambda points: points + np.array([0.0, 0.0, 1.0]), "mostly at 1."),
    ],
)
def test_what_contradicts_z_up_is_a_warning(folder, change, words):
    matrix = columns_of(make("carry_box", seconds=3.0)).astype(float)
    matrix[:, 162:318] = change(matrix[:, 162:318].reshape(-1, 52, 3)).reshape(len(matrix), -1)
    matrix[:, :3] = matrix[:, 162:165]
    (folder / "sub1_box_000.pt").write_bytes(torch_bytes(matrix))
    facts = inspect(folder / "sub1_box_000.pt", ReadOptions(objects=folder / "objects"))
    assert facts.up_axis == "z, by the format"
    assert (words in facts.warnings[0]) if words else not facts.warnings


@pytest.mark.slow
@NEEDS_SHARED
def test_bending_is_no_other_up_axis():
    paths = sorted((SHARED / "omomo").glob("*.pt"))
    assert paths
    for path in paths:
        facts = inspect(path, ReadOptions(objects=SHARED / "objects"))
        assert (facts.up_axis, facts.warnings) == ("z, by the format", ()), path


@NEEDS_SHARED
def test_real_clips_are_described():
    facts = inspect(SHARED / "omomo" / "sub3_largebox_003.pt", ReadOptions(objects=SHARED / "objects"))
    assert facts.frames == 196
    assert facts.height == pytest.approx(1.94, abs=0.025)
    assert facts.lowest_joint == pytest.approx(0.0, abs=0.06)
    assert facts.objects[0].moved > 0.5
    assert facts.objects[0].lowest == pytest.approx(0.0, abs=0.02)
    assert facts.contacts_from == "labels of the bodies: -1, 0, 1"
    assert facts.problems == facts.missing == ()
    assert sum(contact.frames for contact in facts.contacts) > 100


@NEEDS_SHARED
def test_real_clips_of_several_objects_are_described():
    paths = sorted((SHARED / "parahome").glob("*.pt"))
    assert len(paths) == 3
    for path in paths:
        facts = inspect(path, ReadOptions(objects=SHARED / "parahome" / "objects"))
        assert len(facts.objects) == 3
        assert all(item.has_geometry for item in facts.objects)
        assert (facts.up_axis, facts.warnings) == ("z, by the format", ())
        assert facts.height is not None
        assert 1.4 < facts.height < 2.1
        labels = facts.contacts_from.removeprefix("labels of the bodies: ").split(", ")
        assert set(map(int, labels)) <= set(range(-1, 7))
        assert sum(item.moved > 0.1 for item in facts.objects) == 1
        for field in dataclasses.fields(facts):
            assert field.name == "result" or getattr(facts, field.name) is not None


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
        two_people, ReadOptions(objects=None, object_name=None, body_models=None, floor=0.1, labels="proximity")
    )
    assert facts.command == f"hoi-retarget run {two_people} --floor 0.1 --labels proximity --out out"


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
