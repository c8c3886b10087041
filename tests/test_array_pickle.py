"""Pickles of joblib, as views of their file where that can be, and of torch: written and read, nothing executed."""

import mmap
import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.errors import ReadError
from hoi_retarget.files.array_pickle import parse_pickle, read_joblib, starts_with
from joblib_writer import joblib_bytes, write_joblib
from parahome_writer import tensor_pickle

VALUES = {
    0: {
        "name": "first",
        "floats": np.arange(12.0).reshape(3, 4),
        "columns": np.asfortranarray(np.arange(6, dtype=np.float32).reshape(2, 3)),
        "foreign": np.arange(4, dtype=">f8"),
        "flags": np.array([True, False]),
        "whole": np.int64(3) * np.ones(3, dtype=np.int16),
        "empty": np.zeros((0, 3)),
        "single": np.array(2.5),
        "text": np.array("male"),
        "list": [1, None, "x", (2.0, True)],
    }
}


def base_of(array: np.ndarray) -> object:
    """What owns the bytes of an array."""
    owner: object = array
    while isinstance(owner, np.ndarray | memoryview):
        owner = owner.base if isinstance(owner, np.ndarray) else owner.obj
    return owner


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
@pytest.mark.parametrize("alignment", [None, 16])
@pytest.mark.parametrize("compressed", [False, True])
def test_what_is_written_comes_back(tmp_path, protocol, alignment, compressed):
    path = write_joblib(tmp_path / "a.p", VALUES, protocol=protocol, alignment=alignment, compressed=compressed)
    read = read_joblib(path)[0][0]
    assert list(read) == list(VALUES[0])
    for name, value in VALUES[0].items():
        if isinstance(value, np.ndarray):
            assert np.array_equal(read[name], value)
            assert (read[name].dtype.kind, read[name].shape) == (value.dtype.kind, value.shape)
            assert not (value.size and read[name].flags.writeable)
        else:
            assert read[name] == value
    assert isinstance(base_of(read["floats"]), mmap.mmap) != compressed
    assert isinstance(base_of(read["columns"]), mmap.mmap) != compressed


def test_names_are_looked_for_at_the_start_only(tmp_path):
    for compressed in (False, True):
        path = write_joblib(tmp_path / "a.p", VALUES, compressed=compressed)
        assert starts_with(path, (b"floats", b"name"), 1000)
        assert not starts_with(path, (b"floats", b"other"), 1000)
        assert not starts_with(path, (b"floats",), 10)
    with pytest.raises(ReadError, match="cannot be read"):
        starts_with(tmp_path / "absent.p", (), 10)


def test_damaged_files_have_one_error(tmp_path):
    content = joblib_bytes(VALUES)
    path = tmp_path / "a.p"
    for damaged, words in (
        (b"", "the file is empty"),
        (content[:-40], "cut off"),
        (b"no pickle", "which no pickle of protocol 2 to 5 does"),
        (joblib_bytes({"a": print}), "wants to import"),
        (joblib_bytes(VALUES, compressed=True)[:-9], "cut off"),
    ):
        path.write_bytes(damaged)
        with pytest.raises(ReadError, match=words):
            read_joblib(path)


def test_arrays_are_not_read_until_they_are_looked_at(tmp_path, monkeypatch):
    path = write_joblib(tmp_path / "a.p", {"large": np.ones(1_000_000)})
    monkeypatch.setattr(type(path), "read_bytes", lambda _: pytest.fail("the whole file is read"))
    assert read_joblib(path)[0]["large"].sum() == 1_000_000


TENSORS = {
    "floats": np.arange(12, dtype=np.float32).reshape(3, 4),
    "doubles": np.arange(3.0),
    "whole": np.arange(5),
    "none": np.zeros((0, 3)),
    "flags": np.array([True, False]),
    "text": "female",
    "list": [1, 2.5, None],
}
PATH = Path("a.pkl")


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_tensors_come_back(protocol):
    read = parse_pickle(tensor_pickle(TENSORS, protocol), PATH)
    assert list(read) == list(TENSORS)
    for name, value in TENSORS.items():
        assert np.array_equal(read[name], value)
        assert not isinstance(value, np.ndarray) or (read[name].dtype, read[name].shape) == (value.dtype, value.shape)


def test_a_tensor_alone():
    assert np.array_equal(parse_pickle(tensor_pickle(np.eye(3)), PATH), np.eye(3))


def test_damaged_tensors_have_one_error():
    content = tensor_pickle(TENSORS)
    for damaged, words in (
        (b"", "expected a pickle"),
        (content[:-40], "cut off"),
        (content.replace(b"_load_from_bytes", b"_load_from_bites"), "wants to import torch.storage._load_from_bites"),
        (content.replace(b"FloatStorage", b"QuietStorage"), "wants to import torch.QuietStorage"),
        (tensor_pickle({"a": print}), "wants to import"),
    ):
        with pytest.raises(ReadError, match=words):
            parse_pickle(damaged, PATH)


@settings(derandomize=True, deadline=None, max_examples=150, database=None)
@given(place=st.integers(0, 10**6), byte=st.integers(0, 255), cut=st.booleans())
def test_whatever_is_in_the_file_only_our_error_comes(place, byte, cut):
    content = bytearray(tensor_pickle(TENSORS))
    content[place % len(content)] = byte
    with suppress(ReadError):
        parse_pickle(bytes(content[: place % len(content)] if cut else content), PATH)


def _nested(depth: int, calls: int) -> bytes:
    """Return a pickle in which files of torch's older format stand in each other, each read several times."""
    content = b"\x80\x02N." * 5
    for _ in range(depth):
        call = b"ctorch.storage\n_load_from_bytes\nB" + struct.pack("<I", len(content)) + content + b"\x85R"
        content = b"\x80\x02" + b"0".join([call] * calls) + b"."
    return content


@pytest.mark.parametrize(("depth", "calls"), [(1, 1), (2, 3), (8, 3), (150, 1)])
def test_files_in_files_are_refused_and_not_followed(depth, calls, tmp_path):
    with pytest.raises(ReadError, match=r"x\.pkl"):
        parse_pickle(_nested(depth, calls), tmp_path / "x.pkl")
