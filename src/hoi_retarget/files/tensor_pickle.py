"""Reads plain pickles that hold torch's tensors beside numpy's arrays, without torch and without executing them.

`pickle.dump` writes a tensor as a view of a storage, and the storage as a call of `torch.storage._load_from_bytes` with
a whole file of torch's format before 1.6 that holds nothing but this storage. That call is not made: the bytes are
interpreted as the pickle around them is.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.files.array_pickle import ARRAYS, StandIn, plain
from hoi_retarget.files.pickle_machine import (
    TORCH,
    Dialect,
    Function,
    Machine,
    RefusedError,
    StorageType,
    damaged,
    interpret,
)

_PICKLE = b"\x80"
_REFERENCE = b"Q"
_REBUILDS = (("torch._utils", "_rebuild_tensor"), ("torch._utils", "_rebuild_tensor_v2"))


def parse_tensors(content: bytes, path: Path) -> Any:
    """Return what a pickle of plain values, arrays and tensors holds, all of these as arrays.

    Raises:
        ReadError: it is damaged, or holds anything else, such as something that would be executed.
    """
    if not content.startswith(_PICKLE):
        raise ReadError(f"{path}: it starts with {content[:4]!r}, expected a pickle. Download it again.")
    storages: dict[str, np.ndarray] = {}
    try:
        value, _ = interpret(content, lambda _kind, key, _count: storages.get(key), dialect=_dialect(storages))
        return plain(value, {})
    except RefusedError as error:
        raise ReadError(f"{path}: {error.what}. Download it again.") from error


def _dialect(storages: dict[str, np.ndarray]) -> Dialect:
    def load(machine: Machine, arguments: tuple) -> Any:
        if len(arguments) != 1 or not isinstance(arguments[0], bytes):
            raise damaged("a tensor's storage is made from something that is no bytes")
        kind, elements = _storage_in(arguments[0])
        key = str(len(storages))
        storages[key] = elements
        machine.stack.append(("storage", kind, key, "cpu", len(elements)))
        TORCH.operations[_REFERENCE](machine)
        return machine.pop()

    names = {
        **ARRAYS.names,
        ("collections", "OrderedDict"): TORCH.names["collections", "OrderedDict"],
        ("torch", "Size"): TORCH.names["torch", "Size"],
        ("torch.storage", "_load_from_bytes"): Function("storage", load),
        **{name: Function("tensor", _rebuild(TORCH.names[name].call)) for name in _REBUILDS},
    }
    return Dialect(names, ARRAYS.operations)


def _rebuild(call: Callable[[Machine, tuple], np.ndarray]) -> Callable[[Machine, tuple], StandIn]:
    return lambda machine, arguments: StandIn(call(machine, arguments))


def _storage_in(content: bytes) -> tuple[StorageType, np.ndarray]:
    """Return the kind and the elements of the only storage in a file of torch's format before 1.6.

    Pickles of a magic number, the protocol, facts of the writing machine, the storage and its name; then the number of
    its elements and their bytes.
    """
    seen: list[tuple[StorageType, str, int]] = []

    def note(kind: StorageType, key: str, count: int) -> None:
        seen.append((kind, key, count))

    def refer(machine: Machine) -> None:
        TORCH.operations[_REFERENCE](machine)
        machine.pop()
        machine.stack.append(None)

    position = 0
    for _ in range(2):
        _, position = interpret(content, note, position)
    facts, position = interpret(content, note, position)
    _, position = interpret(content, note, position, Dialect(TORCH.names, {**TORCH.operations, _REFERENCE: refer}))
    keys, position = interpret(content, note, position)
    if len(seen) != 1 or keys != [seen[0][1]] or not isinstance(facts, dict):
        raise damaged("the file inside, of a tensor's storage, holds something else")
    kind, key, count = seen[0]
    little = bool(facts.get("little_endian", True))
    start, end = position + 8, position + 8 + count * kind.item_size
    stated = int.from_bytes(content[position:start], "little" if little else "big")
    if stated != count or end > len(content):
        raise damaged(
            f"storage {key[:80]!r} should hold {count} elements of {kind.item_size} bytes, but states {stated} and "
            f"{max(0, len(content) - start)} bytes follow"
        )
    return kind, kind.decode(content[start:end], "<" if little else ">")
