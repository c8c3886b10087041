"""Arrays in pickles, as numpy (protocols 2 to 5) and joblib write them, read without executing anything.

joblib puts an array's bytes right behind its description, in the middle of the pickle.
"""

import math
import mmap
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.files.archive import MAXIMUM_SIZE
from hoi_retarget.files.safe_pickle import Class, Function, Names, RefusedError, StandIn, Unpickler, plain, refusals

COMPRESSED = b"\x78"
"""How joblib's compressed pickles begin."""
_KINDS = "biufU"
_MAXIMUM_EMPTY = 1 << 20  # Elements along the sizes that are not zero of an array without bytes.
_MAXIMUM_DIMENSIONS = 8
_MAXIMUM_NAME = 20  # Letters of a type: numpy takes its time with long ones.
_ADVICE = (
    "Save it again as plain numbers, strings, lists, dictionaries and numpy arrays of numbers, or download it again."
)


def parse_pickle(content: bytes, path: Path, limit: int = MAXIMUM_SIZE) -> Any:
    """Return what the bytes of a pickle hold: read-only arrays, numbers, text, None, in plain containers.

    `path` is only named in errors; what is compressed unpacks to at most `limit` bytes.

    Raises:
        ReadError: the file is damaged, or holds anything else, such as something that would be executed.
    """
    with refusals(path, _ADVICE):
        return plain(unpickle(content, ARRAYS, limit=limit))


def unpickle(content: bytes | mmap.mmap, names: Names, *, encoding: str = "utf-8", limit: int = MAXIMUM_SIZE) -> Any:
    """Return what a pickle holds, with stand-ins for arrays that `plain` replaces; raises `RefusedError`.

    The arrays of joblib in a mapped file are views of it.
    """
    if not content:
        raise RefusedError("the file is empty, expected a pickle")
    if content[:1] == COMPRESSED:
        content = _decompressed(content, limit)
    if content[:1] != b"\x80":
        raise RefusedError(f"it starts with {content[:4]!r}, which no pickle of protocol 2 to 5 does")
    return Unpickler(content, names, encoding=encoding).next()


def _decompressed(content: bytes | mmap.mmap, limit: int) -> bytes:
    try:
        unpacked = zlib.decompressobj()
        pickled = unpacked.decompress(content, limit)
    except zlib.error as error:
        raise RefusedError(f"it cannot be decompressed ({error})") from error
    if not unpacked.eof:
        raise RefusedError(f"its compressed content is cut off, or unpacks to more than {limit / 1e6:.4g} MB")
    return pickled


# Stand-ins


@dataclass(eq=False)
class _Type(StandIn):
    """A numpy type, whose byte order comes after its name."""

    name: str
    order: str = "="

    def build(self, _unpickler: Unpickler, state: Any) -> None:
        """Take the byte order."""
        if not isinstance(state, tuple) or len(state) < 2 or not isinstance(state[1], str):
            raise RefusedError("a numpy type has no byte order")
        self.order = state[1] if state[1] in ("<", ">") else "="

    @property
    def dtype(self) -> np.dtype:
        """Return the type; raises `RefusedError` unless it is one of numbers or text."""
        try:
            dtype = np.dtype(self.name)
        except (TypeError, ValueError) as error:
            raise RefusedError(f"an array is of type {self.name!r}, which numpy has not") from error
        if dtype.kind not in _KINDS:
            raise RefusedError(f"refused: an array is of type {self.name!r}; expected numbers or text")
        return dtype if self.order == "=" else dtype.newbyteorder(self.order)  # pyright: ignore[reportArgumentType]


@dataclass(eq=False)
class Array(StandIn):
    """An array whose content comes after its name."""

    content: np.ndarray | list | None = None
    """Of an array of objects, these one after the other."""

    def build(self, unpickler: Unpickler, state: Any) -> None:
        """Take the content as numpy describes it: `(version, shape, type, whether columns go first, content)`."""
        match state:
            case (_, _, _, _, list(objects)) if self.content is None:
                self.content = objects
            case (_, shape, kind, fortran, bytes(raw)) if self.content is None:
                self.content = _array_of(unpickler, raw, kind, shape, bool(fortran))
            case (_, shape, kind, fortran, str(raw)) if self.content is None:  # Python 2 writes bytes as text.
                self.content = _array_of(unpickler, _latin(raw), kind, shape, bool(fortran))
            case _:
                raise RefusedError("an array's content is described by something else")

    def value(self) -> np.ndarray | list:
        """Return the content."""
        if self.content is None:
            raise RefusedError("an array has no content")
        return self.content


class _Following(Array):
    """joblib's description of an array whose bytes follow it."""

    def build(self, unpickler: Unpickler, state: Any) -> None:
        """Take the bytes that follow."""
        kind, shape = (state.get("dtype"), state.get("shape")) if isinstance(state, dict) else (None, None)
        if not isinstance(kind, _Type) or state.get("subclass") is not _NDARRAY or self.content is not None:
            raise RefusedError("joblib's description of an array is not complete")
        if state.get("numpy_array_alignment_bytes") is not None:
            unpickler.source.read(unpickler.source.read(1)[0])
        raw = unpickler.source.view(_count(shape) * kind.dtype.itemsize)
        self.content = _array_of(unpickler, raw, kind, shape, state.get("order") == "F")


_NDARRAY = Class()


def _count(shape: Any) -> int:
    sizes: tuple[Any, ...] = shape if isinstance(shape, tuple) and len(shape) <= _MAXIMUM_DIMENSIONS else (None,)
    if not all(type(size) is int and 0 <= size < 1 << 40 for size in sizes):
        raise RefusedError("an array's shape is no tuple of sizes")
    return math.prod(sizes)


def _array_of(unpickler: Unpickler, raw: bytes | memoryview, kind: Any, shape: Any, fortran: bool) -> np.ndarray:
    if not isinstance(kind, _Type):
        raise RefusedError("an array's type is described by something else")
    count, dtype = _count(shape), kind.dtype
    if len(raw) != count * dtype.itemsize:
        raise RefusedError(f"an array of shape {shape} and type {dtype} cannot have {len(raw)} bytes")
    if not raw:
        # Sizes that no bytes pay for.
        if math.prod(max(1, size) for size in shape) > _MAXIMUM_EMPTY:
            raise RefusedError(f"an array of shape {shape} and type {dtype} has no bytes")
        return np.zeros(shape, dtype=dtype.newbyteorder("="))
    unpickler.spend(len(raw))
    array = np.frombuffer(raw, dtype=dtype).reshape(shape, order="F" if fortran else "C")
    if dtype.kind == "U":
        try:
            str(raw, "utf-32-be" if dtype.byteorder == ">" else "utf-32-le")
        except UnicodeDecodeError as error:
            raise RefusedError("an array of text holds what is no text") from error
    array = np.asarray(array != 0) if dtype.kind == "b" else array.astype(dtype.newbyteorder("="), copy=False)
    array.setflags(write=False)
    return array


def _latin(text: str) -> bytes:
    try:
        return text.encode("latin-1")
    except UnicodeEncodeError as error:
        raise RefusedError("bytes are written as text that is not latin1") from error


# What is named


def _reconstruct(_unpickler: Unpickler, arguments: tuple) -> Array:
    if not arguments or arguments[0] is not _NDARRAY:
        raise RefusedError("an array of another class than numpy.ndarray")
    return Array()


def _dtype(_unpickler: Unpickler, arguments: tuple) -> _Type:
    if not arguments or not isinstance(arguments[0], str) or len(arguments[0]) > _MAXIMUM_NAME:
        raise RefusedError("a numpy type without a name")
    return _Type(arguments[0])


def _from_buffer(unpickler: Unpickler, arguments: tuple) -> Array:
    if len(arguments) != 4 or not isinstance(arguments[0], bytes):
        raise RefusedError("an array is made from something that is no bytes")
    return Array(_array_of(unpickler, arguments[0], arguments[1], arguments[2], arguments[3] == "F"))


def _scalar(unpickler: Unpickler, arguments: tuple) -> int | float | bool | str:
    if len(arguments) != 2 or not isinstance(arguments[1], bytes):
        raise RefusedError("a numpy number is described by other values than type and bytes")
    return _array_of(unpickler, arguments[1], arguments[0], (), fortran=False).item()


def _encode(unpickler: Unpickler, arguments: tuple) -> bytes:
    """Return the bytes that protocol 2 has to write as text."""
    if len(arguments) != 2 or not isinstance(arguments[0], str) or arguments[1] != "latin1":
        raise RefusedError("bytes are written in another way than as latin1 text")
    unpickler.spend(len(arguments[0]))
    return _latin(arguments[0])


def _no_bytes(_unpickler: Unpickler, arguments: tuple) -> bytes:
    """Return the bytes of an empty array, which protocol 2 writes as a call."""
    if arguments:
        raise RefusedError("bytes are made from something else")
    return b""


ARRAYS: Names = {
    ("numpy", "ndarray"): _NDARRAY,
    ("numpy", "dtype"): Function(_dtype),
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): Class(_Following),
    ("_codecs", "encode"): Function(_encode),
    ("__builtin__", "bytes"): Function(_no_bytes),
    **{
        (f"numpy.{core}.{module}", name): Function(call)
        for core in ("core", "_core")
        for module, name, call in (
            ("multiarray", "_reconstruct", _reconstruct),
            ("multiarray", "scalar", _scalar),
            ("numeric", "_frombuffer", _from_buffer),
        )
    },
}
"""What pickles of plain values and numpy's arrays may name."""
