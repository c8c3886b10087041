"""Pickles of body models, as they are given away, read without executing anything.

They are written by Python 2, with chumpy's arrays and scipy's sparse matrices among numpy's; of these only the numbers
are taken.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.sparse import csc_matrix

from hoi_retarget.files.numpy_pickle import ARRAYS, Array, unpickle
from hoi_retarget.files.safe_pickle import Class, Function, Names, RefusedError, StandIn, Unpickler, plain, refusals

_ENTRIES = 1 << 26  # Of a sparse matrix when unfolded.
_WRAPPINGS = 4  # Of a chumpy array in others.


def read_body_pickle(path: Path, content: bytes, names: Iterable[str]) -> dict[str, np.ndarray | None]:
    """Return the arrays of the given names, and None for all else that the pickle's dictionary holds.

    Raises:
        ReadError: the content is damaged, names anything that could run, or is no dictionary.
    """
    with refusals(path, "Download the model again from its makers."):
        values = unpickle(content, _BODIES, encoding="latin-1")
        if not isinstance(values, dict):
            raise RefusedError("it holds no dictionary, as every body model does")
        wanted = set(names)
        return {str(name): _array(value) if name in wanted else None for name, value in values.items()}


@dataclass(eq=False)
class _Instance(StandIn):
    """An object of chumpy or scipy: its attributes, and nothing that they do."""

    kind: Literal["chumpy array", "chumpy selection", "sparse matrix", "object"]
    attributes: dict = field(default_factory=dict)

    def build(self, _unpickler: Unpickler, state: Any) -> None:
        """Take the attributes."""
        if not isinstance(state, dict):
            raise RefusedError(f"a {self.kind} has no attributes")
        self.attributes = state


def _array(value: Any, wrappings: int = _WRAPPINGS) -> np.ndarray | None:
    """Return the numbers of an array, a sparse matrix, or a chumpy array of one of these; None for all else."""
    if isinstance(value, _Instance):
        if value.kind == "sparse matrix":
            return _dense(value.attributes)
        if wrappings == 0:
            raise RefusedError(f"chumpy arrays are inside one another more than {_WRAPPINGS} deep")
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
    if len(sizes) != 2 or not all(type(size) is int and size > 0 for size in sizes) or math.prod(sizes) > _ENTRIES:
        raise RefusedError("a sparse matrix has no shape that a regressor can have")
    try:
        matrix = csc_matrix((entries, rows, starts), shape=shape)
        matrix.check_format(full_check=True)
    except (ValueError, TypeError, IndexError) as error:
        raise RefusedError(f"a sparse matrix contradicts itself ({error})") from error
    return matrix.toarray()


def _reconstructor(_unpickler: Unpickler, arguments: tuple) -> StandIn:
    """Return an object that Python 2 builds by a call."""
    kind = arguments[0] if arguments else None
    if not isinstance(kind, Class) or kind.make is None:
        raise RefusedError("refused: it builds an object of a class, expected arrays")
    return kind.make()


def _nothing(_unpickler: Unpickler, _arguments: tuple) -> None:
    """Stand for a set, which no array is in."""


_CHUMPY, _SPARSE = Class(lambda: _Instance("chumpy array")), Class(lambda: _Instance("sparse matrix"))
_BODIES: Names = {
    **ARRAYS,
    ("chumpy.ch", "Ch"): _CHUMPY,
    ("chumpy.ch", "MatVecMult"): _CHUMPY,
    ("chumpy.reordering", "Select"): Class(lambda: _Instance("chumpy selection")),
    **{
        (f"scipy.sparse.{module}", "csc_matrix"): Class(lambda: _Instance("sparse matrix"))
        for module in ("csc", "_csc")
    },
    **{(module, "set"): Function(_nothing) for module in ("__builtin__", "builtins")},
    **{(module, "_reconstructor"): Function(_reconstructor) for module in ("copy_reg", "copyreg")},
    **{(module, "object"): Class(lambda: _Instance("object")) for module in ("__builtin__", "builtins")},
}
