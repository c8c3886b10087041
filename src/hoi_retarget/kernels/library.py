"""The compiled library: its functions, and how arrays go to them."""

import ctypes
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

NAME = {"win32": "kernels.dll", "darwin": "kernels.dylib"}.get(sys.platform, "kernels.so")
WHOLE, REAL = ctypes.c_int64, ctypes.c_double
_ARGUMENTS = {"p": ctypes.c_void_p, "i": WHOLE, "d": REAL}


def _library() -> ctypes.CDLL:
    path = Path(__file__).with_name(NAME)
    if not path.exists():
        raise ImportError(f"{path} is missing: install hoi-retarget with pip, which compiles it.")
    return ctypes.CDLL(str(path))


_LIBRARY = _library()


def function(name: str, arguments: str, *, allocates: bool = False, counts: bool = False) -> Callable[..., Any]:
    """Return a function of the library.

    Args:
        name: Of the function.
        arguments: One letter each: an address (p), a whole number (i) or a real one (d).
        allocates: Whether it returns whether memory is short, which is then an error.
        counts: Whether it returns a whole number.
    """
    found = getattr(_LIBRARY, name)
    found.argtypes = [_ARGUMENTS[kind] for kind in arguments]
    found.restype = WHOLE if counts else None
    if allocates:
        found.restype, found.errcheck = ctypes.c_int, _checked
    return found


def _checked(short_of_memory: int, *_: object) -> None:
    if short_of_memory:
        raise MemoryError


def at(array: np.ndarray | None) -> int | None:
    """Return the address of an array's numbers."""
    return None if array is None else array.__array_interface__["data"][0]


def real(array: np.ndarray) -> np.ndarray:
    """Return the array as the library reads it: in C order, in double precision."""
    return np.ascontiguousarray(array, dtype=np.float64)


def whole(array: np.ndarray) -> np.ndarray:
    """Return the array of whole numbers as the library reads it."""
    return np.ascontiguousarray(array, dtype=np.int64)
