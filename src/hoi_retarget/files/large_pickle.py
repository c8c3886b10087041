"""Reads pickles that joblib wrote and that are too large to hold: what they hold, with the arrays left in the file.

joblib puts an array's bytes right behind its description, in the middle of the pickle. The pickle is interpreted once,
without executing it; its arrays then are views of the mapped file, of which only those that are looked at are read.
"""

import hashlib
import mmap
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.files.array_pickle import ARRAYS, parse_raw, plain
from hoi_retarget.files.pickle_machine import Dialect, Machine, RefusedError
from hoi_retarget.files.torch_file import read_bytes

_COMPRESSED = b"\x78"


def read_large_pickle(path: Path) -> tuple[Any, str]:
    """Return what a pickle of plain values and arrays holds, arrays read-only, and the file's SHA-256.

    Raises:
        ReadError: the file is missing, damaged, or holds anything else, such as something that would be executed.
    """
    content = read_bytes(path)
    if not content:
        raise ReadError(f"{path}: the file is empty, expected a pickle. Download it again.")
    digest = hashlib.sha256(content).hexdigest()
    dialect = ARRAYS if content.startswith(_COMPRESSED) else _leaving_arrays_in(path)
    try:
        return plain(parse_raw(content, dialect), {}), digest
    except RefusedError as error:
        raise ReadError(f"{path}: {error.what}. Download it again.") from error


def starts_with(path: Path, names: tuple[bytes, ...], size: int) -> bool:
    """Return whether all names are among the first bytes of a pickle; raises `ReadError`."""
    try:
        with path.open("rb") as file:
            start = file.read(size)
        if start.startswith(_COMPRESSED):
            start = zlib.decompressobj().decompress(start, size)
    except (OSError, zlib.error) as error:
        raise ReadError(f"{path}: cannot be read ({error}).") from error
    return all(name in start for name in names)


def _leaving_arrays_in(path: Path) -> Dialect:
    """Return the dialect of arrays, in which those whose bytes follow are views of the file."""
    try:
        with path.open("rb") as file:
            mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except (OSError, ValueError) as error:
        raise ReadError(f"{path}: cannot be mapped into memory ({error}).") from error

    def build(machine: Machine) -> None:
        before = machine.position
        ARRAYS.operations[b"b"](machine)
        if machine.position > before:
            target = machine.stack[-1]
            target.content = _view(mapped, target.content, machine.position)

    return Dialect(ARRAYS.names, {**ARRAYS.operations, b"b": build})


def _view(mapped: mmap.mmap, array: np.ndarray, end: int) -> np.ndarray:
    """Return an array as a view of the file where its bytes end; the array itself where it is none of its bytes."""
    if not array.size:
        return array
    order = "C" if array.flags.c_contiguous else "F"
    raw = np.frombuffer(mapped, np.uint8, array.nbytes, end - array.nbytes)
    if raw.tobytes() != array.tobytes(order):  # In another byte order, for example.
        return array
    return raw.view(array.dtype).reshape(array.shape, order=order)
