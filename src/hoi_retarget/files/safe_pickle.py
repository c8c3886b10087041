"""Pickles read without executing them: the standard library's unpickler with a closed table of names.

A pickle is a small program, and `pickle._Unpickler` interprets it. Everything that it may name is a stub from a table;
the operations that call, build or fill something are replaced by ones that accept these alone. The unpickler in C would
not do: it sizes its memo by a number in the file, so that a few bytes can claim 64 GB.
"""

import mmap
import pickle
import pickletools
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from hoi_retarget.errors import ReadError

MAX_DEPTH = 64  # Containers inside containers; deeper files are refused.
MAX_SURPLUS = 1 << 20
"""Elements that arrays may show beyond the stored ones, by strides of zero or by using bytes again."""
_MAX_INTEGER_BYTES = 16
_MAX_KEY_BITS = 63  # Longer numbers can be found that are alike to a dictionary, which takes forever.


class RefusedError(Exception):
    """A fault of a pickle or of the file around it; `refusals` makes it a `ReadError`."""


@contextmanager
def refusals(path: Path, advice: str) -> Iterator[None]:
    """Raise `ReadError` with the file's name and advice in the place of `RefusedError`."""
    try:
        yield
    except RefusedError as error:
        raise ReadError(f"{path}: {error}. {advice}") from error


class Stub:
    """Stands for something that a pickle names or builds; it holds data and does nothing."""

    def build(self, _unpickler: "Unpickler", _state: Any) -> None:
        """Take the attributes that a pickle gives to an object; raises `RefusedError`."""
        raise _not_open()

    def value(self) -> Any:
        """Return the array, or the list of objects, that it stands for; raises `RefusedError`."""
        raise RefusedError("it holds no value but the name of a function, a class or a storage")


@dataclass(frozen=True, eq=False)
class Function(Stub):
    """A function that a pickle may call."""

    call: Callable[..., Any]  # Ours, with the unpickler and the arguments.
    accepts: tuple[Any, ...]  # Type or value of each argument; behind `...` at the end there may be more arguments.
    refusal: str  # The fault of other arguments.

    def called(self, unpickler: "Unpickler", arguments: tuple) -> Any:
        """Return the value of a call; raises `RefusedError` for arguments that it does not accept."""
        expected = tuple(kind for kind in self.accepts if kind is not ...)
        fits = len(arguments) == len(expected) or (... in self.accepts and len(arguments) > len(expected))
        pairs = zip(arguments, expected, strict=False)
        if not fits or not all(isinstance(a, kind) if isinstance(kind, type) else a == kind for a, kind in pairs):
            raise RefusedError(self.refusal)
        return self.call(unpickler, *arguments)


@dataclass(frozen=True, eq=False)
class Class(Stub):
    """A class that a pickle may name and, unless `new` is None, build objects of."""

    new: Callable[[], Any] | None = None


Names = Mapping[tuple[str, str], Stub]  # Module and name of everything that a pickle may name.


def _not_open() -> RefusedError:
    return RefusedError("the pickle fills a value that is not an open container")


class _Source:
    """The bytes of pickles as the file that the standard library reads; it never returns fewer than requested."""

    def __init__(self, content: bytes | mmap.mmap) -> None:
        self.content = content
        self.position = 0

    def read(self, count: int) -> bytes:
        return self.content[self._next(count)]

    def readline(self) -> bytes:
        end = self.content.find(b"\n", self.position)
        return self.read((end if end >= 0 else len(self.content)) + 1 - self.position)

    def view(self, count: int) -> bytes | memoryview:
        """Return the next bytes, without reading those of a mapped file."""
        if isinstance(self.content, bytes):
            return self.read(count)
        return memoryview(self.content)[self._next(count)]

    def _next(self, count: int) -> slice:
        start, self.position = self.position, self.position + count
        if self.position > len(self.content):
            raise RefusedError("the pickle is cut off")
        return slice(start, self.position)


class _Memo(dict[int, Any]):
    def __missing__(self, index: int) -> Any:
        raise RefusedError("the pickle refers to a value that it has not built")


class _Operations(dict[int, Callable[[Any], None]]):
    def __missing__(self, code: int) -> Callable[[Any], None]:
        names = [known.name for known in pickletools.opcodes if ord(known.code) == code]
        name = f"operation {names[0]}" if names else f"byte {bytes([code])!r}, which is no operation"
        raise RefusedError(f"the pickle uses {name}; expected those of arrays, numbers, strings and containers")


# Operations of the standard library that only read, name, or make plain values of what was read.
_STANDARD = (
    *(pickle.PROTO, pickle.MARK, pickle.STOP, pickle.NONE, pickle.NEWTRUE, pickle.NEWFALSE),
    *(pickle.BININT, pickle.BININT1, pickle.BININT2, pickle.LONG1, pickle.BINFLOAT),
    *(pickle.BINSTRING, pickle.SHORT_BINSTRING, pickle.BINUNICODE, pickle.SHORT_BINUNICODE, pickle.BINUNICODE8),
    *(pickle.BINBYTES, pickle.SHORT_BINBYTES, pickle.BINBYTES8),
    *(pickle.EMPTY_LIST, pickle.EMPTY_DICT, pickle.EMPTY_TUPLE),
    *(pickle.TUPLE, pickle.TUPLE1, pickle.TUPLE2, pickle.TUPLE3),
    *(pickle.BINPUT, pickle.LONG_BINPUT, pickle.MEMOIZE, pickle.BINGET, pickle.LONG_BINGET),
    *(pickle.GLOBAL, pickle.STACK_GLOBAL, pickle.BINPERSID),
)


class Unpickler(pickle._Unpickler):
    """Reads consecutive pickles.

    Args:
        content: Bytes of the pickles, and of anything behind them.
        names: Everything that they may name.
        refer: Returns the stub for a reference to something outside of the pickle; None refuses such references.
        encoding: Of the strings of Python 2.
    """

    stack: list[Any]
    metastack: list[list[Any]]

    def __init__(
        self,
        content: bytes | mmap.mmap,
        names: Names,
        *,
        refer: Callable[[Any], Stub] | None = None,
        encoding: str = "utf-8",
    ) -> None:
        self.source = _Source(content)
        super().__init__(self.source, encoding=encoding)
        self._names, self._refer = names, refer
        self._surplus = MAX_SURPLUS + 2 * len(content)  # Bytes may be written as text, and then used in an array.

    def next(self) -> Any:
        """Return the value of the next pickle, with stubs in it; raises `RefusedError`."""
        self.memo = _Memo()
        try:
            return self.load()
        except IndexError as error:
            raise RefusedError("the pickle takes a value that is not there") from error
        except UnicodeEncodeError as error:
            raise RefusedError("bytes are written as text that is not latin1") from error
        except UnicodeDecodeError as error:
            raise RefusedError("a string, or a name that the pickle wants to import, is not UTF-8 text") from error
        except (pickle.UnpicklingError, ValueError) as error:
            raise RefusedError(f"the pickle is damaged ({error})") from error

    def spend(self, count: int) -> None:
        """Count elements that may have been shown before; raises `RefusedError` for too many."""
        self._surplus -= count
        if self._surplus < 0:
            raise RefusedError("arrays show too many elements beyond those stored")

    # Methods that the standard library calls

    def find_class(self, module: str, name: str) -> Stub:
        """Return the stub of an imported name; raises `RefusedError`."""
        if (module, name) not in self._names:
            raise RefusedError(
                f"refused: the file wants to import {ascii(f'{module}.{name}')[1:-1][:120]}, which could run code; "
                "expected arrays, numbers, strings, dictionaries and lists only"
            )
        return self._names[module, name]

    def persistent_load(self, pid: Any) -> Stub:
        """Return the stub for something outside of the pickle; raises `RefusedError`."""
        if self._refer is None:
            raise RefusedError("it refers to a storage of torch, which a plain pickle has not")
        return self._refer(pid)

    def pop_mark(self) -> list[Any]:
        """Return the values of the container that is closed; raises `RefusedError`."""
        if not self.metastack:
            raise RefusedError("the pickle closes a list that was not opened")
        return super().pop_mark()  # pyright: ignore[reportAttributeAccessIssue]  # not in the stubs

    # Operations

    def _skip_frame(self) -> None:
        self.source.read(8)  # Only a hint for streams.

    def _pop(self) -> None:
        self.stack.pop()  # The standard library would also take what belongs to another container.

    def _append(self) -> None:
        value = self.stack.pop()
        self._open(list).append(value)

    def _extend(self) -> None:
        values = self.pop_mark()
        self._open(list).extend(values)

    def _set_item(self) -> None:
        value, key = self.stack.pop(), self.stack.pop()
        self._set([key, value])

    def _set_items(self) -> None:
        self._set(self.pop_mark())

    def _set(self, values: list[Any]) -> None:
        """Fill the dictionary on the stack with keys and values in turn."""
        target = self._open(dict)
        if len(values) % 2:
            raise RefusedError("a dictionary's key has no value")
        for key, value in zip(values[::2], values[1::2], strict=True):
            if type(key) not in (str, int, float, bool, type(None)):
                raise RefusedError(f"a dictionary's key is a {type(key).__name__}, expected a string or a number")
            if type(key) is int and key.bit_length() > _MAX_KEY_BITS:
                raise RefusedError(f"a dictionary's key is a number of more than {_MAX_KEY_BITS} bits")
            target[key] = value

    def _open(self, kind: type) -> Any:
        if type(self.stack[-1]) is not kind:
            raise _not_open()
        return self.stack[-1]

    def _call(self) -> None:
        arguments, function = self.stack.pop(), self.stack.pop()
        if not isinstance(function, Function) or type(arguments) is not tuple:
            raise RefusedError("the pickle calls something that is not a function")
        self.stack.append(function.called(self, arguments))

    def _make(self) -> None:
        arguments, kind = self.stack.pop(), self.stack.pop()
        if not isinstance(kind, Class) or kind.new is None or arguments != ():
            raise RefusedError("refused: it builds an object of a class, expected arrays and plain values")
        self.stack.append(kind.new())

    def _build(self) -> None:
        state, target = self.stack.pop(), self.stack[-1]
        if isinstance(target, Stub):
            target.build(self, state)
        elif type(target) is not dict:  # The attributes of an OrderedDict, such as a state_dict's, are left out.
            raise _not_open()

    def _refuse_instance(self) -> None:
        module, name = (self.source.readline()[:-1].decode() for _ in range(2))
        self.find_class(module, name)
        raise RefusedError(f"the pickle builds an instance of {name}, expected a call")

    dispatch: ClassVar = _Operations(
        {code[0]: pickle._Unpickler.dispatch[code[0]] for code in _STANDARD}
        | {
            pickle.FRAME[0]: _skip_frame,
            pickle.BYTEARRAY8[0]: pickle._Unpickler.dispatch[pickle.BINBYTES8[0]],
            pickle.POP[0]: _pop,
            pickle.APPEND[0]: _append,
            pickle.APPENDS[0]: _extend,
            pickle.SETITEM[0]: _set_item,
            pickle.SETITEMS[0]: _set_items,
            pickle.REDUCE[0]: _call,
            pickle.NEWOBJ[0]: _make,
            pickle.BUILD[0]: _build,
            pickle.INST[0]: _refuse_instance,
        }
    )


def plain(value: Any, *, objects: bool = False) -> Any:
    """Return an unpickled value with arrays in the place of their stubs; shared containers stay shared.

    Arrays of objects become lists where `objects` allows them. Raises `RefusedError` for anything but arrays, numbers,
    text, bytes, None and containers of these, and for containers that are nested too deep, or in themselves.
    """
    return _plain(value, 0, {}, objects)[0]


def _plain(value: Any, level: int, known: dict[int, tuple[Any, int]], objects: bool) -> tuple[Any, int]:
    """Return a value that is inside of `level` containers, and the depth of the containers in it.

    `known` has the result for each container by its id.
    """
    if isinstance(value, Stub):
        value = value.value()
        if isinstance(value, list) and not objects:
            raise RefusedError("refused: an array holds Python objects, expected numbers")
    if type(value) not in (list, tuple, dict):
        _check(value)
        return value, 0
    _, depth = known.get(id(value), (None, 0))
    if level + max(1, depth) > MAX_DEPTH:
        raise RefusedError(
            f"containers are nested more than {MAX_DEPTH} deep, or one contains itself: a damaged or endless structure"
        )
    if not depth:
        known[id(value)] = None, MAX_DEPTH  # Met again inside itself, it is too deep.
        content = value.values() if isinstance(value, dict) else value
        items = [_plain(item, level + 1, known, objects) for item in content]
        copied: Any = [item for item, _ in items]
        if isinstance(value, tuple):
            copied = tuple(copied)
        elif isinstance(value, dict):
            for key in value:
                _check(key)
            copied = dict(zip(value, copied, strict=True))
        known[id(value)] = copied, 1 + max((inner for _, inner in items), default=0)
    return known[id(value)]


def _check(value: Any) -> None:
    """Raise `RefusedError` unless a value other than a container is plain."""
    if type(value) is int:
        size = value.bit_length() // 8 + 1
        if size > _MAX_INTEGER_BYTES:
            raise RefusedError(f"an integer has {size} bytes, expected at most {_MAX_INTEGER_BYTES}")
    elif type(value) is str:
        try:
            value.encode()
        except UnicodeEncodeError as error:
            raise RefusedError("a string is not UTF-8 text") from error
    elif type(value) not in (float, bool, bytes, type(None), np.ndarray):
        Stub().value()
