"""A file's bytes, with our errors."""

import mmap
from pathlib import Path

from hoi_retarget.errors import ReadError


def read_bytes(path: Path) -> bytes:
    """Return the content of a regular file; raises `ReadError`."""
    try:
        _check_file(path)
        return path.read_bytes()
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from error


def map_bytes(path: Path) -> bytes | mmap.mmap:
    """Return the content of a regular file that is read where it is looked at; raises `ReadError`."""
    try:
        _check_file(path)
        with path.open("rb") as file:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if path.stat().st_size else b""
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from error


def _check_file(path: Path) -> None:
    if not path.exists():
        raise ReadError(f"{path}: there is no such file. Check the path.")
    if not path.is_file():
        raise ReadError(f"{path}: cannot be read: this is a folder, or a device. Name one file in it.")


def _unreadable(path: Path, error: Exception) -> ReadError:
    return ReadError(f"{path}: cannot be read ({error}). Check the path and its permissions.")
