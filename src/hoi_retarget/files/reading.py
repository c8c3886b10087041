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
from pathlib import Path
from xml.etree import ElementTree as ET

from hoi_retarget.errors import ReadError

MAXIMUM_SIZE = 1 << 32
"""Bytes that a compressed archive may unpack to: a few megabytes of it can claim any memory."""
_SMALL_MOTION = 32 << 20  # Bytes of a quarter of an hour at 30 frames a second.
_MOTION_RATIO = 16  # What people do compresses to a half; zeros, which fill no motion, to a thousandth.
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


def unpacked(content: bytes, *, stored: bool = False, limit: int | None = None) -> dict[str, bytes]:
    """Return an archive's entries by name, with their checksums compared.

    All must be uncompressed where `stored`; otherwise they may unpack to `limit` bytes, or `MAXIMUM_SIZE`. Raises
    `ValueError` for an archive that is damaged, or beyond a limit.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            fault = _fault(archive, len(content), None if stored else limit or MAXIMUM_SIZE)
            entries = {} if fault else {entry.filename: archive.read(entry) for entry in archive.infolist()}
    except _ERRORS as error:
        raise ValueError(f"damaged or cut off: {error}") from error
    if fault:
        raise ValueError(fault)
    return entries


def limit_of_motion(packed: int) -> int:
    """Return the most bytes that a motion's file, which has so many itself, may unpack to."""
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


def parse_xml(content: bytes) -> ET.Element:
    """Return the outermost element of a file.

    Raises `ValueError` where it is no XML, or declares entities, which can stand for any file and any amount of text.
    """
    if b"<!ENTITY" in content or b"<!DOCTYPE" in content or b"\0" in content:
        raise ValueError("it declares entities, which are not needed, or is no text. Take the declaration out.")
    try:
        return ET.fromstring(re.sub(rb"^\s*<\?xml[^>]*\?>", b"", content))
    except (ET.ParseError, ValueError, RecursionError) as error:
        raise ValueError(f"it is no XML ({error}).") from error
