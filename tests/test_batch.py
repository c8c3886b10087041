"""Batches: what is made, what is made again, and what is left of a clip that fails. Processes have their own tests."""

import errno
import json
import re
import resource
import time
import tomllib
from dataclasses import asdict, fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.batch import work
from hoi_retarget.batch.jobs import jobs_of
from hoi_retarget.batch.manifest import MANIFEST, STATUSES, Manifest, ManifestEntry, ManifestSource, read_manifest
from hoi_retarget.batch.pool import LocalPool, LostTask
from hoi_retarget.batch.run_batch import locked, run_batch
from hoi_retarget.batch.specification import Specification, of_folder, read_specification
from hoi_retarget.batch.work import run_job
from hoi_retarget.cli import main
from hoi_retarget.clip.clip import Augmentation
from hoi_retarget.clip.edits import ContactEdits, FixAll, save
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.dynamics.physics_settings import Refinement
from hoi_retarget.errors import ArgumentError, HoiRetargetError, ReadError, WriteError
from hoi_retarget.evaluation import FIGURES
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import load
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers import own_layout
from hoi_retarget.readers.open import clip_of, open_clip
from hoi_retarget.retargeting.config import Config, Weights
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.retargeting.trajopt.solvers.solver import KeepStart
from hoi_retarget.robots import ROBOTS
from hoi_retarget.robots.model import load_model
from intermimic_writer import columns_of, write_box
from synthetic import make
from torch_writer import torch_bytes


class Inline(LocalPool):
    """A pool in this process."""

    def __init__(self, time_limit: float | None = 60.0) -> None:
        super().__init__(run_job, 1, time_limit)

    def run(self, tasks, stopped):
        for index, task in enumerate(tasks):
            if stopped():
                return
            yield index, run_job(task)


class Losing(Inline):
    """A pool that loses every task."""

    def __init__(self, status: str, time_limit: float | None = 60.0) -> None:
        super().__init__(time_limit)
        self.status = status

    def run(self, tasks, stopped):
        for index, _ in enumerate(tasks):
            yield index, LostTask(self.status, "as it should", 1.0)


@pytest.fixture(scope="session")
def columns() -> np.ndarray:
    return columns_of(make("carry_box", seconds=1.0))


@pytest.fixture
def folder(tmp_path, columns, monkeypatch):
    """The current folder, with two clips in `clips` and their object."""
    write_box(tmp_path / "clips" / "objects", "box")
    for number in range(2):
        (tmp_path / "clips" / f"sub1_box_00{number}.pt").write_bytes(torch_bytes(columns[number:]))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def motion() -> Motion:
    return retarget(make("carry_box", seconds=1.0), load_model(ROBOTS["unitree_g1"]), Config())


@pytest.fixture
def quick(folder, motion, monkeypatch):
    """The same folder, where nothing is solved: every clip gets the frames of one motion."""
    timed = [
        field.name for field in fields(Motion) if np.ndim(getattr(motion, field.name)) > 1 or "flags" in field.name
    ]

    def canned(clip, _model, _config, *, command):
        frames = {
            name: np.resize(getattr(motion, name), (clip.frames, *getattr(motion, name).shape[1:])) for name in timed
        }
        stages = tuple(
            replace(stage, qpos=np.resize(stage.qpos, (clip.frames, 36)), windows=()) for stage in motion.stages
        )
        return (replace(motion, stages=stages, **frames).with_report(command=command),) * len(clip.people)

    monkeypatch.setattr(work, "retarget_people", canned)
    return folder


OUT = Path("out")
ROOT = Path(__file__).parents[1]


def batch(pool=None, **changes):
    """Run the folder's batch, and check what holds after every one."""
    summary = run_batch(replace(of_folder(Path("clips")), **changes), OUT, pool or Inline())
    entries = read_manifest(OUT)
    assert len((OUT / MANIFEST).read_text().splitlines()) == len(entries)
    assert summary.is_complete and all(entries[entry.name] == entry for entry in summary.entries)
    for entry in entries.values():
        assert entry.status in STATUSES and entry.succeeded == bool(entry.results)
        assert entry.succeeded or entry.reason
        for result in entry.results:
            assert load(OUT / result.path).frames == entry.frames
    listed = {result.path for entry in entries.values() for result in entry.results}
    there = {path.relative_to(OUT).as_posix() for path in OUT.rglob("*") if path.is_file()}
    assert there == listed | {MANIFEST, ".batch.lock"}, "no temporary files, nothing unlisted"
    return summary


def names(summary) -> list[str]:
    return [entry.name for entry in summary.done_now]


# what is asked for


def test_the_grid_is_every_combination_and_names_say_what_differs():
    grid = Specification(
        clips=("builtin:carry_box",),
        robots=("unitree_g1", "unitree_h2"),
        object_scales=("auto", 1.0),
        size_multipliers=(1.0, 0.75),
        mirrored=(False, True),
        speeds=(1.0, 1.25),
    )
    found = [job.name for job in jobs_of(grid)]
    assert len(set(found)) == len(found) == 2**5
    assert found[0] == "unitree_g1/carry_box"
    assert found[-1] == "unitree_h2/carry_box-object1-size0.75-speed1.25-mirrored"


def test_clips_below_a_folder_are_called_by_their_way_from_there(folder):
    deep = folder / "clips" / "more" / "sub1_box_000.pt"
    deep.parent.mkdir()
    deep.touch()
    ways = ["more/sub1_box_000", "sub1_box_000", "sub1_box_001"]
    for specification in (of_folder(Path("clips")), Specification(clips=("clips/**/*.pt",), folder=folder)):
        assert [job.name for job in jobs_of(specification)] == [f"unitree_g1/{way}" for way in ways]
    assert (
        next(job.shown for job in jobs_of(Specification(clips=("clips",), folder=folder)))
        == "clips/more/sub1_box_000.pt"
    )
    with pytest.raises(ArgumentError, match=r"sub1_box_000\.pt and .*sub1_box_000\.pt would both"):
        jobs_of(Specification(clips=("clips/sub1_box_000.pt", "clips/more/sub1_box_000.pt"), folder=folder))
    for nothing in ("clips/objects", "gone/*.pt"):
        with pytest.raises(ArgumentError, match="there are no clips"):
            jobs_of(Specification(clips=(nothing,), folder=folder))


def test_a_specification_is_read_as_it_is_written(tmp_path):
    path = tmp_path / "set.toml"
    path.write_text(
        """
clips = ["builtin:carry_box", "recordings"]
objects = "objects"
object_name = "box"
body_models = "models"
floor = -0.02
fps = 25.0
from_robot = "unitree_h2"
labels = "proximity"
grasps = "warn"
lead_in = 1.5
lead_out = 2
about = ["chair"]
longest = 20
edits = "/elsewhere"
robots = ["unitree_h2"]
root_scale = 0.8
horizon = "whole"
object_scales = ["auto", 1]
size_multipliers = [0.5, 1.0]
mirrored = [true]
speeds = [2]
refine = true
refinement.samples = 24
seed = 3
[config.weights]
jerk = 2e-3
"""
    )
    wanted = Specification(
        clips=("builtin:carry_box", "recordings"),
        folder=tmp_path,
        objects=tmp_path / "objects",
        object_name="box",
        body_models=tmp_path / "models",
        floor=-0.02,
        fps=25.0,
        from_robot="unitree_h2",
        labels="proximity",
        grasps="warn",
        lead_in=1.5,
        lead_out=2.0,
        about=("chair",),
        longest=20.0,
        edits=Path("/elsewhere"),
        robots=("unitree_h2",),
        config=Config(weights=Weights(jerk=2e-3)),
        root_scale=0.8,
        horizon="whole",
        object_scales=("auto", 1.0),
        size_multipliers=(0.5, 1.0),
        mirrored=(True,),
        speeds=(2.0,),
        refine=True,
        refinement=Refinement(samples=24),
        seed=3,
    )
    assert read_specification(path) == wanted
    assert all(getattr(wanted, field.name) != field.default for field in fields(wanted)), "each field is in the test"


def test_a_configuration_may_be_a_file_whose_settings_its_own_keys_override(tmp_path):
    (tmp_path / "my.toml").write_text('horizon = "whole"\n[weights]\njerk = 2e-3\n[scaling]\nroot_scale = 0.7\n')
    (tmp_path / "set.toml").write_text('clips = ["builtin:carry_box"]\nconfig = "my.toml"\nroot_scale = 0.9\n')
    (job,) = jobs_of(read_specification(tmp_path / "set.toml"))
    assert (job.config.weights.jerk, job.config.horizon.text, job.config.scaling.root_scale) == (2e-3, "whole", 0.9)
    (tmp_path / "my.toml").write_text("[weights]\njrk = 1\n")
    with pytest.raises(ReadError, match=r"my\.toml: weights: there is no 'jrk'"):
        read_specification(tmp_path / "set.toml")


def test_another_setting_makes_the_jobs_anew(quick):
    batch()
    assert names(batch()) == []
    heavier = Config(weights=Weights(jerk=2e-3))
    assert len(names(batch(config=heavier))) == 2
    assert names(batch(config=heavier)) == []
    assert len(names(batch(config=Config(solver=KeepStart())))) == 2, "a solver without options is another one"


@pytest.mark.slow
def test_the_command_line_takes_a_configuration_for_a_folder(quick, capsys):
    Path("my.toml").write_text("[weights]\njerk = 2e-3\n")
    assert main(["batch", "clips", "--config", "my.toml", "--out", "set"]) == 0
    assert main(["batch", "clips", "--out", "set"]) == 0
    (Path("set.toml")).write_text('clips = ["clips"]\n')
    assert main(["batch", "set.toml", "--config", "my.toml", "--out", "set"]) == 2
    assert "--config my.toml is for a folder of clips" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "error", "match"),
    [
        ("clips = ", ReadError, "not a TOML file"),
        ("", ReadError, "'clips' is missing"),
        ('clips = ["a"]\nrobot = "unitree_g1"', ReadError, "no 'robot'. Keys there: .*clips, .*robots"),
        ('clips = "a"', ReadError, r"set\.toml: clips holds 'a'; expected a list"),
        ("clips = [1]", ReadError, r"clips\[0\] holds 1; expected a text"),
        ('clips = ["a"]\nspeeds = ["fast"]', ReadError, r"set\.toml: speeds\[0\] holds 'fast'; expected a number"),
        ('clips = ["a"]\nmirrored = [1]', ReadError, r"mirrored\[0\] holds 1; expected true or false"),
        ('clips = ["a"]\nobjects = 3', ReadError, "objects holds 3; expected a text"),
        ('clips = ["a"]\nlabels = "none"', ReadError, "labels holds 'none'; expected 'auto' or 'proximity'"),
        (
            'clips = ["a"]\nobject_scales = ["small"]',
            ReadError,
            r"scales\[0\] holds 'small'; expected a number or 'auto'",
        ),
        ('clips = ["a"]\nfolder = "b"', ReadError, "no 'folder'"),
        ("clips = []", ArgumentError, "clips is empty"),
        (f'clips = ["a"]\nspeeds = [{10**400}]', ReadError, r"speeds\[0\] holds 10+; expected a number"),
        ('clips = ["a"]\nspeeds = [1, 1.0]', ArgumentError, "the same twice"),
        ('clips = ["a"]\nspeeds = [0]', ArgumentError, "speed is 0"),
        ('clips = ["a"]\nsize_multipliers = [-1]', ArgumentError, "size-multiplier"),
        ('clips = ["a"]\nrobots = ["atlas"]', ArgumentError, "unitree_g1"),
        ('clips = ["a"]\nhorizon = "short"', ArgumentError, "horizon"),
    ],
)
def test_specifications_that_mean_nothing(tmp_path, text, error, match):
    (tmp_path / "set.toml").write_text(text)
    with pytest.raises(error, match=match):
        read_specification(tmp_path / "set.toml")


# what is made, and what is made again


def test_a_batch_makes_every_result_and_the_next_one_nothing(quick):
    assert names(batch()) == ["unitree_g1/sub1_box_000", "unitree_g1/sub1_box_001"]
    assert names(batch()) == []


def test_the_manifest_tells_where_each_result_is_from(folder):
    clip = open_clip("clips/sub1_box_000.pt", ReadOptions(objects=Path("clips/objects")))
    Path("edits").mkdir()
    save(ContactEdits.of(clip).adding(FixAll()), Path("edits/sub1_box_000.edits.toml"))
    first, second = batch(edits=Path("edits"), mirrored=(True,), speeds=(0.8,), object_scales=(1.0,)).entries
    assert (first.status, first.robot, first.fps) == ("solved", "unitree_g1", 30.0)
    assert first.source.path == "sub1_box_000.pt"
    assert (first.source.sha256, first.source.licence) == (clip.source.sha256, clip.source.licence)
    assert first.source.objects == ("box",)
    assert first.scales["object"] == [1.0] and first.scales["size_multiplier"] == 1.0
    assert first.lineage["mirrored"] is True and first.lineage["speed"] == 0.8
    assert first.lineage["contact_edits"] and not second.lineage["contact_edits"]
    assert first.verdict in ("pass", "warn", "fail") and first.results[0].verdict["level"] == first.verdict
    assert set(first.results[0].figures) == {figure.name for figure in FIGURES}
    motion = load(OUT / first.results[0].path)
    again = clip_of(motion)
    assert again.source.augmentation == Augmentation(mirrored=True, speed=0.8)
    assert again.frames == motion.frames == first.frames


def test_people_of_one_clip_are_one_job(quick):
    summary = batch(clips=("builtin:carry_table",))
    (entry,) = summary.entries
    assert [result.path for result in entry.results] == [f"unitree_g1/carry_table.p{person}.npz" for person in (0, 1)]


def test_what_changed_is_made_again_and_nothing_else(quick, columns):
    batch()
    one, two = "unitree_g1/sub1_box_000", "unitree_g1/sub1_box_001"
    Path("clips/sub1_box_001.pt").write_bytes(torch_bytes(columns[2:]))
    assert names(batch()) == [two]
    (OUT / f"{one}.npz").write_bytes((OUT / f"{one}.npz").read_bytes()[:-1])
    assert names(batch()) == [one]
    (OUT / f"{two}.npz").unlink()
    assert names(batch()) == [two]
    Path("edits").mkdir()
    clip = open_clip("clips/sub1_box_000.pt", ReadOptions(objects=Path("clips/objects")))
    save(ContactEdits.of(clip).adding(FixAll()), Path("edits/sub1_box_000.edits.toml"))
    assert names(batch(edits=Path("edits"))) == [one]
    assert names(batch(edits=Path("edits"), horizon="windowed:20")) == [one, two]
    assert names(batch()) == [one, two], "back to what it was"
    write_box(quick / "clips" / "objects", "table")
    assert names(batch()) == [], "another object"
    write_box(quick / "clips" / "objects", "box", half_size=0.19)
    assert names(batch()) == [one, two]
    assert names(batch(mirrored=(False, True))) == [f"{one}-mirrored", f"{two}-mirrored"]


def test_a_mesh_beside_a_clip_counts_as_the_clip_does(quick):
    own_layout.write(
        open_clip("clips/sub1_box_000.pt", ReadOptions(objects=Path("clips/objects"))), Path("clips/own.npz")
    )
    only = {"clips": ("own.npz",), "objects": None, "mirrored": (True,)}
    batch(**only)
    assert names(batch(**only)) == []
    mesh = Path("clips/objects/box/box.obj")
    content = mesh.read_bytes()
    mesh.unlink()
    assert names(batch(**only)) == ["unitree_g1/own-mirrored"]
    assert names(batch(**only)) == []
    mesh.write_bytes(content)
    assert names(batch(**only)) == ["unitree_g1/own-mirrored"], "a clip whose mesh was missing"
    write_box(quick / "clips" / "objects", "box", half_size=0.19)
    assert names(batch(**only)) == ["unitree_g1/own-mirrored"], "another mesh"


def test_another_program_or_robot_makes_all_again(quick, monkeypatch):
    batch()
    monkeypatch.setattr("hoi_retarget.batch.jobs.__version__", "99")
    assert len(names(batch())) == 2
    changed = replace(ROBOTS["unitree_g1"], stature=1.5)
    monkeypatch.setattr("hoi_retarget.batch.jobs.robot", lambda _: changed)
    assert len(names(batch())) == 2


def test_a_batch_that_is_stopped_goes_on_where_it_was(quick):
    seen = []
    specification = replace(of_folder(Path("clips")), mirrored=(False, True))
    summary = run_batch(specification, OUT, Inline(), ended=seen.append, stopped=lambda: len(seen) == 1)
    assert not summary.is_complete and names(summary) == ["unitree_g1/sub1_box_000"]
    assert len(names(batch(mirrored=(False, True)))) == 3


# faults


def test_faulty_clips_cost_themselves_alone(quick, columns):
    broken = columns.copy()
    broken[7, 200] = np.nan
    Path("clips/sub1_box_002.pt").write_bytes(torch_bytes(broken))
    Path("clips/sub1_box_003.pt").write_bytes(torch_bytes(columns)[:2000])
    Path("clips/sub1_lamp_004.pt").write_bytes(torch_bytes(columns))
    entries = batch().entries
    assert [entry.status for entry in entries] == ["solved", "solved", "failed", "failed", "failed"]
    assert [entry.error for entry in entries[2:]] == ["ClipError", "ReadError", "GeometryError"]
    assert entries[2].frame == 7 and "not finite" in entries[2].reason
    assert "lamp" in entries[4].reason
    assert names(batch()) == [], "the same would fail again"
    write_box(quick / "clips" / "objects", "lamp")
    lamp = "unitree_g1/sub1_lamp_004"
    assert lamp in names(batch())
    assert read_manifest(OUT)[lamp].status == "solved"
    Path("clips/sub1_box_000.pt").write_bytes(b"")
    assert batch().entries[0].status == "failed"
    assert not (OUT / "unitree_g1" / "sub1_box_000.npz").exists(), "its old result is of something else"


@pytest.mark.parametrize(("error", "again"), [(ZeroDivisionError("nothing"), 0), (MemoryError(), 2), (OSError(), 2)])
def test_whatever_is_raised_ends_in_the_manifest(quick, monkeypatch, error, again):
    def fail(*_, **__):
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(work, "retarget_people", fail)
        entries = batch().entries
        assert [entry.status for entry in entries] == ["failed", "failed"]
        assert entries[0].error == type(error).__name__ and entries[0].reason
    assert len(names(batch())) == again, "what is not the clip's fault is tried again"


@pytest.mark.parametrize(("cause", "again"), [(OSError(errno.EIO, "a fault"), 2), (OSError("no array"), 0)])
def test_a_clip_that_the_machine_could_not_read_is_tried_again(quick, monkeypatch, cause, again):
    def fail(*_, **__):
        raise ReadError("it cannot be read") from cause

    with monkeypatch.context() as patch:
        patch.setattr(work, "open_clip", fail)
        batch()
    assert len(names(batch())) == again


@pytest.mark.parametrize("kilobytes", [40, 1])
def test_a_full_disk_loses_what_did_not_fit_and_the_next_run_makes_it(quick, kilobytes):
    """With the smaller limit the manifest's lines do not fit either until there is room again."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    seen: list[ManifestEntry] = []

    def ended(entry: ManifestEntry) -> None:
        seen.append(entry)
        if len(seen) == 2:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    try:
        run_batch(of_folder(Path("clips")), OUT, _Limited(kilobytes), ended=ended)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [(entry.status, entry.error) for entry in seen] == [("failed", "WriteError")] * 2
    assert read_manifest(OUT) == {entry.name: entry for entry in seen}
    assert len(names(batch())) == 2
    assert names(batch()) == []


class _Limited(Inline):
    """A pool with a disk that is full as soon as it starts."""

    def __init__(self, kilobytes: int) -> None:
        super().__init__()
        self.bytes = kilobytes << 10

    def run(self, tasks, stopped):
        resource.setrlimit(resource.RLIMIT_FSIZE, (self.bytes, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
        yield from super().run(tasks, stopped)


def test_lost_jobs_are_tried_again_and_late_ones_when_they_may_take_longer(quick):
    assert {entry.status for entry in batch(Losing("killed")).entries} == {"killed"}
    assert len(names(batch(Losing("timeout", 60.0)))) == 2
    assert len(names(batch(Losing("timeout", 60.0)))) == 0
    assert len(names(batch(Losing("timeout", 30.0)))) == 0
    assert len(names(batch(Losing("timeout", 90.0)))) == 2
    assert {entry.status for entry in batch(Inline(None)).entries} == {"solved"}


def test_the_clock_on_the_wall_does_not_matter(quick, monkeypatch):
    backwards = iter(range(10**9, 0, -(10**6)))
    monkeypatch.setattr(time, "time", lambda: float(next(backwards)))
    summary = batch()
    assert 0.0 < sum(entry.seconds for entry in summary.entries) <= summary.seconds
    assert names(batch()) == []


def test_two_batches_cannot_share_a_folder(quick):
    with locked(OUT), pytest.raises(HoiRetargetError, match=r"another batch is at work there \(process \d+\)"):
        batch()
    batch()
    Path("file").touch()
    with pytest.raises(WriteError, match="Choose another --out"), locked(Path("file")):
        pass


def test_what_a_crash_left_is_removed(quick):
    stray = OUT / "unitree_g1" / ".sub1_box_000.npz.abcd1234"
    stray.parent.mkdir(parents=True)
    stray.touch()
    (OUT / f".{MANIFEST}.a_b2c3d4").touch()
    batch()


def test_no_result_is_written_over_a_recording(quick):
    clip = open_clip("clips/sub1_box_000.pt", ReadOptions(objects=Path("clips/objects")))
    recording = OUT / "unitree_g1" / "own.npz"
    own_layout.write(replace(clip, objects=tuple(map(_without_mesh, clip.objects))), recording)
    content = recording.read_bytes()
    with pytest.raises(ArgumentError, match=r"own\.npz: this is a recording"):
        batch(clips=("unitree_g1/own.npz",), folder=OUT)
    assert recording.read_bytes() == content


def _without_mesh(track: ObjectTrack) -> ObjectTrack:
    return replace(track, geometry=ObjectGeometry(track.geometry.points))


@pytest.mark.parametrize(
    ("clip", "match"),
    [("clips/**.pt", "no pattern"), ("*/../../clips/*.pt", "no pattern"), (300 * "a", "cannot be looked for")],
)
def test_what_cannot_name_clips_is_told_of(quick, clip, match):
    with pytest.raises(ArgumentError, match=match):
        jobs_of(Specification(clips=(clip,)))


def test_a_name_that_leaves_no_room_for_that_of_its_edits_has_none(quick, columns):
    name = 250 * "a"
    Path(f"clips/{name}.pt").write_bytes(torch_bytes(columns))
    jobs = jobs_of(Specification(clips=(f"clips/{name}.pt",), edits=Path("clips")))
    assert [job.edits for job in jobs] == [None]


# the manifest


def entry_of(name: str, **changes) -> ManifestEntry:
    return ManifestEntry(name, "failed", "unitree_g1", ManifestSource(name), {}, {}, reason="ü\n\u2028", **changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"name": ["a"]},
        {"name": 5},
        {"source": []},
        {"source": {"objects": 5}},
        {"source": {"objects": ["\0"]}},
        {"seconds": float("nan")},
        {"time_limit": "long"},
        {"frames": None},
        {"results": [1]},
        {"results": [{}]},
        {"results": [{"path": "../clips/sub1_box_000.pt", "sha256": ""}]},
        {"results": [{"path": "/clips/sub1_box_000.pt", "sha256": ""}]},
        {"results": [{"path": "a\0", "sha256": ""}]},
    ],
)
def test_a_foreign_manifest_costs_no_batch_and_no_file_elsewhere(quick, changes):
    batch()
    lines = (OUT / MANIFEST).read_text().splitlines()
    content = {path: path.read_bytes() for path in Path("clips").rglob("*.pt")}
    foreign = {**json.loads(lines[0]), "key": "another", **changes}
    (OUT / MANIFEST).write_text("\n".join([lines[1], json.dumps(foreign)]))
    batch()
    assert names(batch()) == []
    assert content == {path: path.read_bytes() for path in Path("clips").rglob("*.pt")}


@settings(max_examples=15, deadline=None)
@given(cut=st.integers(0, 10**6))
def test_of_a_torn_manifest_the_whole_lines_are_read(tmp_path_factory, cut):
    folder = tmp_path_factory.mktemp("torn")
    entries = [entry_of(str(number)) for number in range(5)]
    lines = [json.dumps(asdict(entry)).encode() for entry in entries]
    content = b"".join(line + b"\n" for line in lines)
    content = content[: cut % (len(content) + 1)]
    (folder / MANIFEST).write_bytes(content)
    whole = sum(part == line for part, line in zip(content.splitlines(), lines, strict=False))
    assert list(read_manifest(folder).values()) == entries[:whole]
    with Manifest(folder, []) as manifest:
        manifest.add(entries[-1])
    assert list(read_manifest(folder).values()) == [*entries[: min(whole, 4)], entries[-1]]


def test_later_lines_count_and_lines_of_other_versions_do_not(tmp_path):
    lines = [json.dumps(asdict(entry_of("a", seconds=float(second)))) for second in range(3)]
    (tmp_path / MANIFEST).write_text("\n".join([*lines, "{}", "[1]", '"x"', "\x00", lines[0].replace("failed", "new")]))
    assert read_manifest(tmp_path) == {"a": entry_of("a", seconds=2.0)}


def test_a_closed_manifest_has_a_line_for_each_job_in_the_order_asked_for(tmp_path):
    with Manifest(tmp_path, ["b", "a"]) as manifest:
        for name in ("z", "a", "b", "a"):
            manifest.add(entry_of(name))
        assert len((tmp_path / MANIFEST).read_text().splitlines()) == 4
    lines = (tmp_path / MANIFEST).read_text().splitlines()
    assert [json.loads(line)["name"] for line in lines] == ["b", "a", "z"]


# the command


@pytest.mark.parametrize(
    ("words", "code", "match"),
    [
        (["gone.toml"], 1, "no such file"),
        (["clips", "--workers", "0"], 2, "--workers is 0"),
        (["clips", "--time-limit", "-1"], 2, "--time-limit is -1"),
        (["clips", "--time-limit", "inf"], 2, "--time-limit is inf"),
        (["clips", "--memory-limit", "inf"], 2, "--memory-limit is inf"),
        (["set.toml", "--objects", "clips/objects"], 2, "for a folder of clips"),
        (["clips/objects"], 2, "there are no clips"),
    ],
)
def test_commands_that_cannot_be_done(folder, capsys, words, code, match):
    Path("set.toml").write_text('clips = ["clips"]')
    assert main(["batch", *words, "--out", "out"]) == code
    assert match in capsys.readouterr().err


def test_a_result_is_the_one_that_run_makes(folder):
    """Also what the commands of results rely on: their report tells how they were made."""
    batch()
    assert main(["run", "clips/sub1_box_000.pt", "--objects", "clips/objects", "--out", "single"]) == 0
    ours, single = load(OUT / "unitree_g1" / "sub1_box_000.npz"), load(Path("single/sub1_box_000.npz"))
    np.testing.assert_array_equal(ours.qpos, single.qpos)
    same = set(single.report.command) - {"clips", "objects", "out"}
    assert {key: ours.report.command[key] for key in same} == {key: single.report.command[key] for key in same}


# the documentation


def test_the_documented_specification_is_one_and_names_every_key(tmp_path):
    text = (ROOT / "docs" / "dataset.md").read_text()
    (example,) = re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)
    (tmp_path / "set.toml").write_text(example)
    assert len(read_specification(tmp_path / "set.toml").robots) == 2
    assert set(tomllib.loads(example)) == {item.name for item in fields(Specification)} - {"folder"}


def test_the_documented_manifest_has_every_key():
    text = (ROOT / "docs" / "dataset.md").read_text()
    (table,) = re.findall(r"## The manifest\n.*?\n\n(\|.*?)\n\n", text, flags=re.DOTALL)
    named = {name for row in table.splitlines()[2:] for name in re.findall(r"`(\w+)`", row.split("|")[1])}
    assert named == {field.name for field in fields(ManifestEntry)}
