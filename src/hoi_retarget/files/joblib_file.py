"""Pickles that joblib wrote and that are too large to hold: the arrays stay in the file.

The pickle is interpreted once, without executing it; its arrays then are views of the mapped file, of which only those
that are looked at are read.
"""

import hashlib
import zlib
from pathlib import Path
from typing import Any

from hoi_retarget.errors import ReadError
from hoi_retarget.files.numpy_pickle import ARRAYS, COMPRESSED, unpickle
from hoi_retarget.files.reading import map_bytes
from hoi_retarget.files.safe_pickle import plain, refusals


def read_joblib(path: Path) -> tuple[Any, str]:
    """Return what a pickle of plain values and arrays holds, arrays read-only, and the file's SHA-256.

    Raises:
        ReadError: the file is missing, damaged, or holds anything else, such as something that would be executed.
    """
    content = map_bytes(path)
    with refusals(path, "Download it again."):
        return plain(unpickle(content, ARRAYS)), hashlib.sha256(content).hexdigest()


def starts_with(path: Path, names: tuple[bytes, ...], size: int) -> bool:
    """Return whether all names are among the first bytes of a pickle; raises `ReadError`."""
    try:
        with path.open("rb") as file:
            start = file.read(size)
        if start.startswith(COMPRESSED):
            start = zlib.decompressobj().decompress(start, size)
    except (OSError, zlib.error) as error:
        raise ReadError(f"{path}: cannot be read ({error}).") from error
    return all(name in start for name in names)
