"""Tensors in plain pickles, as torch writes them there: read without torch, nothing executed."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoi_retarget.errors import ReadError
from hoi_retarget.files.torch_file import parse_tensors
from parahome_writer import tensor_pickle

VALUES = {
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
def test_what_is_written_comes_back(protocol):
    read = parse_tensors(tensor_pickle(VALUES, protocol), PATH)
    assert list(read) == list(VALUES)
    for name, value in VALUES.items():
        assert np.array_equal(read[name], value)
        assert not isinstance(value, np.ndarray) or (read[name].dtype, read[name].shape) == (value.dtype, value.shape)


def test_a_tensor_alone():
    assert np.array_equal(parse_tensors(tensor_pickle(np.eye(3)), PATH), np.eye(3))


def test_damaged_files_have_one_error():
    content = tensor_pickle(VALUES)
    for damaged, words in (
        (b"", "expected a pickle"),
        (content[:-40], "cut off"),
        (content.replace(b"_load_from_bytes", b"_load_from_bites"), "wants to import torch.storage._load_from_bites"),
        (content.replace(b"FloatStorage", b"QuietStorage"), "wants to import torch.QuietStorage"),
        (tensor_pickle({"a": print}), "wants to import"),
    ):
        with pytest.raises(ReadError, match=words):
            parse_tensors(damaged, PATH)


@settings(derandomize=True, deadline=None, max_examples=150, database=None)
@given(place=st.integers(0, 10**6), byte=st.integers(0, 255), cut=st.booleans())
def test_whatever_is_in_the_file_only_our_error_comes(place, byte, cut):
    content = bytearray(tensor_pickle(VALUES))
    content[place % len(content)] = byte
    with suppress(ReadError):
        parse_tensors(bytes(content[: place % len(content)] if cut else content), PATH)
