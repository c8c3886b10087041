"""Bytes of files: the same for the same arrays."""

import io
import json
import pickle
from collections.abc import Mapping
from typing import Any

import numpy as np

_PICKLED_BY_NUMPY_2 = b"cnumpy._core.multiarray\n_reconstruct\n"
_READ_BY_ALL_NUMPYS = b"cnumpy.core.multiarray\n_reconstruct\n"


def to_npz(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return an uncompressed .npz file without pickled objects."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **dict(arrays))  # pyright: ignore[reportArgumentType]
    return buffer.getvalue()


def to_json(content: Mapping[str, Any]) -> bytes:
    """Return an indented JSON file; question marks stand for what no text can hold, such as half a character."""
    return (json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode("utf-8", "replace")


def to_pickle(content: Mapping[str, Any]) -> bytes:
    """Return a pickled dict of plain values and arrays that numpy 1 and 2 both read."""
    # Protocol 3 spells the names of functions as lines of text. numpy 2 has another name for the one
    # that makes an array; numpy 1 knows only the older one, which numpy 2 knows too. It is spelled
    # once, before any array's numbers.
    return pickle.dumps(dict(content), protocol=3).replace(_PICKLED_BY_NUMPY_2, _READ_BY_ALL_NUMPYS, 1)


def rate(fps: float) -> int | float:
    """Return a rate as the whole number that it is in most files, else as it is."""
    return int(fps) if float(fps).is_integer() else float(fps)
