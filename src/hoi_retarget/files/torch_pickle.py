"""Tensors in pickles, as torch writes them: views of storages whose bytes are elsewhere."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from hoi_retarget.files.safe_pickle import (
    MAXIMUM_SURPLUS,
    Class,
    Function,
    Names,
    RefusedError,
    StandIn,
    Unpickler,
    Unread,
)

_MAXIMUM_DIMENSIONS = 32
_VIEWS = [], [None]  # Part of which storage one is, in older files: none.
# Storage classes of torch and how their bytes are read; bfloat16 is the upper half of a float32.
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


@dataclass(frozen=True)
class StorageType(StandIn):
    """A storage class of torch, such as `FloatStorage`."""

    name: str

    @property
    def item_size(self) -> int:
        """Bytes of one element."""
        return np.dtype(_STORAGE_DTYPES[self.name]).itemsize

    def decode(self, raw: bytes, byte_order: Literal["<", ">"]) -> np.ndarray:
        """Return the elements of a storage as a flat array in this machine's byte order."""
        native = np.dtype(_STORAGE_DTYPES[self.name])
        foreign = native.newbyteorder(byte_order)
        values = (np.frombuffer(raw, dtype=foreign) if raw else np.zeros(0)).astype(native, copy=False)
        if self.name == "BFloat16Storage":
            values = (values.astype(np.uint32) << 16).view(np.float32)
        if self.name == "BoolStorage":
            values = values != 0  # Another byte than 0 or 1 would not be a bool to numpy.
        values.setflags(write=False)
        return values


@dataclass(eq=False)
class Storage(StandIn):
    """The elements that tensors view."""

    kind: StorageType
    key: str
    count: int
    elements: np.ndarray | None = None
    """None until `fill`."""

    @property
    def size(self) -> int:
        """Bytes of all elements."""
        return self.count * self.kind.item_size

    def fill(self, raw: bytes, byte_order: Literal["<", ">"]) -> None:
        """Take the elements' bytes."""
        self.elements = self.kind.decode(raw, byte_order)


class Storages(dict[str, Storage]):
    """The storages that a pickle refers to, by key."""

    def refer(self, wanted: Any) -> Storage:
        """Return the storage for `("storage", type, key, location, count[, view])`; raises `RefusedError`."""
        match wanted:
            case ("storage", StorageType() as kind, str(key), _, count, *view) if _is_count(count) and view in _VIEWS:
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
class _Tensor(StandIn):
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


def _rebuild_tensor(unpickler: Unpickler, arguments: tuple) -> _Tensor:
    """Return a view of a storage: `(storage, offset, size, stride, ...)`."""
    if len(arguments) < 4 or not isinstance(arguments[0], Storage):
        raise RefusedError("a tensor is described by other values than storage, offset, size and stride")
    storage, offset, size, stride = arguments[:4]
    if not (
        _is_count(offset)
        and all(isinstance(values, tuple) and all(map(_is_count, values)) for values in (size, stride))
        and len(size) == len(stride) <= _MAXIMUM_DIMENSIONS
    ):
        raise RefusedError("a tensor's offset, size or stride is not a number that a tensor can have")
    count = math.prod(size)
    # A tensor without elements may still claim 0 x a huge number of rows, which numpy cannot describe.
    if math.prod(max(1, length) for length in size) > max(MAXIMUM_SURPLUS, storage.count):
        raise RefusedError(f"a tensor claims {count} elements of a storage that has {storage.count}")
    last = offset + sum((length - 1) * step for length, step in zip(size, stride, strict=True))
    if count and last >= storage.count:
        raise RefusedError(f"a tensor reaches element {last} of a storage that has {storage.count}")
    unpickler.spend(max(0, count - storage.count))
    return _Tensor(storage, offset, size, stride)


def _rebuild_parameter(_unpickler: Unpickler, arguments: tuple) -> _Tensor:
    if not arguments or not isinstance(arguments[0], _Tensor):
        raise RefusedError("a parameter is described by something that is not a tensor")
    return arguments[0]


def _ordered_dict(_unpickler: Unpickler, arguments: tuple) -> dict:
    if arguments:
        raise RefusedError("an OrderedDict is built from arguments, expected an empty one that is then filled")
    return {}


def _size(_unpickler: Unpickler, arguments: tuple) -> tuple:
    size = arguments[0] if len(arguments) == 1 else None
    if not isinstance(size, tuple) or len(size) > _MAXIMUM_DIMENSIONS or not all(map(_is_count, size)):
        raise RefusedError("a torch.Size is built from something that is not a tuple of numbers")
    return size


def _member(_unpickler: Unpickler, arguments: tuple) -> str:
    """Return the text in whose place a member of an enumeration stands."""
    match arguments:
        case (str(value),):
            return value
    raise RefusedError("a member of an enumeration is made from something that is no text")


TENSORS: Names = {
    ("torch._utils", "_rebuild_tensor"): Function(_rebuild_tensor),
    ("torch._utils", "_rebuild_tensor_v2"): Function(_rebuild_tensor),
    ("torch._utils", "_rebuild_parameter"): Function(_rebuild_parameter),
    ("torch", "Size"): Function(_size),
    ("collections", "OrderedDict"): Function(_ordered_dict),
    **{("torch", name): StorageType(name) for name in _STORAGE_DTYPES},
    # Whose order ProtoMotions' motions have, as a member of an enumeration.
    ("protomotions.simulator.base_simulator.simulator_state", "StateConversion"): Function(_member),
    # How far CARI4D's optimization has come, stored beside its result.
    ("learning.training.training_utils", "TrainState"): Class(lambda: Unread("TrainState")),
}
"""What torch's files may name."""
