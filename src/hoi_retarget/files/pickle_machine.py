"""Interprets pickles: builds tensors, arrays, numbers, strings and containers, calls nothing.

A pickle is a small program. It is interpreted here by hand instead of by `pickle.Unpickler`, for three
reasons: only the few operations that build plain values exist, so nothing can be called; Python's own
machine sizes its memo by a number in the file, which lets a few bytes claim 64 GB; and it hashes any key,
where a deep enough tuple ends the process.

What a pickle may name and which operations it may use is a dialect: that of torch's files is here, that of
numpy's arrays in `array_pickle`.
"""

import math
import pickletools
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

MAXIMUM_DEPTH = 64
"""Containers inside containers; deeper files are refused."""
MAXIMUM_DIMENSIONS = 32
MAXIMUM_EXPANSION = 1 << 20
"""Elements that a tensor may show beyond those stored, by strides of zero."""

RESAVE = "Save it again with torch.save(tensor, path), or download it again."

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


class RefusedError(Exception):
    """What is wrong with the content, and what to do about it; becomes a `ReadError` that names the file."""

    def __init__(self, what: str, advice: str = RESAVE) -> None:
        super().__init__(f"{what}. {advice}")
        self.what = what


def damaged(what: str) -> RefusedError:
    """Return the error for content that contradicts itself, with what to do about it."""
    return RefusedError(what)


class Internal:
    """Base of what a pickle names or builds on the way to a value, without being one."""


@dataclass(frozen=True)
class StorageType(Internal):
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


# Gives the elements of the storage of that type, key and number of elements.
StorageSource = Callable[[StorageType, str, int], np.ndarray | None]


# What a pickle may name


@dataclass(frozen=True)
class Function(Internal):
    """Stands for a function that a pickle may name; `call` is ours."""

    name: str
    call: Callable[["Machine", tuple], Any]


@dataclass(frozen=True)
class Unread:
    """Stands for an object that some torch files hold beside their tensors; nothing of it is kept."""

    name: str
    """What its class is called."""


@dataclass(frozen=True)
class _UnreadClass(Internal):
    """A class whose objects become `Unread`; it is neither imported nor called."""

    name: str


@dataclass(frozen=True, eq=False)
class _Storage(Internal):
    """A storage that a tensor views; the elements are None while the file is read for its keys only."""

    kind: StorageType
    count: int
    elements: np.ndarray | None


def _is_count(value: Any) -> bool:
    return type(value) is int and 0 <= value < 1 << 48


def _rebuild_tensor(machine: "Machine", arguments: tuple) -> Any:
    """Return a view of a storage: `(storage, offset, size, stride, ...)`, counted in elements."""
    if len(arguments) < 4 or not isinstance(arguments[0], _Storage):
        raise damaged("a tensor is described by other values than storage, offset, size and stride")
    storage, offset, size, stride = arguments[:4]
    if not (
        _is_count(offset)
        and all(isinstance(values, tuple) and all(map(_is_count, values)) for values in (size, stride))
        and len(size) == len(stride) <= MAXIMUM_DIMENSIONS
    ):
        raise damaged("a tensor's offset, size or stride is not a number that a tensor can have")
    count = math.prod(size)
    # A tensor without elements may still claim 0 x a huge number of rows, which numpy cannot describe.
    if math.prod(max(1, length) for length in size) > max(MAXIMUM_EXPANSION, storage.count):
        raise damaged(f"a tensor claims {count} elements of a storage that has {storage.count}")
    last = offset + sum((length - 1) * step for length, step in zip(size, stride, strict=True))
    if count and last >= storage.count:
        raise damaged(f"a tensor reaches element {last} of a storage that has {storage.count}")
    if storage.elements is None:
        return None
    if count > storage.count:
        machine.spend_expansion(count - storage.count)
    if not count:
        return np.zeros(size, dtype=storage.elements.dtype)
    steps = [step if length > 1 else 0 for length, step in zip(size, stride, strict=True)]
    item_size = storage.elements.itemsize
    return np.lib.stride_tricks.as_strided(
        storage.elements[offset:], size, [step * item_size for step in steps], writeable=False
    )


def _rebuild_parameter(_machine: "Machine", arguments: tuple) -> Any:
    if not arguments or not isinstance(arguments[0], np.ndarray | None):
        raise damaged("a parameter is described by something that is not a tensor")
    return arguments[0]


def _ordered_dict(_machine: "Machine", arguments: tuple) -> dict:
    if arguments:
        raise damaged("an OrderedDict is built from arguments, expected an empty one that is then filled")
    return {}


def _size(_machine: "Machine", arguments: tuple) -> tuple:
    if len(arguments) != 1 or not isinstance(arguments[0], tuple) or not all(map(_is_count, arguments[0])):
        raise damaged("a torch.Size is built from something that is not a tuple of numbers")
    return arguments[0]


_GLOBALS: dict[tuple[str, str], Internal] = {
    ("torch._utils", "_rebuild_tensor"): Function("tensor", _rebuild_tensor),
    ("torch._utils", "_rebuild_tensor_v2"): Function("tensor", _rebuild_tensor),
    ("torch._utils", "_rebuild_parameter"): Function("parameter", _rebuild_parameter),
    ("torch", "Size"): Function("size", _size),
    ("collections", "OrderedDict"): Function("OrderedDict", _ordered_dict),
    **{("torch", name): StorageType(name) for name in _STORAGE_DTYPES},
    # How far CARI4D's optimization has come, stored beside its result.
    ("learning.training.training_utils", "TrainState"): _UnreadClass("TrainState"),
}


def _find_global(machine: "Machine", module: Any, name: Any) -> Any:
    """Return our stand-in for a name that a pickle wants to import, or refuse it."""
    names = machine.dialect.names
    found = names.get((module, name)) if isinstance(module, str) and isinstance(name, str) else None
    if found is None:
        wanted = ascii(f"{module}.{name}" if isinstance(module, str) and isinstance(name, str) else "something")[1:-1]
        raise RefusedError(
            f"refused: the file wants to import {wanted[:120]}, which could run code; expected tensors, numbers, "
            "strings, dictionaries and lists only",
            "If you trust its origin, load it with torch where it was made and save plain tensors.",
        )
    return found


# The interpreter


@dataclass(frozen=True)
class Dialect:
    """What a pickle may name, and the operations it may use, by their codes."""

    names: Mapping[tuple[str, str], Any]
    operations: Mapping[bytes, Callable[["Machine"], Any]]


@dataclass(frozen=True, eq=False)
class _Enclosed:
    """A container that is complete because it is inside another; keeping it keeps its id its own."""

    value: Any
    depth: int
    internal: bool
    """Whether it holds a name or a storage, which are no values."""


@dataclass
class Machine:
    """The state of one pickle's interpretation: a stack machine of plain values."""

    content: bytes
    storage: StorageSource
    dialect: Dialect
    position: int = 0
    stack: list = field(default_factory=list)
    marks: list[int] = field(default_factory=list)
    memo: dict[int, Any] = field(default_factory=dict)
    enclosed: dict[int, "_Enclosed"] = field(default_factory=dict)
    """By id, the containers that are inside another."""
    expansion_left: int = MAXIMUM_EXPANSION

    def take(self, count: int) -> bytes:
        """Return the next bytes."""
        end = self.position + count
        if end > len(self.content):
            raise damaged("the pickle is cut off")
        taken = self.content[self.position : end]
        self.position = end
        return taken

    def take_number(self, count: int) -> int:
        """Return the next bytes as a number."""
        return int.from_bytes(self.take(count), "little")

    def take_line(self) -> str:
        """Return the text up to the end of the line."""
        end = self.content.find(b"\n", self.position)
        if end < 0:
            raise damaged("the pickle is cut off")
        return self.take(end + 1 - self.position)[:-1].decode("utf-8", "backslashreplace")

    def pop(self) -> Any:
        """Take the last value off the stack."""
        # Values below the last mark belong to another container.
        if len(self.stack) <= (self.marks[-1] if self.marks else 0):
            raise damaged("the pickle takes a value that is not there")
        return self.stack.pop()

    def pop_to_mark(self) -> list:
        """Take off all values above the last mark."""
        if not self.marks:
            raise damaged("the pickle closes a list that was not opened")
        mark = self.marks.pop()
        values = self.stack[mark:]
        del self.stack[mark:]
        return values

    def top(self, kind: type) -> Any:
        """Return the last value, a container that still is filled."""
        value = self.pop()
        # A container that already is inside another is complete; one that still grows contains itself.
        if type(value) is not kind or id(value) in self.enclosed:
            raise damaged("the pickle fills a value that is not an open container: a damaged or endless structure")
        self.stack.append(value)
        return value

    def enclose(self, value: Any) -> bool:
        """Note that a value goes into a container, which completes it; return whether it is a value at all."""
        if isinstance(value, Internal):
            return False
        if type(value) not in (list, dict, tuple):
            return True
        if id(value) not in self.enclosed:
            items = value.values() if isinstance(value, dict) else value
            inside = [self.enclosed[id(item)] for item in items if id(item) in self.enclosed]
            depth = 1 + max((item.depth for item in inside), default=0)
            if depth > MAXIMUM_DEPTH:
                raise damaged(f"containers are nested more than {MAXIMUM_DEPTH} deep")
            internal = any(item.internal for item in inside) or any(isinstance(item, Internal) for item in items)
            self.enclosed[id(value)] = _Enclosed(value, depth, internal)
        return not self.enclosed[id(value)].internal

    def enclose_value(self, value: Any, target: list | dict) -> None:
        """Note that a value goes into a list or a dictionary, which hold nothing but values."""
        if value is target:
            raise damaged("a container contains itself")
        if not self.enclose(value):
            raise damaged("a container holds the name of a function or a storage, expected values")

    def spend_expansion(self, count: int) -> None:
        """Count elements that are shown beyond those stored."""
        self.expansion_left -= count
        if self.expansion_left < 0:
            raise damaged(f"tensors show more than {MAXIMUM_EXPANSION} elements beyond those stored")

    def remember(self, index: int) -> None:
        """Keep the last value under a number."""
        value = self.pop()
        self.memo[index] = value
        self.stack.append(value)

    def recall(self, index: int) -> None:
        """Put the value that was kept under a number on the stack."""
        if index not in self.memo:
            raise damaged("the pickle refers to a value that it has not built")
        self.stack.append(self.memo[index])


def interpret(
    content: bytes, storage: StorageSource, position: int = 0, dialect: Dialect | None = None
) -> tuple[Any, int]:
    """Return the value of the pickle at `position` and where it ends; by default in torch's dialect."""
    machine = Machine(content, storage, dialect or TORCH, position)
    while True:
        code = machine.take(1)
        if code == b".":
            value = machine.pop()
            if not machine.enclose(value):
                raise damaged("the file holds no value but the name of one")
            return value, machine.position
        operation = machine.dialect.operations.get(code)
        if operation is None:
            names = [known.name for known in pickletools.opcodes if known.code.encode("latin-1") == code]
            name = f"operation {names[0]}" if names else f"byte {code!r}, which is no operation"
            raise damaged(f"the pickle uses {name}; expected those of tensors, numbers, strings and containers")
        operation(machine)


def _tuple_of(count: int) -> Callable[[Machine], None]:
    def operation(machine: Machine) -> None:
        _push_tuple(machine, [machine.pop() for _ in range(count)][::-1])

    return operation


def _push_tuple(machine: Machine, values: list) -> None:
    for value in values:
        machine.enclose(value)
    machine.stack.append(tuple(values))


def _append(machine: Machine, values: list) -> None:
    target = machine.top(list)
    for value in values:
        machine.enclose_value(value, target)
        target.append(value)


def _set_items(machine: Machine, values: list) -> None:
    target = machine.top(dict)
    if len(values) % 2:
        raise damaged("a dictionary's key has no value")
    for key, value in zip(values[::2], values[1::2], strict=True):
        if type(key) not in (str, int, float, bool, type(None)):
            raise damaged(f"a dictionary's key is a {type(key).__name__}, expected a string or a number")
        machine.enclose_value(value, target)
        target[key] = value


def _append_one(machine: Machine) -> None:
    _append(machine, [machine.pop()])


def _set_item(machine: Machine) -> None:
    value, key = machine.pop(), machine.pop()
    _set_items(machine, [key, value])


def _reduce(machine: Machine) -> None:
    arguments, function = machine.pop(), machine.pop()
    if not isinstance(function, Function) or type(arguments) is not tuple:
        raise damaged("the pickle calls something that is not a function")
    machine.stack.append(function.call(machine, arguments))


def _new_object(machine: Machine) -> None:
    arguments, kind = machine.pop(), machine.pop()
    if not isinstance(kind, _UnreadClass) or arguments != ():
        raise damaged("refused: it builds an object of a class, expected tensors and plain values")
    machine.stack.append(Unread(kind.name))


def _build(machine: Machine) -> None:
    # torch gives an OrderedDict attributes (`_metadata` of a state_dict): not values, so left out.
    machine.pop()
    if not isinstance(machine.stack[-1] if machine.stack else None, Unread):
        machine.top(dict)


def _persistent_id(machine: Machine) -> None:
    """Replace `("storage", type, key, location, count[, view])` by the storage."""
    wanted = machine.pop()
    if not (
        isinstance(wanted, tuple)
        and len(wanted) in (5, 6)
        and wanted[0] == "storage"
        and isinstance(wanted[1], StorageType)
        and isinstance(wanted[2], str)
        and _is_count(wanted[4])
        and (len(wanted) == 5 or wanted[5] is None)
    ):
        raise damaged("a reference outside the pickle is not a tensor's storage")
    _, kind, key, _, count = wanted[:5]
    machine.stack.append(_Storage(kind, count, machine.storage(kind, key, count)))


def _push_text(width: int) -> Callable[[Machine], None]:
    def operation(machine: Machine) -> None:
        raw = machine.take(machine.take_number(width))
        try:
            machine.stack.append(raw.decode("utf-8"))
        except UnicodeDecodeError as error:
            raise damaged("a string is not UTF-8 text") from error

    return operation


def _push_long(machine: Machine) -> None:
    size = machine.take_number(1)
    if size > 16:
        raise damaged(f"an integer has {size} bytes, expected at most 16")
    machine.stack.append(int.from_bytes(machine.take(size), "little", signed=True))


def _push_global_line(machine: Machine) -> None:
    machine.stack.append(_find_global(machine, machine.take_line(), machine.take_line()))


def _refuse_instance(machine: Machine) -> None:
    module, name = machine.take_line(), machine.take_line()
    _find_global(machine, module, name)
    raise damaged(f"the pickle builds an instance of {name}, expected a call")


def _push_global_stack(machine: Machine) -> None:
    name, module = machine.pop(), machine.pop()
    machine.stack.append(_find_global(machine, module, name))


_OPERATIONS: dict[bytes, Callable[[Machine], Any]] = {
    b"\x80": lambda machine: machine.take(1),  # protocol
    b"\x95": lambda machine: machine.take(8),  # frame: a hint for streams
    b"(": lambda machine: machine.marks.append(len(machine.stack)),
    b"0": lambda machine: machine.pop(),
    b"N": lambda machine: machine.stack.append(None),
    b"\x88": lambda machine: machine.stack.append(True),
    b"\x89": lambda machine: machine.stack.append(False),
    b"K": lambda machine: machine.stack.append(machine.take_number(1)),
    b"M": lambda machine: machine.stack.append(machine.take_number(2)),
    b"J": lambda machine: machine.stack.append(int.from_bytes(machine.take(4), "little", signed=True)),
    b"\x8a": _push_long,
    b"G": lambda machine: machine.stack.append(struct.unpack(">d", machine.take(8))[0]),
    b"U": _push_text(1),
    b"T": _push_text(4),
    b"\x8c": _push_text(1),
    b"X": _push_text(4),
    b"\x8d": _push_text(8),
    b")": lambda machine: machine.stack.append(()),
    b"\x85": _tuple_of(1),
    b"\x86": _tuple_of(2),
    b"\x87": _tuple_of(3),
    b"t": lambda machine: _push_tuple(machine, machine.pop_to_mark()),
    b"]": lambda machine: machine.stack.append([]),
    b"a": _append_one,
    b"e": lambda machine: _append(machine, machine.pop_to_mark()),
    b"}": lambda machine: machine.stack.append({}),
    b"s": _set_item,
    b"u": lambda machine: _set_items(machine, machine.pop_to_mark()),
    b"q": lambda machine: machine.remember(machine.take_number(1)),
    b"r": lambda machine: machine.remember(machine.take_number(4)),
    b"\x94": lambda machine: machine.remember(len(machine.memo)),
    b"h": lambda machine: machine.recall(machine.take_number(1)),
    b"j": lambda machine: machine.recall(machine.take_number(4)),
    b"c": _push_global_line,
    b"i": _refuse_instance,
    b"\x93": _push_global_stack,
    b"R": _reduce,
    b"\x81": _new_object,
    b"b": _build,
    b"Q": _persistent_id,
}

TORCH = Dialect(_GLOBALS, _OPERATIONS)
