"""Reads numpy's arrays of Python objects, as `numpy.save(..., allow_pickle=True)` writes them, executing nothing.

Several sources keep a dictionary in an array of their `.npz` files: one object, or a list of some. What is in it is
plain values and arrays of numbers, or it is refused.
"""

import re
from pathlib import Path
from typing import Any

from hoi_retarget.errors import ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.array_pickle import ARRAYS, StandIn, parse_raw, plain
from hoi_retarget.files.pickle_machine import Dialect, Machine, RefusedError

_HEADER = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '\|O(?:8)?', 'fortran_order': False, 'shape': \((?P<shape>[\d, ]*)\), \} *\n",
    re.DOTALL,
)


def object_or_array(path: Path, name: str, content: bytes) -> Any:
    """Return what an `.npy` file holds: an array of numbers or text; of one object, this object; of several, a list.

    Args:
        path: the file that it is in, for errors.
        name: what the array is called.
        content: the bytes of the `.npy` file.

    Raises:
        ReadError: it is damaged, or holds anything else than plain values and arrays.
    """
    header = _HEADER.match(content)
    try:
        if header is None:
            return npz.array(name, content, "fiubU")
        values = plain(parse_raw(content[header.end() :], _OBJECTS), {})
    except (RefusedError, ValueError) as error:
        raise ReadError(f"{path}: {name} cannot be read: {error}. Download the file again.") from error
    single = not header["shape"].strip()
    if not isinstance(values, list) or (single and len(values) != 1):
        raise ReadError(f"{path}: {name} is no array of objects, although it says so. Download the file again.")
    return values[0] if single else values


def _build(machine: Machine) -> None:
    """Fill an array of objects; numpy's other things as in all pickles."""
    if len(machine.stack) > 1:
        target, state = machine.stack[-2:]
        if isinstance(target, StandIn) and isinstance(state, tuple) and len(state) == 5 and isinstance(state[4], list):
            machine.pop()
            target.content = state[4]
            return
    ARRAYS.operations[b"b"](machine)


_OBJECTS = Dialect(ARRAYS.names, {**ARRAYS.operations, b"b": _build})
