"""Reads Python pickles that hold numpy arrays beside plain values, without executing what they hold.

The dialect of `pickle_machine` that knows numpy's arrays, as `pickle` (protocols 2 to 5) and joblib write
them: joblib puts an array's bytes right behind its description, in the middle of the pickle.
"""

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.files.pickle_machine import TORCH, Dialect, Function, Machine, RefusedError, damaged, interpret
from hoi_retarget.files.torch_file import read_bytes

MAXIMUM_SIZE = 1 << 32
"""Bytes that a compressed file may unpack to."""
_KINDS = "biufU"
_MAXIMUM_EMPTY = 1 << 20  # Elements along the sizes that are not zero of an array without bytes.
_ADVICE = (
    "Save it again as plain numbers, strings, lists, dictionaries and numpy arrays of numbers, or download it again."
)


def read_pickle(path: Path) -> Any:
    """Return what a pickle holds: read-only numpy arrays, numbers, strings, None, in plain containers.

    Raises:
        ReadError: the file is missing, damaged, or holds anything else, such as something that would be executed.
    """
    return parse_pickle(read_bytes(path), path)


def parse_pickle(content: bytes, path: Path) -> Any:
    """Return what the bytes of a pickle hold; `path` is only named in errors.

    Raises `ReadError` as `read_pickle` does.
    """
    if not content:
        raise ReadError(f"{path}: the file is empty, expected a pickle. Download it again.")
    try:
        return plain(parse_raw(content, ARRAYS), {})
    except RefusedError as error:
        raise ReadError(f"{path}: {error.what}. {_ADVICE}") from error


def parse_raw(content: bytes, dialect: Dialect) -> Any:
    """Return what a pickle holds, with stand-ins for arrays that `plain` replaces; raises `RefusedError`."""
    if content[:1] == b"\x78":  # joblib.dump(..., compress=True)
        content = _decompressed(content)
    if content[:1] != b"\x80":
        raise damaged(f"it starts with {content[:4]!r}, which no pickle of protocol 2 to 5 does")
    return interpret(content, _no_storage, dialect=dialect)[0]


def _decompressed(content: bytes) -> bytes:
    try:
        unpacked = zlib.decompressobj()
        plain = unpacked.decompress(content, MAXIMUM_SIZE)
    except zlib.error as error:
        raise damaged(f"it cannot be decompressed ({error})") from error
    if not unpacked.eof:
        raise damaged("its compressed content is cut off, or larger than 4 GB")
    return plain


def _no_storage(*_: object) -> None:
    raise damaged("it refers to a storage of torch, which a plain pickle has not")


# What stands for numpy's things while the pickle is interpreted


@dataclass(frozen=True)
class _Named:
    """A class that a pickle names, such as numpy.ndarray."""

    name: str


@dataclass(eq=False)
class _Type:
    """A numpy type, whose byte order comes after its name."""

    name: str
    order: str = "="

    @property
    def dtype(self) -> np.dtype:
        """Return the type; raises `RefusedError` unless it is one of numbers or text."""
        try:
            dtype = np.dtype(self.name)
        except (TypeError, ValueError) as error:
            raise damaged(f"an array is of type {self.name[:20]!r}, which numpy has not") from error
        if dtype.kind not in _KINDS:
            raise damaged(f"refused: an array is of type {self.name[:20]!r}; expected numbers or text")
        match self.order:
            case "<":
                return dtype.newbyteorder("<")
            case ">":
                return dtype.newbyteorder(">")
        return dtype


@dataclass(eq=False)
class StandIn:
    """An array whose content comes after its name."""

    content: np.ndarray | list | None = None
    """Of an array of objects, what it holds, one after the other."""


@dataclass(eq=False)
class _Wrapper:
    """joblib's description of an array whose bytes follow it."""

    content: np.ndarray | None = None


_NDARRAY, _WRAPPER = _Named("numpy.ndarray"), _Named("joblib.numpy_pickle.NumpyArrayWrapper")


def _array_of(raw: bytes, kind: Any, shape: Any, fortran: bool) -> np.ndarray:
    if not isinstance(kind, _Type):
        raise damaged("an array's type is described by something else")
    if not isinstance(shape, tuple) or not all(type(size) is int and 0 <= size < 1 << 40 for size in shape):
        raise damaged("an array's shape is no tuple of sizes")
    dtype = kind.dtype
    if len(raw) != math.prod(shape) * dtype.itemsize or len(shape) > 8:
        raise damaged(f"an array of shape {shape} and type {dtype} cannot have {len(raw)} bytes")
    if not raw:
        # Sizes that no bytes pay for.
        if math.prod(max(1, size) for size in shape) > _MAXIMUM_EMPTY:
            raise damaged(f"an array of shape {shape} and type {dtype} has no bytes")
        return np.zeros(shape, dtype=dtype.newbyteorder("="))
    array = np.frombuffer(raw, dtype=dtype).reshape(shape, order="F" if fortran else "C")
    if dtype.kind == "U":
        try:
            raw.decode("utf-32-be" if dtype.byteorder == ">" else "utf-32-le")
        except UnicodeDecodeError as error:
            raise damaged("an array of text holds what is no text") from error
    array = np.asarray(array != 0) if dtype.kind == "b" else array.astype(dtype.newbyteorder("="), copy=False)
    array.setflags(write=False)
    return array


def _reconstruct(_machine: Machine, arguments: tuple) -> StandIn:
    if not arguments or arguments[0] is not _NDARRAY:
        raise damaged("an array of another class than numpy.ndarray")
    return StandIn()


def _dtype(_machine: Machine, arguments: tuple) -> _Type:
    if not arguments or not isinstance(arguments[0], str):
        raise damaged("a numpy type without a name")
    return _Type(arguments[0])


def _from_buffer(_machine: Machine, arguments: tuple) -> StandIn:
    if len(arguments) != 4 or not isinstance(arguments[0], bytes):
        raise damaged("an array is made from something that is no bytes")
    return StandIn(_array_of(arguments[0], arguments[1], arguments[2], arguments[3] == "F"))


def _scalar(_machine: Machine, arguments: tuple) -> int | float | bool | str:
    if len(arguments) != 2 or not isinstance(arguments[1], bytes):
        raise damaged("a numpy number is described by other values than type and bytes")
    return _array_of(arguments[1], arguments[0], (), fortran=False).item()


def _encode(_machine: Machine, arguments: tuple) -> bytes:
    """Return the bytes that protocol 2 has to write as text."""
    if len(arguments) != 2 or not isinstance(arguments[0], str) or arguments[1] != "latin1":
        raise damaged("bytes are written in another way than as latin1 text")
    try:
        return arguments[0].encode("latin-1")
    except UnicodeEncodeError as error:
        raise damaged("bytes are written as text that is not latin1") from error


def _no_bytes(_machine: Machine, arguments: tuple) -> bytes:
    """Return the bytes of an empty array, which protocol 2 writes as a call."""
    if arguments:
        raise damaged("bytes are made from something else")
    return b""


# Operations that torch's files do not need


def _push_bytes(width: int) -> Callable[[Machine], None]:
    def operation(machine: Machine) -> None:
        machine.stack.append(machine.take(machine.take_number(width)))

    return operation


def _new_object(machine: Machine) -> None:
    arguments, kind = machine.pop(), machine.pop()
    if kind is not _WRAPPER or arguments != ():
        raise damaged("refused: it builds an object of a class, expected numpy arrays")
    machine.stack.append(_Wrapper())


def _build(machine: Machine) -> None:
    state, target = machine.pop(), machine.pop()
    match target:
        case _Type() if isinstance(state, tuple) and len(state) > 1 and isinstance(state[1], str):
            target.order = state[1] or "="
        case StandIn(content=None) if isinstance(state, tuple) and len(state) == 5 and isinstance(state[4], bytes):
            target.content = _array_of(state[4], state[2], state[1], bool(state[3]))
        case StandIn(content=None) if isinstance(state, tuple) and len(state) == 5 and isinstance(state[4], list):
            raise damaged("refused: an array holds Python objects, expected numbers")
        case _Wrapper(content=None) if isinstance(state, dict):
            target.content = _following_array(machine, state)
        case _:
            raise damaged("it gives attributes to something that has none")
    machine.stack.append(target)


def _following_array(machine: Machine, state: dict) -> np.ndarray:
    kind, shape = state.get("dtype"), state.get("shape")
    if state.get("subclass") is not _NDARRAY or not isinstance(kind, _Type) or not isinstance(shape, tuple):
        raise damaged("joblib's description of an array is not complete")
    if not all(type(size) is int and 0 <= size < 1 << 40 for size in shape):
        raise damaged("an array's shape is no tuple of sizes")
    if state.get("numpy_array_alignment_bytes") is not None:
        machine.take(machine.take_number(1))
    raw = machine.take(math.prod(shape) * kind.dtype.itemsize)
    return _array_of(raw, kind, shape, state.get("order") == "F")


_NAMES: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): _NDARRAY,
    ("numpy", "dtype"): Function("dtype", _dtype),
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): _WRAPPER,
    ("_codecs", "encode"): Function("encode", _encode),
    ("__builtin__", "bytes"): Function("bytes", _no_bytes),
    **{
        (f"numpy.{core}.{module}", name): Function(name, call)
        for core in ("core", "_core")
        for module, name, call in (
            ("multiarray", "_reconstruct", _reconstruct),
            ("multiarray", "scalar", _scalar),
            ("numeric", "_frombuffer", _from_buffer),
        )
    },
}
_TORCH_ONLY = (b"Q",)
ARRAYS = Dialect(
    _NAMES,
    {code: operation for code, operation in TORCH.operations.items() if code not in _TORCH_ONLY}
    | {
        b"C": _push_bytes(1),
        b"B": _push_bytes(4),
        b"\x8e": _push_bytes(8),
        b"\x96": _push_bytes(8),
        b"\x81": _new_object,
        b"b": _build,
    },
)


def plain(value: Any, known: dict[int, Any]) -> Any:
    """Return a value with arrays in the place of what stands for them; shared containers stay shared."""
    if id(value) in known:
        return known[id(value)]
    match value:
        case StandIn() | _Wrapper():
            if value.content is None:
                raise damaged("an array has no content")
            if not isinstance(value.content, list):
                return value.content
            copied: Any = [plain(item, known) for item in value.content]
        case dict():
            copied = {key: plain(item, known) for key, item in value.items()}
        case list():
            copied = [plain(item, known) for item in value]
        case tuple():
            copied = tuple(plain(item, known) for item in value)
        case str() | bytes() | int() | float() | None:
            return value
        case _:
            raise damaged("it holds the name of a class, expected values")
    known[id(value)] = copied
    return copied
