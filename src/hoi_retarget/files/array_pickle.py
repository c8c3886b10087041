"""Arrays in pickles of numpy (protocols 2 to 5), joblib and torch, read without executing anything.

joblib puts an array's bytes right behind its description, in the middle of the pickle. Tensors are views of storages:
these are elsewhere in a torch file, or each is a whole file of torch's older format inside of the pickle.
"""

import hashlib
import math
import mmap
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.files.reading import limit_unpacked, map_bytes
from hoi_retarget.files.safe_pickle import (
    MAX_SURPLUS,
    Class,
    Function,
    Names,
    RefusedError,
    Stub,
    Unpickler,
    plain,
    refusals,
)

_COMPRESSED = b"\x78"  # How joblib's compressed pickles begin.
_KINDS = "biufU"
_MAX_EMPTY = 1 << 20  # Elements along the sizes that are not zero of an array without bytes.
_MAX_DIMENSIONS, _MAX_TENSOR_DIMENSIONS = 8, 32
_MAX_TYPE_LETTERS = 20  # numpy takes its time with long names of types.
_ADVICE = "Save it again as plain numbers, strings, lists, dicts and numpy arrays of numbers, or download it again."
LEGACY_MAGIC = (0x1950A86A20F9469CFC6C).to_bytes(10, "little")
_LEGACY_PROTOCOL = 1001
# Storage classes of torch and the types of their bytes; bfloat16 is the upper half of a float32.
_STORAGE_DTYPES = {
    "FloatStorage": "f4",
    "DoubleStorage": "f8",
    "HalfStorage": "f2",
    "BFloat16Storage": "u2",
    "LongStorage": "i8",
    "IntStorage": "i4",
    "ShortStorage": "i2",
    "CharStorage": "i1",
    "ByteStorage": "u1",
    "BoolStorage": "u1",
}
_VIEWS = [], [None]  # A storage that is part of another one, in older files: none is.


def parse_pickle(content: bytes, path: Path) -> Any:
    """Return the value of a pickle: read-only arrays, numbers, text, None, in plain containers.

    `path` is only named in errors. Raises `ReadError` where the file is damaged, or holds anything else, such as code
    to be executed.
    """
    with refusals(path, _ADVICE):
        return plain(unpickle(content))


def read_joblib(path: Path) -> tuple[Any, str]:
    """Return the value of a pickle, as `parse_pickle` does, and the file's SHA-256; large arrays stay in the file."""
    content = map_bytes(path)
    with refusals(path, "Download it again."):
        return plain(unpickle(content)), hashlib.sha256(content).hexdigest()


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


def unpickle(content: bytes | mmap.mmap, names: Names | None = None, *, encoding: str = "utf-8") -> Any:
    """Return the value of a pickle with stubs in it, which `plain` replaces.

    Raises `RefusedError` where it is damaged, or names something else.

    `content`: joblib's arrays in a mapped file are views of it; `names`: everything that it may name; None for
    `ARRAYS`; `encoding`: of the strings of Python 2.
    """
    if not content:
        raise RefusedError("the file is empty, expected a pickle")
    if content[:1] == _COMPRESSED:
        content = _decompressed(content, limit_unpacked(len(content)))
    if content[:1] != b"\x80":
        raise RefusedError(f"it starts with {content[:4]!r}, which no pickle of protocol 2 to 5 does")
    return Unpickler(content, ARRAYS if names is None else names, encoding=encoding).next()


def _decompressed(content: bytes | mmap.mmap, limit: int) -> bytes:
    try:
        unpacked = zlib.decompressobj()
        pickled = unpacked.decompress(content, limit)
    except zlib.error as error:
        raise RefusedError(f"it cannot be decompressed ({error})") from error
    if not unpacked.eof:
        raise RefusedError(f"its compressed content is cut off, or unpacks to more than {limit / 1e6:.4g} MB")
    return pickled


# numpy and joblib


@dataclass(eq=False)
class _Type(Stub):
    """A numpy type; its byte order comes after its name."""

    name: str
    order: str = "="

    def build(self, _unpickler: Unpickler, state: Any) -> None:
        """Take the byte order."""
        if not isinstance(state, tuple) or len(state) < 2 or not isinstance(state[1], str):
            raise RefusedError("a numpy type has no byte order")
        self.order = state[1] if state[1] in ("<", ">") else "="

    @property
    def dtype(self) -> np.dtype:
        """The type; raises `RefusedError` unless it is one of numbers or text."""
        try:
            dtype = np.dtype(self.name if len(self.name) <= _MAX_TYPE_LETTERS else "")
        except (TypeError, ValueError) as error:
            raise RefusedError(f"an array is of type {self.name[:80]!r}, which numpy has not") from error
        if dtype.kind not in _KINDS:
            raise RefusedError(f"refused: an array is of type {self.name!r}; expected numbers or text")
        return dtype.newbyteorder("<" if self.order == "<" else ">") if self.order != "=" else dtype


@dataclass(eq=False)
class Array(Stub):
    """An array; its content comes after its name."""

    content: np.ndarray | list | None = None  # Of an array of objects, these one after the other.

    def build(self, unpickler: Unpickler, state: Any) -> None:
        """Take the content in numpy's words: `(version, shape, type, whether columns go first, content)`."""
        match state:
            case (_, _, _, _, list(objects)) if self.content is None:
                self.content = objects
            case (_, shape, kind, fortran, bytes(raw)) if self.content is None:
                self.content = _array_of(unpickler, raw, kind, shape, bool(fortran))
            case (_, shape, kind, fortran, str(raw)) if self.content is None:  # Python 2 writes bytes as text.
                self.content = _array_of(unpickler, raw.encode("latin-1"), kind, shape, bool(fortran))
            case _:
                raise RefusedError("an array's content is described by something else")

    def value(self) -> np.ndarray | list:
        """Return the content."""
        if self.content is None:
            raise RefusedError("an array has no content")
        return self.content


class _JoblibArray(Array):
    """joblib's description of an array; the bytes follow it."""

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
    sizes: tuple[Any, ...] = shape if isinstance(shape, tuple) and len(shape) <= _MAX_DIMENSIONS else (None,)
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
        if math.prod(max(1, size) for size in shape) > _MAX_EMPTY:
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


def _encode(unpickler: Unpickler, text: str, _encoding: str) -> bytes:
    """Return the bytes that protocol 2 has to write as text."""
    unpickler.spend(len(text))
    return text.encode("latin-1")


# torch


@dataclass(frozen=True)
class _StorageType(Stub):
    """A storage class of torch, such as `FloatStorage`."""

    name: str


@dataclass(eq=False)
class Storage(Stub):
    """The elements that tensors view."""

    kind: _StorageType
    key: str
    count: int
    elements: np.ndarray | None = None  # None until `fill`.

    @property
    def _dtype(self) -> np.dtype:
        return np.dtype(_STORAGE_DTYPES[self.kind.name])

    @property
    def size(self) -> int:
        """Bytes of all elements."""
        return self.count * self._dtype.itemsize

    def refused(self, found: str) -> RefusedError:
        """Return the error for a file that has other bytes for it, in words."""
        return RefusedError(
            f"storage {self.key[:80]!r} should hold {self.count} elements of {self._dtype.itemsize} bytes, but {found}"
        )

    def fill(self, raw: bytes, byte_order: Literal["<", ">"]) -> None:
        """Take the elements' bytes, and bring them into this machine's order."""
        native = self._dtype
        values = (np.frombuffer(raw, native.newbyteorder(byte_order)) if raw else np.zeros(0)).astype(
            native, copy=False
        )
        if self.kind.name == "BFloat16Storage":
            values = (values.astype(np.uint32) << 16).view(np.float32)
        if self.kind.name == "BoolStorage":
            values = values != 0  # Another byte than 0 or 1 would not be a bool to numpy.
        values.setflags(write=False)
        self.elements = values


class Storages(dict[str, Storage]):
    """The storages that a pickle refers to, by key."""

    def refer(self, reference: Any) -> Storage:
        """Return the storage for `("storage", type, key, location, count[, view])`; raises `RefusedError`."""
        match reference:
            case ("storage", _StorageType() as kind, str(key), _, count, *view) if _is_count(count) and view in _VIEWS:
                pass
            case _:
                raise RefusedError("a reference outside the pickle is not a tensor's storage")
        known = self.setdefault(key, Storage(kind, key, count))
        if (known.kind, known.count) != (kind, count):
            raise RefusedError(
                f"two tensors disagree about storage {key[:80]!r}: {known.count} of {known.kind.name} or {count} of "
                f"{kind.name}"
            )
        return known


@dataclass(eq=False)
class _Tensor(Stub):
    """A view of a storage, counted in elements; it is checked already."""

    storage: Storage
    offset: int
    size: tuple[int, ...]
    stride: tuple[int, ...]

    def value(self) -> np.ndarray:
        """Return the view."""
        return self._view

    @cached_property
    def _view(self) -> np.ndarray:
        elements = self.storage.elements
        if elements is None:
            raise RefusedError(f"a tensor's storage {self.storage.key[:80]!r} is not in the file")
        if not math.prod(self.size):
            return np.zeros(self.size, dtype=elements.dtype)
        steps = [
            step * elements.itemsize if length > 1 else 0 for length, step in zip(self.size, self.stride, strict=True)
        ]
        return np.lib.stride_tricks.as_strided(elements[self.offset :], self.size, steps, writeable=False)


def _is_count(value: Any) -> bool:
    return type(value) is int and 0 <= value < 1 << 48


def _are_counts(values: Any) -> bool:
    return isinstance(values, tuple) and len(values) <= _MAX_TENSOR_DIMENSIONS and all(map(_is_count, values))


def _rebuild_tensor(unpickler: Unpickler, storage: Storage, offset: Any, size: Any, stride: Any, *_: Any) -> _Tensor:
    """Return a view of a storage."""
    if not (_is_count(offset) and _are_counts(size) and _are_counts(stride) and len(size) == len(stride)):
        raise RefusedError("a tensor's offset, size or stride is not a number that a tensor can have")
    count = math.prod(size)
    # A tensor without elements may still claim 0 x a huge number of rows, which numpy cannot describe.
    if math.prod(max(1, length) for length in size) > max(MAX_SURPLUS, storage.count):
        raise RefusedError(f"a tensor claims {count} elements of a storage that has {storage.count}")
    last = offset + sum((length - 1) * step for length, step in zip(size, stride, strict=True))
    if count and last >= storage.count:
        raise RefusedError(f"a tensor reaches element {last} of a storage that has {storage.count}")
    unpickler.spend(max(0, count - storage.count))
    return _Tensor(storage, offset, size, stride)


def _load_from_bytes(unpickler: Unpickler, content: bytes) -> Storage:
    """Return the only storage in a whole file of torch's older format."""
    unpickler.spend(len(content))
    storage, count = parse_legacy_torch(content)
    if not isinstance(storage, Storage) or count != 1:
        raise RefusedError("the file inside, of a tensor's storage, holds something else")
    return storage


def parse_legacy_torch(content: bytes) -> tuple[Any, int]:
    """Return the value in a file of torch's format before 1.6, with stubs in it, and the number of its storages.

    Pickles of the magic number, the protocol, facts of the writing machine, the value, and the list of its storages;
    then for each storage its number of elements and its bytes. Raises `RefusedError`.
    """
    storages = Storages()
    # A file of this format holds no further file: nesting would need no bytes, and no end.
    names = {name: stub for name, stub in ARRAYS.items() if name != _STORAGE_FILE}
    pickles = Unpickler(content, names, refer=storages.refer)
    _, protocol, machine, value, keys = (pickles.next() for _ in range(5))
    if protocol != _LEGACY_PROTOCOL or not isinstance(machine, dict):
        raise RefusedError(f"torch's older format, but not its protocol {_LEGACY_PROTOCOL}")
    little = bool(machine.get("little_endian", True))
    if not isinstance(keys, list) or not all(isinstance(key, str) for key in keys) or len(set(keys)) < len(keys):
        raise RefusedError("the list of storages is missing, or names one twice")
    position = pickles.source.position
    for key in keys:
        if key not in storages:
            raise RefusedError("the list of storages does not fit the tensors")
        storage = storages[key]
        start, end = position + 8, position + 8 + storage.size
        stated = int.from_bytes(content[position:start], "little" if little else "big")
        if stated != storage.count or end > len(content):
            raise storage.refused(f"states {stated} and {max(0, len(content) - start)} bytes follow")
        storage.fill(content[start:end], "<" if little else ">")
        position = end
    return value, len(storages)


_NO_TENSOR = "a tensor is described by other values than storage, offset, size and stride"
_REBUILD = Function(_rebuild_tensor, (Storage, object, object, object, ...), _NO_TENSOR)
_NUMPY_FUNCTIONS = {
    "multiarray._reconstruct": Function(
        lambda *_: Array(), (_NDARRAY, ...), "an array of another class than numpy.ndarray"
    ),
    "multiarray.scalar": Function(
        lambda unpickler, kind, raw: _array_of(unpickler, raw, kind, (), fortran=False).item(),
        (object, bytes),
        "a numpy number is described by other values than type and bytes",
    ),
    "numeric._frombuffer": Function(
        lambda unpickler, raw, kind, shape, order: Array(_array_of(unpickler, raw, kind, shape, order == "F")),
        (bytes, object, object, object),
        "an array is made from something that is no bytes",
    ),
}
_STORAGE_FILE = ("torch.storage", "_load_from_bytes")
ARRAYS: Names = {
    ("numpy", "ndarray"): _NDARRAY,
    ("numpy", "dtype"): Function(lambda _, name, *_more: _Type(name), (str, ...), "a numpy type without a name"),
    **{
        (f"numpy.{core}.{module}", name): function
        for core in ("core", "_core")
        for (module, _, name), function in ((key.partition("."), value) for key, value in _NUMPY_FUNCTIONS.items())
    },
    ("_codecs", "encode"): Function(_encode, (str, "latin1"), "bytes are written in another way than as latin1 text"),
    # The bytes of an empty array, which protocol 2 writes as a call.
    ("__builtin__", "bytes"): Function(lambda _: b"", (), "bytes are made from something else"),
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): Class(_JoblibArray),
    ("torch._utils", "_rebuild_tensor"): _REBUILD,
    ("torch._utils", "_rebuild_tensor_v2"): _REBUILD,
    ("torch._utils", "_rebuild_parameter"): Function(
        lambda _, tensor, *_more: tensor, (_Tensor, ...), "a parameter is described by something that is not a tensor"
    ),
    _STORAGE_FILE: Function(_load_from_bytes, (bytes,), "a tensor's storage is made from something that is no bytes"),
    ("torch", "Size"): Function(
        lambda _, size: size, (tuple,), "a torch.Size is built from something that is not a tuple of numbers"
    ),
    **{("torch", name): _StorageType(name) for name in _STORAGE_DTYPES},
    ("collections", "OrderedDict"): Function(
        lambda _: {}, (), "an OrderedDict is built from arguments, expected an empty one that is then filled"
    ),
    # The order of ProtoMotions' motions: the text of an enumeration's member.
    ("protomotions.simulator.base_simulator.simulator_state", "StateConversion"): Function(
        lambda _, text: text, (str,), "a member of an enumeration is made from something that is no text"
    ),
    # The state of CARI4D's optimization, stored beside its result; its attributes are left out.
    ("learning.training.training_utils", "TrainState"): Class(dict),
}
"""Everything that pickles of plain values, arrays and tensors may name."""
