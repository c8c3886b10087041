"""Reads the pickles in which body models are given away, without executing what they hold.

They are written by Python 2, with chumpy's arrays and scipy's sparse matrices among numpy's. The dialect of
`array_pickle` is widened by stand-ins that keep the numbers of these and do nothing.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

from hoi_retarget.errors import ReadError
from hoi_retarget.readers.array_pickle import ARRAYS, parse_raw, plain
from hoi_retarget.readers.pickle_machine import Dialect, Function, Machine, RefusedError, damaged

_ADVICE = "Download the model again from its makers."


@dataclass(frozen=True)
class _Class:
    """A class of chumpy or scipy that a pickle names."""

    name: str


@dataclass(eq=False)
class _Instance:
    """An object of such a class: its attributes, and nothing that they do."""

    kind: _Class
    attributes: dict = field(default_factory=dict)


_CHUMPY, _SPARSE = _Class("chumpy array"), _Class("sparse matrix")


def read_body_pickle(path: Path, content: bytes, names: Iterable[str]) -> dict[str, np.ndarray | None]:
    """Return the arrays of the given names, and None for all else that the pickle's dictionary holds.

    Raises:
        ReadError: the content is damaged, names anything that could run, or is no dictionary.
    """
    try:
        values = parse_raw(content, _BODIES)
        if not isinstance(values, dict):
            raise damaged("it holds no dictionary, as every body model does")
        wanted = set(names)
        return {str(name): _array(value) if name in wanted else None for name, value in values.items()}
    except RefusedError as error:
        raise ReadError(f"{path}: {error.what}. {_ADVICE}") from error


def _array(value: Any) -> np.ndarray | None:
    if isinstance(value, _Instance):
        return _dense(value.attributes) if value.kind is _SPARSE else _array(value.attributes.get("x"))
    array = plain(value, {})
    return array if isinstance(array, np.ndarray) else None


def _dense(attributes: dict) -> np.ndarray:
    """Return a matrix stored by columns: entries, their rows, and where each column begins."""
    entries, rows, starts = (plain(attributes.get(name), {}) for name in ("data", "indices", "indptr"))
    shape = attributes.get("_shape", attributes.get("shape"))
    if not (
        isinstance(shape, tuple) and len(shape) == 2 and all(type(size) is int and 0 < size < 1 << 20 for size in shape)
    ):
        raise damaged("a sparse matrix has no shape")
    try:
        matrix = csc_matrix((entries, rows, starts), shape=shape)
        matrix.check_format(full_check=True)
    except (ValueError, TypeError, IndexError) as error:
        raise damaged(f"a sparse matrix contradicts itself ({error})") from error
    return matrix.toarray()


def _new_object(machine: Machine) -> None:
    if len(machine.stack) > 1 and isinstance(machine.stack[-2], _Class):
        machine.pop()
        machine.stack.append(_Instance(machine.pop()))
    else:
        ARRAYS.operations[b"\x81"](machine)


def _reconstructor(_machine: Machine, arguments: tuple) -> _Instance:
    """Return an object that Python 2 builds by a call."""
    if not arguments or not isinstance(arguments[0], _Class):
        raise damaged("refused: it builds an object of a class, expected arrays")
    return _Instance(arguments[0])


def _nothing(_machine: Machine, _arguments: tuple) -> None:
    """Stand for a set, which no array is in."""


def _build(machine: Machine) -> None:
    target, state = machine.stack[-2] if len(machine.stack) > 1 else None, machine.stack[-1] if machine.stack else None
    if isinstance(target, _Instance):
        if not isinstance(state, dict):
            raise damaged(f"a {target.kind.name} has no attributes")
        machine.pop()
        target.attributes.update(state)
        return
    if isinstance(state, tuple) and len(state) == 5:
        if isinstance(state[4], str):  # Python 2 writes bytes as text.
            machine.stack[-1] = (*state[:4], state[4].encode("latin-1"))
        elif isinstance(state[4], list):  # Objects, such as the joints' names: left out.
            machine.pop()
            machine.stack[-1] = None
            return
    ARRAYS.operations[b"b"](machine)


def _push_latin(width: int) -> Any:
    return lambda machine: machine.stack.append(machine.take(machine.take_number(width)).decode("latin-1"))


_BODIES = Dialect(
    {
        **ARRAYS.names,
        **{
            (f"chumpy.{module}", name): _CHUMPY
            for module, name in (("ch", "Ch"), ("ch", "MatVecMult"), ("reordering", "Select"))
        },
        **{(f"scipy.sparse.{module}", "csc_matrix"): _SPARSE for module in ("csc", "_csc")},
        **{(module, "set"): Function("set", _nothing) for module in ("__builtin__", "builtins")},
        **{(module, "_reconstructor"): Function("object", _reconstructor) for module in ("copy_reg", "copyreg")},
        **{(module, "object"): _Class("object") for module in ("__builtin__", "builtins")},
    },
    {
        **ARRAYS.operations,
        b"U": _push_latin(1),
        b"T": _push_latin(4),
        b"\x81": _new_object,
        b"b": _build,
    },
)
