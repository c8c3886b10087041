"""Reads the pickles in which body models are given away, without executing what they hold.

They are written by Python 2, with chumpy's arrays and scipy's sparse matrices among numpy's. The dialect of
`array_pickle` is widened by stand-ins that keep the numbers of these and do nothing.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

from hoi_retarget.errors import ReadError
from hoi_retarget.files.array_pickle import ARRAYS, StandIn, parse_raw, plain
from hoi_retarget.files.pickle_machine import Dialect, Function, Machine, RefusedError, damaged

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


_CHUMPY, _SELECTION, _SPARSE = _Class("chumpy array"), _Class("chumpy selection"), _Class("sparse matrix")
_ENTRIES = 1 << 26  # Of a sparse matrix when unfolded.
_WRAPPINGS = 4  # Of a chumpy array in others.


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


def _array(value: Any, wrappings: int = _WRAPPINGS) -> np.ndarray | None:
    """Return the numbers of an array, a sparse matrix, or a chumpy array of one of these; None for all else."""
    if isinstance(value, _Instance):
        if value.kind is _SPARSE:
            return _dense(value.attributes)
        if wrappings == 0:
            raise damaged(f"{_CHUMPY.name}s are inside one another more than {_WRAPPINGS} deep")
        if value.kind is _SELECTION:
            return _selected(value.attributes, _array(value.attributes.get("a"), wrappings - 1))
        return _array(value.attributes.get("x"), wrappings - 1)
    array = plain(value, {}) if isinstance(value, StandIn) else None
    return array if isinstance(array, np.ndarray) else None


def _selected(attributes: dict, source: np.ndarray | None) -> np.ndarray:
    """Return the entries of a flattened array that a selection names, in its shape."""
    index, shape = _array(attributes.get("idxs")), attributes.get("preferred_shape")
    try:
        if source is None or index is None:
            raise ValueError("it names no array")
        chosen = source.ravel()[index]
        return chosen if shape is None else chosen.reshape(shape)
    except (ValueError, TypeError, IndexError) as error:
        raise damaged(f"a selection of an array contradicts itself ({error})") from error


def _dense(attributes: dict) -> np.ndarray:
    """Return a matrix stored by columns: entries, their rows, and where each column begins."""
    entries, rows, starts = (_array(attributes.get(name)) for name in ("data", "indices", "indptr"))
    shape = attributes.get("_shape", attributes.get("shape"))
    sizes = shape if isinstance(shape, tuple) else ()
    if len(sizes) != 2 or not all(type(size) is int and size > 0 for size in sizes) or math.prod(sizes) > _ENTRIES:
        raise damaged("a sparse matrix has no shape that a regressor can have")
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
        ("chumpy.ch", "Ch"): _CHUMPY,
        ("chumpy.ch", "MatVecMult"): _Class("chumpy product"),
        ("chumpy.reordering", "Select"): _SELECTION,
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
