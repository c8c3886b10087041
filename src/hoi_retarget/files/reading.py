"""Bytes of files, entries of zip archives, and XML of other programs, read within limits.

No archive unpacks to more than memory holds, has an entry twice or one outside of its folder; no XML declares entities.
"""

import io
import lzma
import mmap
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from hoi_retarget.errors import ReadError

LFS_ADVICE = "a Git LFS pointer stands in place of the file. Run in its clone: git lfs pull"
_MAX_DEPTH = 256  # Of XML: Python's own functions on elements are recursive.
_SMALL_MOTION = 32 << 20  # Bytes of a quarter of an hour at 30 frames a second.
_MOTION_RATIO = 16  # What people do compresses to a half; zeros, which fill no motion, to a thousandth.
_LFS_POINTER = b"version https://git-lfs.github.com/spec/"
"""Begins what a clone without Git LFS has in place of large files."""
# What zipfile and its decompressors raise for damaged archives; RuntimeError is its word for encryption.
_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    EOFError,
    KeyError,
    OSError,
    OverflowError,
    RuntimeError,
    ValueError,
)


def read_bytes(path: Path) -> bytes:
    """Return the content of a regular file; raises `ReadError`."""
    check_file(path)
    try:
        return path.read_bytes()
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from error


def map_bytes(path: Path) -> bytes | mmap.mmap:
    """Return the content of a regular file that is read where it is looked at; raises `ReadError`."""
    check_file(path)
    try:
        with path.open("rb") as file:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if path.stat().st_size else b""
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from error


def check_file(path: Path) -> None:
    """Raise `ReadError` unless a path is a regular file that can be opened, and no Git LFS pointer."""
    try:
        if not path.exists():
            raise ReadError(f"{path}: there is no such file. Check the path.")
        if not path.is_file():
            raise ReadError(f"{path}: cannot be read: this is a folder, or a device. Name one file in it.")
        with path.open("rb") as file:
            if file.read(len(_LFS_POINTER)) == _LFS_POINTER:
                raise ReadError(f"{path}: {LFS_ADVICE}")
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> ReadError:
    return ReadError(f"{path}: cannot be read ({error}). Check the path and its permissions.")


class Archive(Mapping[str, Any]):  # A check of types would unpack bytes.
    """An archive's entries by name, each unpacked when it is asked for, and its checksum compared.

    All must be uncompressed where `stored`; otherwise they may unpack to `limit_unpacked` together. Raises `ValueError`
    for an archive that is damaged, or beyond a limit, also later.
    """

    def __init__(self, content: bytes, *, stored: bool = False) -> None:
        try:
            self._archive = zipfile.ZipFile(io.BytesIO(content))
            fault = _fault(self._archive, len(content), None if stored else limit_unpacked(len(content)))
        except _ERRORS as error:
            raise _damaged(error) from error
        if fault:
            raise ValueError(fault)
        self._names = frozenset(self._archive.namelist())
        self._unpacked: dict[str, bytes] = {}

    def __getitem__(self, name: str) -> bytes:
        if name not in self._names:
            raise KeyError(name)
        try:
            return self._unpacked.setdefault(name, self._unpacked.get(name) or self._archive.read(name))
        except _ERRORS as error:
            raise _damaged(error) from error

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._archive.namelist())

    def __len__(self) -> int:
        return len(self._names)


def _damaged(error: Exception) -> ValueError:
    return ValueError(f"damaged or cut off: {error}")


def limit_unpacked(packed: int) -> int:
    """Return the most bytes that a file of so many bytes may unpack to: a few megabytes can claim any memory."""
    return max(_SMALL_MOTION, _MOTION_RATIO * packed)


def entry_names(path: Path) -> frozenset[str]:
    """Return the names of an archive's entries, without reading them; empty where it is no such file."""
    try:
        with zipfile.ZipFile(path) as archive:
            return frozenset(archive.namelist())
    except _ERRORS:
        return frozenset()


def _fault(archive: zipfile.ZipFile, available: int, limit: int | None) -> str | None:
    """Return the first limit that an archive's directory exceeds, in words; without one, all must be uncompressed."""
    entries = archive.infolist()
    known: set[str] = set()
    for entry in entries:
        parts = entry.filename.replace("\\", "/").split("/")
        if ".." in parts or parts[0] == "":
            return f"the archive's entry {entry.filename!r} points outside of the archive"
        if entry.filename in known:
            return f"the archive holds {entry.filename!r} twice"
        if limit is None and (entry.compress_type != zipfile.ZIP_STORED or entry.file_size != entry.compress_size):
            return f"the archive's entry {entry.filename[:80]!r} is compressed, expected plain bytes"
        known.add(entry.filename)
    # Entries that overlap could otherwise multiply a small file into any amount of memory.
    if sum(entry.compress_size for entry in entries) > available:
        return "the archive's entries claim more bytes than the file has"
    size = sum(entry.file_size for entry in entries)
    if limit is not None and size > limit:
        return f"it would unpack to {size / 1e6:.4g} MB, expected at most {limit / 1e6:.4g}"
    return None


def _levels(root: ET.Element) -> Iterator[list[ET.Element]]:
    level = [root]
    while level:
        yield level
        level = [child for element in level for child in element]


def parse_xml(content: bytes) -> ET.Element:
    """Return the outermost element of a file.

    Raises `ValueError` where it is no XML, or declares entities, which can stand for any file and any amount of text.
    """
    if b"<!ENTITY" in content or b"<!DOCTYPE" in content or b"\0" in content:
        raise ValueError("it declares entities, which are not needed, or is no text. Take the declaration out.")
    try:
        root = ET.fromstring(re.sub(rb"^\s*<\?xml[^>]*\?>", b"", content))
        if next(islice(_levels(root), _MAX_DEPTH, None), None):
            raise ValueError(f"elements stand in each other more than {_MAX_DEPTH} deep")
        return root
    except (ET.ParseError, ValueError, RecursionError) as error:
        raise ValueError(f"it is no XML ({error}).") from error
