"""The user's cache folder: results of long computations, kept between runs. Nothing fails where it cannot be used."""

import os
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from hoi_retarget.errors import WriteError
from hoi_retarget.files import npz
from hoi_retarget.files.atomic import write_atomically

_MAX_BYTES = 512 << 20  # All files together; the least recently used ones are removed first.


def read_cached(name: str) -> bytes | None:
    """Return the content of a cached file, or None where there is none to be read."""
    path = _folder() / name
    try:
        content = path.read_bytes()
    except OSError:
        return None
    with suppress(OSError):
        os.utime(path)
    return content


def write_cached(name: str, content: bytes) -> None:
    """Write a file, named after everything that its content depends on; processes may do so at once."""
    folder = _folder()
    with suppress(OSError, WriteError):
        write_atomically(folder / name, content)
        files = sorted(((file.stat().st_mtime, file.stat().st_size, file) for file in folder.iterdir()), reverse=True)
        total = 0
        for _, size, file in files:
            total += size
            if total > _MAX_BYTES:
                file.unlink()


def cached_arrays(
    name: str, kinds: Mapping[str, str], build: Callable[[], Mapping[str, np.ndarray]]
) -> Mapping[str, np.ndarray]:
    """Return the arrays of a cached `.npz` file; where it is missing or damaged, they are built and cached.

    `kinds` has the numpy kinds of each array's numbers.
    """
    content = read_cached(name)
    if content is not None:
        with suppress(KeyError, ValueError):
            entries = npz.members(content)
            return {key: npz.array(key, entries[key], kind) for key, kind in kinds.items()}
    arrays = build()
    write_cached(name, npz.encode(arrays))
    return arrays


def _folder() -> Path:
    """Return the platform's place for caches."""
    home = Path(os.path.expanduser("~"))  # noqa: PTH111  # unlike Path.home, never fails
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    return base / "hoi-retarget"
