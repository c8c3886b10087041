"""Pickles of body models, as their authors publish them, read without executing anything.

They are written by Python 2, with chumpy's arrays and scipy's sparse matrices among numpy's; only the numbers are read.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy  # its modules are loaded where they are first used

from hoi_retarget.files.array_pickle import ARRAYS, Array, unpickle
from hoi_retarget.files.safe_pickle import Class, Function, Names, RefusedError, Stub, Unpickler, plain, refusals

_MAX_ENTRIES = 1 << 26  # Of a sparse matrix when unfolded.
_MAX_WRAPPINGS = 4  # Of a chumpy array in others.


def read_body_pickle(path: Path, content: bytes, names: Iterable[str]) -> dict[str, np.ndarray | None]:
    """Return the arrays of the given names, and None for all else that the pickle's dictionary holds.

    Raises `ReadError` where the content is damaged, names anything that could run, or is no dictionary.
    """
    with refusals(path, "Download the model again from its makers."):
        values = unpickle(content, _BODIES, encoding="latin-1")
        if not isinstance(values, dict):
            raise RefusedError("it holds no dictionary, as every body model does")
        requested = set(names)
        return {str(name): _array(value) if name in requested else None for name, value in values.items()}


@dataclass(eq=False)
class _Instance(Stub):
    """An object of chumpy or scipy: its attributes, and nothing that they do."""

    kind: Literal["chumpy array", "chumpy selection", "sparse matrix", "object"]
    attributes: dict = field(default_factory=dict)

    def build(self, _unpickler: Unpickler, state: Any) -> None:
        """Take the attributes."""
        if not isinstance(state, dict):
            raise RefusedError(f"a {self.kind} has no attributes")
        self.attributes = state


def _array(value: Any, wrappings: int = _MAX_WRAPPINGS) -> np.ndarray | None:
    """Return the numbers of an array, a sparse matrix, or a chumpy array of one of these; None for all else."""
    if isinstance(value, _Instance):
        if value.kind == "sparse matrix":
            return _dense(value.attributes)
        if wrappings == 0:
            raise RefusedError(f"chumpy arrays are inside one another more than {_MAX_WRAPPINGS} deep")
        if value.kind == "chumpy selection":
            return _selected(value.attributes, _array(value.attributes.get("a"), wrappings - 1))
        return _array(value.attributes.get("x"), wrappings - 1)
    array = plain(value, objects=True) if isinstance(value, Array) else None
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
        raise RefusedError(f"a selection of an array contradicts itself ({error})") from error


def _dense(attributes: dict) -> np.ndarray:
    """Return a matrix stored by columns: entries, their rows, and where each column begins."""
    entries, rows, starts = (_array(attributes.get(name)) for name in ("data", "indices", "indptr"))
    shape = attributes.get("_shape", attributes.get("shape"))
    sizes = shape if isinstance(shape, tuple) else ()
    if len(sizes) != 2 or not all(type(size) is int and size > 0 for size in sizes) or math.prod(sizes) > _MAX_ENTRIES:
        raise RefusedError("a sparse matrix has no shape that a regressor can have")
    try:
        matrix = scipy.sparse.csc_matrix((entries, rows, starts), shape=shape)
        matrix.check_format(full_check=True)
    except (ValueError, TypeError, IndexError) as error:
        raise RefusedError(f"a sparse matrix contradicts itself ({error})") from error
    return matrix.toarray()


def _new_object(_unpickler: Unpickler, kind: Class, *_: Any) -> Any:
    """Return an object that Python 2 builds by a call."""
    if kind.new is None:
        raise RefusedError(_NO_ARRAY)
    return kind.new()


_NO_ARRAY = "refused: it builds an object of a class, expected arrays"
_KINDS = ("chumpy array", "sparse matrix", "object")
_CHUMPY, _SPARSE, _OBJECT = (Class(lambda kind=kind: _Instance(kind)) for kind in _KINDS)
_BODIES: Names = {
    **ARRAYS,
    ("chumpy.ch", "Ch"): _CHUMPY,
    ("chumpy.ch", "MatVecMult"): _CHUMPY,
    ("chumpy.reordering", "Select"): Class(lambda: _Instance("chumpy selection")),
    ("scipy.sparse.csc", "csc_matrix"): _SPARSE,
    ("scipy.sparse._csc", "csc_matrix"): _SPARSE,
    **{
        (module, name): stub
        for python_2, python_3, name, stub in (
            ("__builtin__", "builtins", "object", _OBJECT),
            ("__builtin__", "builtins", "set", Function(lambda *_: None, (...,), "")),  # No array is in a set.
            ("copy_reg", "copyreg", "_reconstructor", Function(_new_object, (Class, ...), _NO_ARRAY)),
        )
        for module in (python_2, python_3)
    },
}
