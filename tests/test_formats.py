"""The readers of robot motions: what is written is read, and whatever is wrong is one clear error."""

import json
import os
import pickle
import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import motion_writers as writers
from hoi_retarget.errors import ReadError
from hoi_retarget.files.array_pickle import parse_pickle
from hoi_retarget.motion import formats
from hoi_retarget.motion.check import check
from hoi_retarget.motion.formats import MotionFile, read
from hoi_retarget.motion.formats.containers import read_npz

BOUNDED = settings(derandomize=True, deadline=None, max_examples=30, database=None)
FORMATS = ("hoi-retarget", *writers.MAKERS)
PLAIN = Path("motion.pkl")


def refused(path: Path, *words: str) -> None:
    with pytest.raises(ReadError) as caught:
        read(path)
    for word in (path.stem, *words):
        assert word in str(caught.value), str(caught.value)


# The table


def test_every_format_has_its_file_and_its_line():
    folder = Path(formats.__file__).parent
    modules = [import_module(f"{formats.__name__}.{path.stem}") for path in folder.glob("[!_]*.py")]
    there = {value.name for module in modules for value in vars(module).values() if isinstance(value, formats.Format)}
    assert there == {format.name for format in formats.FORMATS}
    assert len(formats.FORMATS) == len(there) == len({format.convention.name for format in formats.FORMATS})
    # The package's own exports stand in for another program's files (tests/test_write_export.py).
    exported = {format.convention.name for format in formats.WRITABLE.values()}
    assert set(FORMATS) <= {format.convention.name for format in formats.FORMATS} <= set(FORMATS) | exported


# Reading


USUAL_RATES = {
    **dict.fromkeys(("gmr", "gmr-npz", "sbto", "asap", "protomotions", "named-csv"), 30.0),
    **dict.fromkeys(("holosoma-retarget", "omniretarget"), 30.0),
    **writers.WITHOUT_RATE,
}


def without_rate(content: dict) -> None:
    """Remove the rate, in a library the motion's own, in a table the times of frames."""
    for part in (content, *(value for value in content.values() if isinstance(value, dict))):
        part.pop("fps", None)
    if "time" in content.get("header", ()):
        content["header"], content["table"] = content["header"][1:], content["table"][:, 1:]


@pytest.mark.parametrize(("name", "fps"), USUAL_RATES.items())
def test_files_without_a_rate_have_the_usual_one(name, fps, tmp_path):
    file = read(writers.write(name, tmp_path, without_rate))
    checked = check(file, writers.model())
    assert file.fps is None and checked.fps == fps and checked.fps_assumed
    (rate,) = (finding for finding in checked.findings if finding.subject == "rate")
    assert rate.claim == f"no rate (usual: {fps:g})"


@pytest.mark.parametrize(("count", "names"), [(0, ()), (1, ("object",)), (2, ("object0", "object1"))])
def test_objects_of_a_table_are_named_by_their_places(count, names, tmp_path):
    source = writers.motion()
    poses = [writers.object_pose(source) + np.array([float(index), *(0.0,) * 6]) for index in range(count)]
    np.savez(tmp_path / "motion.npz", qpos=np.concatenate([source.qpos, *poses], axis=1), fps=source.fps, cost=0.0)
    file = read(tmp_path / "motion.npz")
    assert tuple(item.name for item in file.objects) == names
    for item, pose in zip(file.objects, poses, strict=True):
        np.testing.assert_array_equal(item.pose, pose)


@pytest.mark.parametrize("name", FORMATS)
def test_arrays_are_as_they_were_written(name, tmp_path):
    source = writers.motion()
    file = read(writers.write(name, tmp_path))
    assert file.frames == source.frames
    assert file.format == ("tracking" if name in ("beyondmimic", "mjlab") else name)
    assert file.fps == (None if name in writers.WITHOUT_RATE else pytest.approx(source.fps))
    in_isaac_lab = name in ("beyondmimic", "sonic")
    joints = file.joint_pos[:, np.argsort(writers.breadth_first()[1])] if in_isaac_lab else file.joint_pos
    if name == "asap":
        assert joints.shape == (source.frames, 23)
    else:
        assert np.abs(joints - source.qpos[:, 7:]).max() < 1e-6
    assert not file.joint_pos.flags.writeable


def test_all_arrays_of_a_library_motion_are_found_in_plain_lists(tmp_path):
    content = writers.gmr(writers.motion())
    path = tmp_path / "lists.pkl"
    lists = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in content.items()}
    path.write_bytes(pickle.dumps(lists))
    assert np.array_equal(read(path).joint_pos, writers.motion().qpos[:, 7:])


ARRAYS = st.builds(
    lambda dtype, shape, seed, order: np.asarray(
        np.random.default_rng(seed).integers(0, 99, shape).astype(dtype), order=order
    ),
    st.sampled_from(["float64", "float32", "int64", "uint8", "bool", ">f8", "<U3"]),
    st.lists(st.integers(0, 4), max_size=3),
    st.integers(0, 1000),
    st.sampled_from(["C", "F"]),
)
NUMBERS = st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False)
VALUES = st.recursive(
    ARRAYS | st.none() | st.booleans() | NUMBERS | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.shape == b.shape and bool((a == b).all())
    if isinstance(a, dict):
        return isinstance(b, dict) and list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return isinstance(b, list) and len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and a == b


@BOUNDED
@given(VALUES, st.sampled_from([2, 3, 4, 5]))
def test_what_is_pickled_is_read(value, protocol):
    assert same(value, parse_pickle(pickle.dumps(value, protocol=protocol), PLAIN))


def test_shared_arrays_stay_shared():
    array = np.arange(3.0)
    value = parse_pickle(pickle.dumps({"a": array, "b": [array, np.float32(2.5), np.int64(7)]}), PLAIN)
    assert value["a"] is value["b"][0]
    assert value["b"][1:] == [2.5, 7]


# Refusing


class Runs:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, ("touch executed",)


class Built:
    pass


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
@pytest.mark.parametrize("value", [Runs(), Built(), os.system, np.array([1, "a"], dtype=object), {1, 2}, [np.ndarray]])
def test_nothing_is_executed(value, protocol, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "evil.pkl"
    path.write_bytes(pickle.dumps({"root_pos": value}, protocol=protocol))
    refused(path)
    assert not (tmp_path / "executed").exists()


@pytest.mark.parametrize("value", [Runs(), Built(), os.system, [1, "a"]])
def test_objects_in_npz_are_refused_but_for_plain_values(value, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "evil.npz"
    np.savez(path, qpos=np.array(value, dtype=object))
    refused(path)
    assert not (tmp_path / "executed").exists()


def test_none_in_an_entry_that_is_not_needed_is_left_out(tmp_path):
    """`np.savez(**dictionary)` writes such entries of GMR's."""
    content = writers.gmr(writers.motion())
    path = tmp_path / "motion.npz"
    np.savez(path, **content)
    file = read(path)
    assert "local_body_pos NoneType" in file.contents
    np.testing.assert_array_equal(file.joint_pos, content["dof_pos"])


def test_a_pickle_with_the_ending_of_a_table_is_told(tmp_path):
    path = tmp_path / "motion.csv"
    path.write_bytes(pickle.dumps({"root_pos": 1}))
    refused(path, "a pickle, not a text file. Call it motion.pkl")


@pytest.mark.parametrize(("sizes", "kind"), [((0, 1 << 39, 1 << 39), b"f8"), ((1 << 39,), b"U0")])
def test_arrays_without_bytes_claim_no_memory(sizes, kind):
    written = b"(" + b"".join(b"\x8a\x08" + size.to_bytes(8, "little") for size in sizes) + b"t"
    named = b"cnumpy\ndtype\nU\x02" + kind + b"\x85R"
    array = b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\n\x85R(K\x01" + written + named + b"\x89C\x00tb"
    with pytest.raises(ReadError, match=r"motion\.pkl: .*an array of shape"):
        parse_pickle(b"\x80\x03" + array + b".", PLAIN)


@pytest.mark.parametrize("kind", ["f8", "U1"])
def test_bytes_that_are_used_again_and_again_claim_no_memory(kind):
    raw, count = bytes(80_000), 80_000 // np.dtype(kind).itemsize
    named = b"cnumpy\ndtype\nU\x02" + kind.encode() + b"\x85R(K\x03U\x01>NNNtbq\x01"
    described = b"h\x00h\x01J" + count.to_bytes(4, "little") + b"\x85U\x01C"
    array = b"cnumpy.core.numeric\n_frombuffer\n(" + described + b"tR"
    start = b"\x80\x03](B" + len(raw).to_bytes(4, "little") + raw + b"q\x00" + named + b"0" + b"0"
    assert parse_pickle(start + array + b"e.", PLAIN)[0].shape == (count,)
    with pytest.raises(ReadError, match="beyond those stored"):
        parse_pickle(start + array * 100 + b"e.", PLAIN)


def test_texts_without_letters_claim_no_memory(tmp_path):
    header = b"{'descr': '<U0', 'fortran_order': False, 'shape': (549755813888,), }\n"
    path = tmp_path / "names.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("joint_names.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    with pytest.raises(ReadError, match=r"names\.npz.*joint_names"):
        read_npz(path)


def test_a_rate_beyond_all_numbers_is_refused(tmp_path):
    path = small("gmr", tmp_path)
    values = pickle.loads(path.read_bytes())
    path.write_bytes(pickle.dumps({**values, "fps": 10**37}))
    refused(path, "its rate is 1e+37")
    (folder := tmp_path / "folder").mkdir()
    path = writers.write("hdmi", folder)
    meta = json.loads((path / "meta.json").read_text())
    (path / "meta.json").write_text(json.dumps({**meta, "fps": 10**400}))
    with pytest.raises(ReadError, match="'fps' is not one number"):
        read(path)


def test_missing_and_unknown_files(tmp_path):
    refused(tmp_path / "none.npz", "no such file")
    refused(tmp_path / "none.pkl", "no such file")
    refused(tmp_path / "none.bvh", "*.npz, *.pkl, *.csv")
    for name in ("empty.npz", "empty.pkl", "empty.csv"):
        (tmp_path / name).write_bytes(b"")
        refused(tmp_path / name)
    np.savez(tmp_path / "other.npz", poses=np.zeros(3))
    refused(tmp_path / "other.npz", "it holds poses", "holosoma-wbt")
    (tmp_path / "other.pkl").write_bytes(pickle.dumps({"poses": 1}))
    refused(tmp_path / "other.pkl", "it holds poses")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ReadError, match="there is no motion in this folder"):
        read(tmp_path / "folder")


def test_hdmi_without_its_meta_file(tmp_path):
    (writers.write("hdmi", tmp_path) / "meta.json").unlink()
    with pytest.raises(ReadError, match=r"no meta\.json beside it"):
        read(tmp_path)


def test_a_library_of_several_motions(tmp_path):
    content = writers.asap(writers.motion())
    (tmp_path / "two.pkl").write_bytes(pickle.dumps({**content, "run": content["walk"]}))
    refused(tmp_path / "two.pkl", "2 motions (walk, run)")


def spoilt(name: str, folder: Path, key: str, value: Any) -> Path:
    content = writers.MAKERS[name](writers.motion())
    content[key] = value(content[key])
    return writers.save(name, content, folder)


def with_nan(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array[[4, 7], ..., 1] = np.nan
    return array


@pytest.mark.parametrize(
    ("name", "key", "words"),
    [
        ("mjlab", "body_pos_w", "the bodies' positions"),
        ("gmr", "dof_pos", "the joint angles"),
        ("gmr", "root_rot", "the root's pose"),
        ("omniretarget", "qpos", "finite"),
        ("unitree-csv", "table", "the root's pose"),
        ("holosoma-wbt", "object_lin_vel_w", "the linear velocity of box"),
    ],
)
def test_frames_that_are_not_finite_are_named(name, key, words, tmp_path):
    refused(spoilt(name, tmp_path, key, with_nan), words, "2 frames (4, 7)")


def test_numbers_of_damage_are_refused(tmp_path):
    refused(spoilt("gmr", tmp_path, "dof_pos", lambda a: a + 1e200 * (np.arange(len(a)) == 5)[:, None]), "1 frame (5)")


@pytest.mark.parametrize(
    ("name", "key", "value", "words"),
    [
        ("mjlab", "body_quat_w", lambda a: a[:, :, :3], "the bodies' rotations have shape"),
        ("mjlab", "joint_vel", lambda a: a[1:], "the joint velocities have shape"),
        ("mjlab", "joint_pos", lambda a: a[0], "have shape"),
        ("mjlab", "fps", lambda a: np.array([0]), "0 frames a second"),
        ("mjlab", "fps", lambda a: np.array(["fast"]), "'fps' is not one number"),
        ("mjlab", "joint_pos", lambda a: a.astype(str), "'joint_pos' is no array of numbers"),
        ("holosoma-wbt", "joint_names", lambda a: a[1:], "28 joint names for 29"),
        ("holosoma-wbt", "body_names", lambda a: np.repeat(a[:1], len(a)), "hold world twice"),
        ("gmr", "root_pos", lambda a: a[:, :2], "the root's pose have shape"),
        ("gmr", "dof_pos", lambda a: a[:2], "expected"),
        ("unitree-csv", "table", lambda a: a[:2], "2 frames; at least 3"),
        ("unitree-csv", "table", lambda a: a[:, :6], "6 columns"),
    ],
)
def test_shapes_and_types_are_checked(name, key, value, words, tmp_path):
    refused(spoilt(name, tmp_path, key, value), words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x,y\n1,2\n", "no columns name the root's position"),
        ("1,2\n", "2 columns"),
        ("1,b,c,d,e,f,g,h\n", "line 1"),
        ("a,b,c,d,e,f,g,h\n1,2,3,4,5,6,7,8\na,b,c,d,e,f,g,h\n", "line 3"),
        ("1,2,3,4,5,6,7,8\n1,2\n", "line 2 has 2 columns"),
    ],
)
def test_tables_that_are_none(text, words, tmp_path):
    (tmp_path / "table.csv").write_text(text)
    refused(tmp_path / "table.csv", words)


# Damage


def small(name: str, folder: Path) -> Path:
    """Return a file of the format with a few frames."""
    content = writers.MAKERS[name](writers.motion())

    def cut(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: cut(item) for key, item in value.items()}
        many = isinstance(value, np.ndarray) and value.ndim > 1
        return value[:4] if many else value

    return writers.save(name, cut(content), folder)


@pytest.mark.parametrize(
    "name",
    [
        "mjlab",
        "omniretarget",
        "gmr",
        "sbto",
        "asap",
        "unitree-csv",
        "holosoma-wbt",
        "gmr-npz",
        "protomotions",
        "named-csv",
    ],
)
def test_damage_is_one_error_or_none(name, tmp_path):
    path = small(name, tmp_path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for trial in range(40):
        content = bytearray(whole)
        if trial % 3 == 0:
            content = content[: int(rng.integers(len(content)))]
        # The beginning is what a file says of itself; most of the rest is numbers.
        reach = min(600, len(whole)) if trial % 2 else len(whole)
        for place in rng.integers(reach, size=0 if trial % 3 == 0 else 1 + trial % 5):
            content[int(place)] = int(rng.integers(256))
        path.write_bytes(bytes(content))
        try:
            file = read(path)
        except ReadError as error:
            assert path.name in str(error)
        else:
            assert isinstance(file, MotionFile)


@BOUNDED
@given(st.binary(max_size=300))
def test_random_bytes_are_one_error_or_a_value(content):
    try:
        parse_pickle(b"\x80\x04" + content, PLAIN)
    except ReadError as error:
        assert str(error).startswith("motion.pkl: ")


@BOUNDED
@given(st.binary(max_size=300))
def test_random_archives_are_one_error(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("random") / "motion.npz"
    path.write_bytes(b"PK\x03\x04" + content)
    with pytest.raises(ReadError, match=r"motion\.npz"):
        read_npz(path)
