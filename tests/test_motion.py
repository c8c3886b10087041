"""The result file: written whole or not at all, damage is a `ReadError`; and the stages of a motion."""

import errno
import functools
import io
import json
import os
import pickle
import zipfile
from dataclasses import fields, replace

import jaxtyping
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from export_motions import smooth_motion
from hoi_retarget.cli import main
from hoi_retarget.clip.clip import Severity
from hoi_retarget.errors import ArgumentError, ClipError, ReadError, RobotError, WriteError
from hoi_retarget.evaluation.physics_figures import PERFORMED, performed_figures
from hoi_retarget.files import atomic
from hoi_retarget.files.atomic import write_atomically
from hoi_retarget.motion import result_file
from hoi_retarget.motion.formats import WRITABLE
from hoi_retarget.motion.motion import Motion, Stage, on_robot
from hoi_retarget.motion.motion_report import Event, InterRobotHandError, Optimality, Report, Status, Window
from hoi_retarget.motion.performance import Performance
from hoi_retarget.motion.result_file import encode, load, save
from hoi_retarget.motion.write_export import write_export
from hoi_retarget.numerics import se3
from hoi_retarget.robots import ROBOTS, load_robot
from hoi_retarget.robots.model import RobotModel
from outcomes import both_outcomes
from plain_motions import plain_motion, standing_qpos
from trajectories import MODELS

LAWS = settings(max_examples=40, deadline=None, derandomize=True, database=None)
FUZZ = settings(max_examples=150, deadline=None, derandomize=True, database=None)

texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\x00"), max_size=8)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=6,
)
tables = st.dictionaries(texts, json_values, max_size=4)
numbers = st.floats(allow_nan=False, allow_infinity=False)
counts = st.integers(0, 1000)
# Of a report as JSON has it.
segment = {"first_frame": st.just(0), "last_frame": st.just(0)}  # In a motion of any length.
source = st.fixed_dictionaries(
    {"path": texts, "licence": texts, "notes": st.lists(texts, max_size=2)},
    optional={
        "augmentation": st.fixed_dictionaries({"mirrored": st.booleans(), "speed": st.floats(0.1, 10)}),
        "warnings": st.lists(st.fixed_dictionaries({"code": st.just("recording"), "text": texts}), max_size=2),
    },
)
reports = st.fixed_dictionaries(
    {"clip": texts, "person": counts, "source": source, "root_scale": st.none() | numbers, "config": tables},
    optional={
        "versions": st.dictionaries(texts, texts, max_size=2),
        "figures": st.dictionaries(texts, st.none() | numbers, max_size=3),
        "unreached_contacts": st.lists(
            st.fixed_dictionaries(
                {"link": texts, "object": texts, **segment, "mean_residual_m": numbers, "max_residual_m": numbers}
            ),
            max_size=2,
        ),
        "orientation_flips": st.lists(
            st.fixed_dictionaries({"site": texts, **segment, "largest_deg": numbers}), max_size=2
        ),
        "cpu_seconds": st.dictionaries(texts, numbers, max_size=2),
    },
)


WINDOW = Window(0, 6, Status.SOLVED, 3, 1.5, {"jerk": 1.5}, Optimality(1e-4, 1e-5, 0.0))


def poses(rng: np.random.Generator, turns: np.ndarray, model: RobotModel) -> np.ndarray:
    joints = rng.uniform(model.lower, model.upper, (len(turns), model.n))
    return np.concatenate([rng.normal(size=(len(turns), 3)), turns, joints], axis=1)


def result(
    frames: int = 6, objects: int = 1, links: int = 2, *, robot: str = "unitree_g1", seed: int = 0, **changes
) -> Motion:
    """Return a motion of random numbers."""
    rng, model = np.random.default_rng(seed), load_robot(robot)
    turns = se3.exp(rng.normal(size=(frames, 2, 3)))
    flags = (rng.random((frames, links)) < 0.5) & (objects > 0)
    touched = np.where(flags, rng.integers(0, max(1, objects), (frames, links)), -1)
    values = {
        "robot": robot,
        "fps": 30.0,
        "joint_names": model.joint_names,
        "stages": (
            Stage("ik", poses(rng, turns[:, 1], model)),
            Stage("trajectory", poses(rng, turns[:, 0], model), (replace(WINDOW, stop=frames),)),
        ),
        "object_names": tuple(f"thing_{index}" for index in range(objects)),
        "object_pos": rng.normal(size=(frames, objects, 3)),
        "object_quat": se3.exp(rng.normal(size=(frames, objects, 3))),
        "object_scale": rng.uniform(0.5, 2.0, objects),
        "contact_links": tuple(model.sites.index)[:links],
        "contact_flags": flags,
        "contact_object": touched,
        "contact_points": np.where(flags[:, :, None], rng.normal(size=(frames, links, 3)), np.nan),
        "stance_flags": rng.random((frames, 2)) < 0.5,
        "first_source_frame": 7,
        "human_height": 1.75,
        "report": Report("clip", figures={"gap": 0.002}),
    }
    return Motion(**(values | changes))


# The entries of the file, which keep the names they got when the first results were written.
RENAMED = {"contact_points": "contact_targets", "stages": "stage_names"}
ENTRIES = [RENAMED.get(field.name, field.name) for field in fields(Motion)] + ["qpos", "ik_qpos"]


def assert_same(a: Motion, b: Motion) -> None:
    for field in fields(Motion):
        ours, theirs = getattr(a, field.name), getattr(b, field.name)
        if field.name == "stages":
            assert [(stage.name, stage.windows) for stage in ours] == [(stage.name, stage.windows) for stage in theirs]
            for one, other in zip(ours, theirs, strict=True):
                np.testing.assert_array_equal(one.qpos, other.qpos)
        elif isinstance(ours, np.ndarray):
            assert ours.dtype == theirs.dtype, field.name
            np.testing.assert_array_equal(ours, theirs, err_msg=field.name)
        else:
            assert ours == theirs, field.name
            assert type(ours) is type(theirs), field.name


@functools.cache
def content() -> bytes:
    return encode(result())


def members(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def packed(parts: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    """Return an archive whose checksums are right, whatever is in it."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for name, part in parts.items():
            archive.writestr(name, part)
    return buffer.getvalue()


def npy(array: object, *, allow_pickle: bool = False) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.asarray(array), allow_pickle=allow_pickle)
    return buffer.getvalue()


def with_array(name: str, array: object) -> bytes:
    return packed(members(content()) | {f"{name}.npy": npy(array)})


# Writing and reading


@LAWS
@given(
    sizes=st.tuples(st.integers(1, 12), st.integers(0, 3), st.integers(0, 4)),
    seed=st.integers(0, 1000),
    robot=st.sampled_from(list(ROBOTS)),
    report=reports,
)
def test_what_is_written_is_read(tmp_path_factory, sizes, seed, robot, report):
    original = result(*sizes, seed=seed, robot=robot, report=Report.from_json(report))
    path = tmp_path_factory.mktemp("motion") / "deep" / "clip.npz"
    save(original, path)
    assert_same(load(path), original)
    assert path.read_bytes() == encode(original) == encode(load(path)), "the same motion is the same bytes"


def test_a_robot_with_fingers_is_the_one_without_by_its_joints_and_contacts():
    """Every site is where it was; a motion on its own robot is itself; a joint that is missing is told."""
    own, plain = load_robot("unitree_g1_dex3"), load_robot("unitree_g1")
    links = tuple(link for link in own.sites.index if link in plain.sites.index or link.endswith("thumb"))
    motion = result(5, 1, len(links), robot="unitree_g1_dex3", contact_links=links)
    without = on_robot(motion, plain)
    assert (without.robot, without.joint_names) == ("unitree_g1", plain.joint_names)
    assert without.contact_links == tuple(link for link in links if not link.endswith("thumb"))
    kept = [link in without.contact_links for link in links]
    np.testing.assert_array_equal(without.contact_flags, motion.contact_flags[:, kept])
    before, after = own.forward(motion.qpos), plain.forward(without.qpos)
    for site in ("left_wrist", "right_toe", "head"):
        np.testing.assert_allclose(after.site_position(site), before.site_position(site), atol=1e-9)
    assert_same(on_robot(without, plain).with_report(figures=without.report.figures), without)
    with pytest.raises(RobotError, match=r"2 joints.*head_pitch_joint.*--from unitree_g1"):
        on_robot(motion, load_robot("unitree_h2"))


def test_the_file_is_a_plain_npz_of_the_documented_entries(tmp_path):
    save(result(), tmp_path / "clip.npz")
    with np.load(tmp_path / "clip.npz", allow_pickle=False) as archive:
        assert set(archive.files) == {"schema", *ENTRIES}
        assert int(archive["schema"]) == result_file.SCHEMA
        assert json.loads(str(archive["report"]))["figures"] == result().report.figures
        assert archive["joint_names"].tolist() == list(result().joint_names)


def test_files_written_by_numpy_itself_are_read(tmp_path):
    """Compressed, in Fortran order, in single precision: what other programs make of the same arrays."""
    with np.load(io.BytesIO(content()), allow_pickle=False) as archive:
        arrays = dict(archive)
    arrays["object_pos"] = np.asfortranarray(arrays["object_pos"])
    arrays["contact_object"] = arrays["contact_object"].astype(np.int32)
    arrays["qpos"] = arrays["qpos"].astype(np.float32)
    np.savez_compressed(tmp_path / "clip.npz", allow_pickle=False, **arrays)
    read = load(tmp_path / "clip.npz")
    np.testing.assert_array_equal(read.object_pos, result().object_pos)
    np.testing.assert_array_equal(read.contact_object, result().contact_object)
    np.testing.assert_allclose(read.qpos, result().qpos, rtol=1e-6)


def test_arrays_of_a_motion_are_read_only_copies():
    values = result().qpos.copy()
    moved = result(stages=(Stage("trajectory", values),))
    before = moved.qpos.copy()
    values[...] = 9.0
    np.testing.assert_array_equal(moved.qpos, before)
    with pytest.raises(ValueError, match="read-only"):
        moved.qpos[0, 0] = 1.0


# Writing is all or nothing


class FullDisk:
    """Stands for a file on a disk that is full after some bytes."""

    def __init__(self, file, room: int):
        self.file, self.room = file, room

    def __enter__(self):
        self.file.__enter__()
        return self

    def __exit__(self, *details):
        return self.file.__exit__(*details)

    def __getattr__(self, name):
        return getattr(self.file, name)

    def write(self, data: bytes) -> int:
        self.file.write(data[: self.room])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def fill_disk(monkeypatch) -> None:
    original = atomic.tempfile.NamedTemporaryFile

    def opener(*args, **kwargs):
        return FullDisk(original(*args, **kwargs), 100)

    monkeypatch.setattr(atomic.tempfile, "NamedTemporaryFile", opener)


def refuse(*_args, **_kwargs):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("step", ["write", "fsync", "replace"])
@pytest.mark.parametrize("existed", [True, False])
def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, step, existed):
    path = tmp_path / "clip.npz"
    if existed:
        save(result(), path)
    if step == "write":
        fill_disk(monkeypatch)
    elif step == "fsync":
        monkeypatch.setattr(atomic.os, "fsync", refuse)
    else:
        monkeypatch.setattr(atomic.Path, "replace", refuse)
    with pytest.raises(WriteError, match=r"clip\.npz.*No space left.*--out"):
        save(result(seed=1), path)
    monkeypatch.undo()
    assert [entry.name for entry in tmp_path.iterdir()] == ["clip.npz"] * existed
    if existed:
        assert_same(load(path), result())


def test_a_report_that_is_no_json_writes_nothing(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        save(result(report=Report(figures={"gap": float("nan")})), tmp_path / "clip.npz")
    assert list(tmp_path.iterdir()) == []


def test_the_old_file_is_replaced_and_readable_by_all(tmp_path):
    path = tmp_path / "clip.npz"
    save(result(), path)
    save(result(seed=1), path)
    assert_same(load(path), result(seed=1))
    assert path.stat().st_mode & 0o777 == 0o644
    assert [entry.name for entry in tmp_path.iterdir()] == ["clip.npz"]


def test_a_file_in_place_of_the_folder_is_named(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(WriteError, match=r"out/clip\.npz: cannot be written"):
        write_atomically(tmp_path / "out" / "clip.npz", b"x")


@pytest.mark.parametrize(
    "damage",
    [
        {"figures": "none"},
        {"figures": {"gap": "small"}},
        {"person": "first"},
        {"root_scale": "large"},
        {"source": 3},
        {"source": {"path": 3}},
        {"source": {"augmentation": {"mirrored": True, "speed": "fast"}}},
        {"source": {"augmentation": {"mirrored": True, "speed": -1.0}}},
        {"unreached_contacts": [1]},
        {"orientation_flips": [{"first_frame": "x"}]},
        {"stages": {"ik": [{"start": 0, "stop": 3, "status": "FINE"}]}},
        {"stages": [1]},
        {"command": "what"},
    ],
)
def test_a_damaged_report_is_one_error(tmp_path, damage):
    with np.load(io.BytesIO(content()), allow_pickle=False) as archive:
        arrays = dict(archive)
    arrays["report"] = np.str_(json.dumps(json.loads(str(arrays["report"])) | damage))
    np.savez(tmp_path / "clip.npz", **arrays)
    with pytest.raises(ReadError, match=r"clip\.npz: the motion file is damaged \(its report is damaged"):
        load(tmp_path / "clip.npz")


def test_warnings_are_values_with_a_code_and_a_text():
    stalled = replace(WINDOW, status=Status.STALLED)
    flip, near = (
        Event("orientation_flip", 1, 4, 120.0, subject="head"),
        InterRobotHandError((0, 1), ("a", "b"), "box", 9, 0.001, 0.002),
    )
    report = Report(orientation_flips=(flip,), inter_robot_hand_errors=(near, replace(near, max_m=0.5)))
    motion = result(report=report)
    assert motion.converged
    assert [warning.code for warning in motion.warnings] == ["inter_robot_hand_error", "orientation_flip"]
    loose = replace(motion, stages=(motion.stages[0], replace(motion.stages[1], windows=(WINDOW, stalled))))
    assert not loose.converged
    assert loose.warnings[0].code == "not_converged" and loose.warnings[0].severity is Severity.WARNING
    assert str(loose.warnings[0]).startswith("trajectory, frames 0 to 5: no step decreased")


# What a motion must be


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fps": 0.0}, "rate is 0 "),
        ({"fps": float("nan")}, "rate"),
        ({"stages": (Stage("trajectory", np.full((6, 36), np.nan)),)}, "trajectory qpos.*not finite"),
        ({"stages": (Stage("ik", np.full((6, 36), np.inf)),)}, "ik qpos.*not finite"),
        ({"object_pos": np.full((6, 1, 3), np.nan)}, "object_pos.*not finite"),
        ({"object_quat": np.full((6, 1, 4), np.nan)}, "object_quat.*not finite"),
        ({"object_scale": np.array([np.inf])}, "object_scale.*not finite"),
        ({"stages": (Stage("trajectory", np.zeros((6, 36))),)}, " qpos.*unit"),
        ({"stages": ()}, "no stage"),
        ({"stages": (Stage("ik", np.full((6, 36), 0.51)),)}, "ik qpos.*unit"),
        ({"object_quat": np.full((6, 1, 4), 0.501)}, "object_quat.*unit"),
        ({"contact_object": np.full((6, 2), 1)}, "contact_object.*beyond"),
        ({"contact_object": np.full((6, 2), -2)}, "contact_object.*beyond"),
        ({"contact_object": np.full((6, 2), -1)}, "contact_flags tells a contact where contact_object names no"),
        ({"contact_points": np.full((6, 2, 3), np.nan)}, "contact_points, where .* not finite"),
        ({"contact_points": np.full((6, 2, 3), 1e300)}, r"contact_points, where .* holds 1e\+300"),
        ({"stages": (Stage("trajectory", np.full((6, 36), 1e30)),)}, r"trajectory qpos holds 1e\+30"),
        ({"object_pos": np.full((6, 1, 3), -1e4)}, "object_pos holds -1e"),
        ({"object_scale": np.array([0.0])}, "object_scale"),
        ({"object_scale": np.array([-1.0])}, "object_scale"),
        ({"fps": 1e9}, r"rate is 1e\+09"),
        ({"fps": 1e-9}, "rate is 1e-09"),
        ({"human_height": float("nan")}, "a person of nan m"),
        ({"first_source_frame": -1}, "-1 frames dropped"),
        (
            {"report": Report(orientation_flips=(Event("orientation_flip", 3, 2, 120.0, subject="left_palm"),))},
            "frames 3 to 2",
        ),
        (
            {"report": Report(orientation_flips=(Event("orientation_flip", 0, 6, 120.0, subject="left_palm"),))},
            "frames 0 to 6",
        ),
        (
            {
                "report": Report(
                    unreached_contacts=(
                        Event("unreached_contact", -1, 2, 0.2, subject="left_palm", object="box", mean=0.1),
                    )
                )
            },
            "-1 to 2",
        ),
        ({"stages": (replace(result().stages[0], windows=(replace(WINDOW, stop=7),)),)}, "frames 0 to 6"),
    ],
)
def test_values_that_are_no_motion_are_refused(changes, message):
    with pytest.raises(ClipError, match=message):
        result(**changes)


def test_rotations_within_rounding_are_kept_as_they_are():
    nearly = np.full((6, 1, 4), 0.5 * (1 + 9e-4))
    np.testing.assert_array_equal(result(object_quat=nearly).object_quat, nearly)


@pytest.fixture
def uninstrumented():
    """Leave out the run-time annotations of the tests, which would refuse a shape before the package does."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


ARRAYS = [field.name for field in fields(Motion) if isinstance(getattr(result(), field.name), np.ndarray)]


@pytest.mark.usefixtures("uninstrumented")
@pytest.mark.parametrize("name", ARRAYS)
def test_shapes_that_disagree_are_refused_by_name(name):
    good = getattr(result(), name)
    for bad in (good[..., :-1], np.concatenate([good, good])):
        with pytest.raises(ClipError, match=rf"motion: {name} has shape .* expected"):
            result(**{name: bad})


def test_a_motion_has_frames():
    with pytest.raises(ClipError, match="no frames"):
        result(frames=0)


# What is no motion file


def refusal(path, data: bytes) -> str:
    path.write_bytes(data)
    with pytest.raises(ReadError) as caught:
        load(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_missing_files_and_folders_are_named(tmp_path):
    with pytest.raises(ReadError, match=r"gone\.npz: there is no such file"):
        load(tmp_path / "gone.npz")
    with pytest.raises(ReadError, match="this is a folder"):
        load(tmp_path)


def test_every_truncation_is_refused(tmp_path):
    data, path = content(), tmp_path / "clip.npz"
    assert "not a readable .npz" in refusal(path, b"")
    for length in {*range(0, 64), *range(0, len(data), 97), *range(len(data) - 64, len(data))}:
        refusal(path, data[:length])


@pytest.mark.parametrize(
    "data", [b"hello", b"PK\x03\x04", npy(np.zeros(3)), b"\x80\x04}.", b"PK\x05\x06" + bytes(18), bytes(1000)]
)
def test_what_is_no_archive_is_refused(tmp_path, data):
    refusal(tmp_path / "clip.npz", data)


def test_a_foreign_archive_is_told_by_what_it_holds(tmp_path):
    foreign = packed({"poses.npy": npy(np.zeros((3, 72))), "trans.npy": npy(np.zeros((3, 3))), "notes.txt": b"hi"})
    message = refusal(tmp_path / "amass.npz", foreign)
    assert "no 'schema' entry" in message
    assert "'poses'" in message and "'trans'" in message


@pytest.mark.parametrize("schema", [0, 1, 3, -1, 10**6])
def test_other_schemas_are_refused_with_both_numbers(tmp_path, schema):
    message = refusal(tmp_path / "clip.npz", with_array("schema", schema))
    assert f"schema {schema}" in message and f"reads {result_file.SCHEMA}" in message


@pytest.mark.parametrize("name", ENTRIES)
def test_a_missing_entry_is_named(tmp_path, name):
    parts = members(content())
    del parts[f"{name}.npy"]
    assert f"lacks {name}" in refusal(tmp_path / "clip.npz", packed(parts))


class Trap:
    """A pickle that would leave a trace if it were executed."""

    executed = False

    def __reduce__(self):
        return (spring, ())


def spring() -> int:
    Trap.executed = True
    return 0


@pytest.mark.parametrize("name", ["schema", *ENTRIES])
def test_pickles_are_refused_and_never_executed(tmp_path, name):
    trap = np.empty(1, dtype=object)
    trap[0] = Trap()
    parts = members(content()) | {f"{name}.npy": npy(trap, allow_pickle=True)}
    assert name in refusal(tmp_path / "clip.npz", packed(parts))
    bare = members(content()) | {f"{name}.npy": pickle.dumps(Trap())}
    assert name in refusal(tmp_path / "clip.npz", packed(bare))
    assert not Trap.executed
    pickle.loads(pickle.dumps(Trap()))
    assert Trap.executed, "the trap must work for this to be a test"
    Trap.executed = False


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("qpos", np.zeros((6, 36))),
        ("qpos", np.full((6, 36), np.nan)),
        ("qpos", np.full((6, 36), "0.5")),
        ("object_quat", np.full((6, 1, 4), 0.6)),
        ("object_quat", np.full((6, 1, 3), 0.5)),
        ("contact_flags", np.ones((6, 2))),
        ("contact_object", np.zeros((6, 2))),
        ("contact_object", np.full((6, 2), 5)),
        ("joint_names", np.arange(3)),
        ("robot", np.array([b"bytes"])),
        ("robot", np.array(["one", "two"])),
        ("report", np.array("{")),
        ("report", np.array("[]")),
        ("report", np.array("[" * 20_000)),
        ("fps", np.array("thirty")),
        ("fps", np.float64(0.0)),
        ("fps", np.zeros(2)),
        ("human_height", np.complex128(1j)),
        ("first_source_frame", np.float64(np.nan)),
        ("first_source_frame", np.float64(np.inf)),
        ("schema", np.float64(np.inf)),
        ("schema", np.array("1")),
    ],
)
@pytest.mark.usefixtures("uninstrumented")
def test_entries_of_the_wrong_kind_are_refused(tmp_path, name, array):
    assert "damaged" in refusal(tmp_path / "clip.npz", with_array(name, array))


@pytest.mark.parametrize("code", [0x110000, 0xFFFFFFFF, 0xD800])
def test_impossible_characters_are_refused(tmp_path, code):
    part = members(content())["joint_names.npy"]
    broken = part[:-4] + np.uint32(code).tobytes()
    assert "damaged" in refusal(tmp_path / "clip.npz", packed(members(content()) | {"joint_names.npy": broken}))


@pytest.mark.parametrize(
    "header",
    [
        b"'shape': (999999999999, 36)", b"'shape': (99999999999999999999999, 36)", b"'shape': (6, 37)",
        b"'shape': (-6, 36)", b"'shape': (6, " + b"1, " * 70 + b"36)", b"'shape': 6", b"'shape': (6L, 36)",
    ],
)  # fmt: skip
def test_headers_that_promise_other_content_are_refused(tmp_path, header):
    part = members(content())["qpos.npy"]
    assert b"'shape': (6, 36)" in part
    broken = part.replace(b"'shape': (6, 36)", header)
    assert "damaged" in refusal(tmp_path / "clip.npz", packed(members(content()) | {"qpos.npy": broken}))


@pytest.mark.parametrize("dtype", [b"<f99", b"<U99999999999999999999", b"<U999999999", b"|V8", b"|O", b">f8", b"<m8"])
def test_types_that_are_no_numbers_or_too_large_are_refused(tmp_path, dtype):
    for name in ("qpos", "robot"):
        part = members(content())[f"{name}.npy"]
        start = part.index(b"'descr': '") + 10
        broken = part[:start] + dtype + part[part.index(b"'", start) :]
        refusal(tmp_path / "clip.npz", packed(members(content()) | {f"{name}.npy": broken}))


@pytest.mark.parametrize("method", [1, 8, 9, 12, 14, 93, 99])
def test_members_that_claim_another_compression_are_refused(tmp_path, method):
    refusal(tmp_path / "clip.npz", with_field(10, 8, method))


def test_members_that_claim_to_be_encrypted_are_refused(tmp_path):
    refusal(tmp_path / "clip.npz", with_field(8, 6, 1))


def with_field(central: int, local: int, value: int) -> bytes:
    """Return the archive with a two-byte field of every member's central and local header replaced."""
    data = bytearray(content())
    for marker, offset in ((b"PK\x01\x02", central), (b"PK\x03\x04", local)):
        for at in [at for at in range(len(data)) if data.startswith(marker, at)]:
            data[at + offset : at + offset + 2] = value.to_bytes(2, "little")
    return bytes(data)


# Fuzz: load returns a motion or raises ReadError


@pytest.fixture
def load_or_refuse(tmp_path):
    """Load a motion from bytes; a test must see motions and errors, and nothing else."""
    path = tmp_path / "fuzz.npz"
    with both_outcomes(ReadError, str(path)) as attempt:

        def try_to_load(data: bytes) -> None:
            path.write_bytes(data)
            assert isinstance(attempt(load, path), Motion | None)

        yield try_to_load


def damaged(data: bytes, edits: list[tuple[float, int]]) -> bytes:
    broken = bytearray(data)
    for place, value in edits:
        broken[min(int(place * len(broken)), len(broken) - 1)] = value
    return bytes(broken)


edits = st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 255)), min_size=1, max_size=4)


def test_damaged_archives_never_raise_anything_else(load_or_refuse):
    @FUZZ
    @given(edits=edits, compressed=st.booleans())
    def check(edits, compressed):
        data = packed(members(content()), zipfile.ZIP_DEFLATED) if compressed else content()
        load_or_refuse(damaged(data, edits))

    check()


def test_damaged_directories_never_raise_anything_else(load_or_refuse):
    """Bytes of the central directory or of one local header: names, flags, methods, sizes, offsets."""

    @FUZZ
    @given(edits=edits, directory=st.booleans(), which=st.integers(0, 10**6))
    def check(edits, directory, which):
        data = content()
        marker = b"PK\x01\x02" if directory else b"PK\x03\x04"
        places = [at for at in range(len(data)) if data.startswith(marker, at)]
        start = places[which % len(places)]
        part = damaged(data[start : start + 46], edits)
        load_or_refuse(data[:start] + part + data[start + 46 :])

    check()


def test_damaged_arrays_with_right_checksums_never_raise_anything_else(load_or_refuse):
    @FUZZ
    @given(edits=edits, which=st.integers(0, 100), header=st.booleans())
    def check(edits, which, header):
        parts = members(content())
        name = sorted(parts)[which % len(parts)]
        part = parts[name]
        cut = 128 if header else len(part)
        parts[name] = damaged(part[:cut], edits) + part[cut:]
        load_or_refuse(packed(parts))

    check()


@FUZZ
@given(data=st.binary(max_size=200), prefix=st.sampled_from([b"", b"PK\x03\x04", b"PK\x05\x06", b"\x93NUMPY\x01\x00"]))
def test_random_bytes_are_refused(tmp_path_factory, data, prefix):
    path = tmp_path_factory.getbasetemp() / "fuzz.npz"
    path.write_bytes(prefix + data)
    with pytest.raises(ReadError):
        load(path)


G1 = MODELS["unitree_g1"]


def performed(motion: Motion, shift=(0.0, 0.0, 0.0), turn=0.0, joint=0.0, moved=(0.0, 0.0, 0.0)) -> Motion:
    """A motion with one more stage: the base shifted and turned, every joint turned, the objects moved."""
    qpos = motion.qpos.copy()
    qpos[:, :3] += shift
    qpos[:, 3:7] = se3.quat_multiply(se3.exp(np.array([0.0, 0.0, turn])), qpos[:, 3:7])
    qpos[:, 7:] += joint
    before = np.concatenate([motion.object_pos, motion.object_quat], axis=2)
    stages = [replace(stage, objects=before) for stage in motion.stages]
    report = replace(motion.report, performance=Performance(1.5, False), figures={"body_jerk_mps3": 1.0})
    return replace(
        motion, stages=(*stages, Stage("physics", qpos)), object_pos=motion.object_pos + np.array(moved), report=report
    )


@pytest.fixture(scope="module")
def motion():
    return performed(smooth_motion(G1), shift=(0.02, 0.0, 0.0), joint=0.01, moved=(0.0, 0.0, 0.03))


def test_an_earlier_stage_is_the_motion_that_it_was(motion):
    before = smooth_motion(G1)
    name = before.stages[-1].name
    found = motion.at_stage(name)
    for array in ("qpos", "object_pos", "object_quat", "contact_points"):
        assert getattr(found, array).tobytes() == getattr(before, array).tobytes()
    assert not found.report.figures and found.report.performance is None
    assert motion.at_stage("physics") is motion
    with pytest.raises(ArgumentError, match=rf"no stage 'later'\. Its stages: .*{name}, physics\."):
        motion.at_stage("later")


def test_files_keep_every_stage(motion, tmp_path):
    save(motion, tmp_path / "a.npz")
    read = load(tmp_path / "a.npz")
    for stage, again in zip(motion.stages, read.stages, strict=True):
        assert again.qpos.tobytes() == stage.qpos.tobytes()
        assert (again.objects is None) == (stage.objects is None)
        assert stage.objects is None or again.objects.tobytes() == stage.objects.tobytes()
    save(read, tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_objects_of_a_stage_are_poses_of_these_objects(motion):
    first, *others = motion.stages
    for wrong, what in (
        (first.objects[:, :0], "shape"),
        (2.0 * first.objects, "unit"),
        (first.objects * np.nan, "finite"),
    ):
        with pytest.raises(ClipError, match=what):
            replace(motion, stages=(replace(first, objects=wrong), *others))


@pytest.mark.parametrize("name", WRITABLE)
def test_an_export_of_a_stage_holds_its_arrays(name, motion, tmp_path):
    alone = replace(motion, stages=(replace(motion.stages[-1], name="trajectory"),))
    reference = smooth_motion(G1)
    for stage, same in (("physics", alone), (reference.stages[-1].name, reference), (None, alone)):
        written = write_export(motion, name, tmp_path / f"{stage}", name="a", stage=stage)
        expected = write_export(same, name, tmp_path / f"{stage} expected", name="a")
        for path, other in zip(written, expected, strict=True):
            same_bytes = path.read_bytes() == other.read_bytes()
            assert same_bytes or path.name == "a.meta.json", path
    meta = (tmp_path / "physics" / "a.meta.json").read_text()
    assert '"stage": "physics"' in meta


def test_a_stage_that_is_not_there_is_one_error(tmp_path, capsys):
    save(smooth_motion(G1), tmp_path / "a.npz")
    call = ["export", str(tmp_path / "a.npz"), "--to", "mjlab", "--out", str(tmp_path / "out"), "--stage"]
    assert main([*call, "physics"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "--stage physics: the motion has no stage 'physics'. Its stages: " in said and "refine" in said
    assert not (tmp_path / "out").exists()


METRES = st.floats(-0.5, 0.5)


@settings(deadline=None, max_examples=15)
@given(shift=st.tuples(*[METRES] * 3), turn=st.floats(0.0, 3.0), joint=METRES, moved=st.tuples(*[METRES] * 3))
def test_deviations_from_the_reference_are_those_that_were_made(shift, turn, joint, moved):
    plain = plain_motion(G1, standing_qpos(G1, 4))
    assert performed_figures(plain) == {}
    figures = performed_figures(performed(plain, shift, turn, joint, moved))
    assert set(figures) == {figure.name for figure in PERFORMED}
    assert figures["reference_root_m"] == pytest.approx(np.linalg.norm(shift), abs=1e-12)
    assert figures["reference_root_deg"] == pytest.approx(np.degrees(turn), abs=1e-6)
    assert figures["reference_joint_rad"] == pytest.approx(abs(joint), abs=1e-12)
    for name in ("reference_object_m", "reference_object_max_m"):
        assert figures[name] == pytest.approx(np.linalg.norm(moved), abs=1e-12)
    assert figures["reference_object_deg"] == pytest.approx(0.0, abs=1e-9) and figures["stood_s"] == 1.5


def test_tables_have_them_where_something_was_performed(motion, tmp_path, capsys):
    figures = {"body_jerk_mps3": 1.0}
    plain = smooth_motion(G1)
    save(replace(plain, report=replace(plain.report, figures=figures)), tmp_path / "plain.npz")
    both = {**figures, **performed_figures(motion)}
    save(replace(motion, report=replace(motion.report, figures=both)), tmp_path / "performed.npz")
    for name, there in (("plain", False), ("performed", True)):
        assert main(["evaluate", str(tmp_path / f"{name}.npz")]) == 0
        assert ("root off reference [cm]" in capsys.readouterr().out) == there
    assert main(["evaluate", *(str(tmp_path / f"{name}.npz") for name in ("plain", "performed"))]) == 0
    assert "root off reference [cm]" in capsys.readouterr().out
