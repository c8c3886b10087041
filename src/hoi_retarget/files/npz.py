"""Arrays out of .npz files without numpy's own reader: checksums compared, nothing evaluated, no pickle executed."""

import io
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.files.reading import Archive

# The start of an .npy file as numpy writes it: matched, never evaluated.
_NPY = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '(?P<dtype>[<|](?P<kind>[a-zA-Z])\d*)', "
    rb"'fortran_order': (?P<fortran>True|False), 'shape': \((?P<shape>[\d, ]*)\), \} *\n",
    re.DOTALL,
)


def members(content: bytes) -> dict[str, bytes]:
    """Return the .npy files of an .npz by array name, their checksums compared; raises `ValueError`."""
    return dict(Members(content))


class Members(Mapping[str, Any]):  # A check of types would unpack bytes.
    """The .npy files of an .npz by array name, each unpacked when it is asked for; raises `ValueError`, also later."""

    def __init__(self, content: bytes) -> None:
        self._archive = Archive(content)
        self._names = {name.removesuffix(".npy"): name for name in self._archive}

    def __getitem__(self, name: str) -> bytes:
        return self._archive[self._names[name]]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def encode(arrays: Mapping[str, Any]) -> bytes:
    """Return an uncompressed .npz file without pickled objects: the same bytes for the same arrays."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **dict(arrays))
    return buffer.getvalue()


def array(name: str, content: bytes, kinds: str) -> np.ndarray:
    """Return the array of an .npy file, of a numpy kind among `kinds`, or raise `ValueError`."""
    header = _NPY.match(content)
    if header is None:
        raise ValueError(f"{name} is no plain array")
    if header["kind"].decode() not in kinds:
        raise ValueError(f"{name} holds {header['dtype'].decode()!r}, expected numpy kind {kinds!r}")
    shape = tuple(int(size) for size in header["shape"].replace(b",", b" ").split())
    order = "F" if header["fortran"] == b"True" else "C"
    try:
        values = np.ndarray(shape, header["dtype"].decode(), content, header.end(), order=order)
    except (TypeError, OverflowError) as error:
        raise ValueError(f"{name}: {error}") from error
    if header.end() + values.nbytes != len(content):
        raise ValueError(f"{name} is followed by {len(content) - header.end() - values.nbytes} bytes of something else")
    if values.size > len(content):  # Texts of no letters take no bytes.
        raise ValueError(f"{name} has shape {shape} in {len(content)} bytes")
    if values.dtype.kind == "U":
        values.tobytes().decode("utf-32-le")
    return values


def object_or_array(path: Path, name: str, content: bytes) -> Any:
    """Return the content of an `.npy` file: an array of numbers or text, its only object, or a list of several objects.

    Several sources keep a dictionary in an array of their `.npz` files, as `numpy.save(..., allow_pickle=True)` writes
    them: one object, or a list of some. Nothing of it is executed; `ReadError` is raised where it is damaged, or holds
    anything else than plain values and arrays.
    """
    from hoi_retarget.files.array_pickle import unpickle  # noqa: PLC0415  # plain arrays need no pickles
    from hoi_retarget.files.safe_pickle import RefusedError, plain  # noqa: PLC0415  # as above

    header = _NPY.match(content)
    try:
        if header is None or (header["kind"], header["fortran"]) != (b"O", b"False"):
            return array(name, content, "fiubUS")
        values = plain(unpickle(content[header.end() :]), objects=True)
    except (RefusedError, ValueError) as error:
        raise ReadError(f"{path}: {name} cannot be read: {error}. Download the file again.") from error
    single = not header["shape"].strip()
    if not isinstance(values, list) or (single and len(values) != 1):
        raise ReadError(f"{path}: {name} is no array of objects, although it says so. Download the file again.")
    return values[0] if single else values
