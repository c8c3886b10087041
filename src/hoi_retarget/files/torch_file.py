"""Reads torch's `.pt` and `.pth` files without torch and without executing what they hold.

A torch file is a pickle beside the raw bytes of its tensors; `pickle_machine` interprets the pickle.

Formats: the zip archive of torch >= 1.6 (`<name>/data.pkl`, `<name>/data/<key>`,
`<name>/byteorder`) and the older plain one (pickles, then each storage behind its length);
both as `torch/serialization.py` writes them.
"""

import io
import pickletools
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.files.pickle_machine import RESAVE, RefusedError, StorageType, damaged, interpret

_LEGACY_MAGIC = (0x1950A86A20F9469CFC6C).to_bytes(10, "little")
_LEGACY_PROTOCOL = 1001


def read_torch(path: Path) -> Any:
    """Return what a torch file holds: tensors as read-only numpy arrays, in plain containers.

    bfloat16 becomes float32; every other type keeps its own.

    Raises:
        ReadError: the file is missing, damaged, or holds anything but tensors, numbers, strings,
            dictionaries, lists, tuples and None.
    """
    return parse_torch(read_bytes(path), path)


def read_bytes(path: Path) -> bytes:
    """Return the content of a regular file; raises `ReadError`."""
    try:
        if not path.exists():
            raise ReadError(f"{path}: there is no such file. Check the path.")
        if not path.is_file():
            raise ReadError(f"{path}: not a file but a folder or a device. Name one file in it.")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        raise ReadError(f"{path}: cannot be read ({error}). Check the path and its permissions.") from error


def parse_torch(content: bytes, path: Path) -> Any:
    """Return what the bytes of a torch file hold; `path` is only named in errors.

    Raises `ReadError` as `read_torch` does.
    """
    if not content:
        raise ReadError(f"{path}: the file is empty, expected a torch file. Download it again.")
    try:
        if content.startswith(b"PK"):
            return _parse_archive(content)
        if content.startswith(b"\x80") and _LEGACY_MAGIC in content[:32]:
            return _parse_legacy(content)
    except RefusedError as error:
        raise ReadError(f"{path}: {error}") from error
    if content.startswith(b"\x80") and content.endswith(b"."):
        raise ReadError(
            f"{path}: not a torch file but a plain Python pickle, refused{_first_import(content)}: it could run code. "
            "Save plain tensors with torch.save(tensor, path) where it was made."
        )
    raise ReadError(
        f"{path}: not a torch file: it starts with {content[:8]!r}, expected a zip archive "
        f"(torch >= 1.6) or torch's older format. {RESAVE}"
    )


def _first_import(content: bytes) -> str:
    """Return the first name that a pickle imports, in words; nothing is executed."""
    strings: list[str] = []
    try:
        for operation, argument, _ in pickletools.genops(content):
            if operation.name == "GLOBAL":
                return f" (it imports {ascii(str(argument).replace(' ', '.'))[1:-1][:120]})"
            if operation.name == "STACK_GLOBAL" and len(strings) > 1:
                return f" (it imports {ascii('.'.join(strings[-2:]))[1:-1][:120]})"
            if isinstance(argument, str):
                strings.append(argument)
    except (ValueError, OverflowError, MemoryError):
        pass  # Damaged; what it would import is not known.
    return ""


# The two formats


def _parse_archive(content: bytes) -> Any:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = _archive_entries(archive, len(content))
            prefix = _archive_prefix(entries)
            byte_order = _byte_order(archive, entries.get(f"{prefix}/byteorder"))
            storages: dict[str, tuple[StorageType, np.ndarray]] = {}

            def storage(kind: StorageType, key: str, count: int) -> np.ndarray:
                if key not in storages:
                    entry = entries.get(f"{prefix}/data/{key}")
                    if entry is None:
                        raise damaged(f"a tensor's storage {key[:80]!r} is not in the archive")
                    if count * kind.item_size > entry.file_size:
                        raise damaged(
                            f"storage {key!r} should hold {count} elements of {kind.item_size} bytes, "
                            f"but the archive has {entry.file_size} bytes for it"
                        )
                    raw = _entry_bytes(archive, entry)[: count * kind.item_size]
                    storages[key] = kind, kind.decode(raw, byte_order)
                return _same_storage(storages[key], kind, key, count)

            return interpret(_entry_bytes(archive, entries[f"{prefix}/data.pkl"]), storage)[0]
    # zipfile raises all of these on damaged archives; RuntimeError is its word for encryption.
    except (
        zipfile.BadZipFile,
        zlib.error,
        struct.error,
        EOFError,
        OSError,
        ValueError,
        KeyError,
        NotImplementedError,
        RuntimeError,
        OverflowError,
    ) as error:
        raise damaged(f"the archive is damaged or cut off ({error})") from error


def _archive_entries(archive: zipfile.ZipFile, available: int) -> dict[str, zipfile.ZipInfo]:
    entries: dict[str, zipfile.ZipInfo] = {}
    for entry in archive.infolist():
        parts = entry.filename.replace("\\", "/").split("/")
        if ".." in parts or parts[0] == "":
            raise damaged(f"the archive's entry {entry.filename!r} points outside of the archive")
        if entry.filename in entries:
            raise damaged(f"the archive holds {entry.filename!r} twice")
        entries[entry.filename] = entry
    # Entries that overlap could otherwise multiply a small file into any amount of memory.
    if sum(entry.compress_size for entry in entries.values()) > available:
        raise damaged("the archive's entries claim more bytes than the file has")
    return entries


def _entry_bytes(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    # What is not compressed cannot unpack to more than the file has.
    if entry.compress_type != zipfile.ZIP_STORED or entry.file_size != entry.compress_size:
        raise damaged(f"the archive's entry {entry.filename[:80]!r} is compressed, which torch does not do")
    return archive.read(entry)


def _archive_prefix(entries: dict[str, zipfile.ZipInfo]) -> str:
    prefixes = [name.removesuffix("/data.pkl") for name in entries if name.endswith("/data.pkl")]
    if len(prefixes) != 1:
        shown = ", ".join(repr(name[:60]) for name in list(entries)[:5]) or "nothing"
        raise damaged(
            f"a zip archive, but not one of torch: expected exactly one NAME/data.pkl, found {len(prefixes)}; "
            f"it holds {shown}"
        )
    return prefixes[0]


def _byte_order(archive: zipfile.ZipFile, entry: zipfile.ZipInfo | None) -> Literal["<", ">"]:
    # Archives from before torch 2.1 do not say; they are little endian on all machines in use.
    text = b"little" if entry is None else _entry_bytes(archive, entry)
    if text not in (b"little", b"big"):
        raise damaged(f"its byte order is {text[:16]!r}, expected b'little' or b'big'")
    return "<" if text == b"little" else ">"


def _same_storage(known: tuple[StorageType, np.ndarray], kind: StorageType, key: str, count: int) -> np.ndarray:
    if known[0] != kind or len(known[1]) != count:
        raise damaged(
            f"two tensors disagree about storage {key!r}: {len(known[1])} of {known[0].name} or {count} of {kind.name}"
        )
    return known[1]


def _parse_legacy(content: bytes) -> Any:
    """Read torch's format before 1.6.

    Pickles of the magic number, the protocol, facts of the writing machine, the object, and the
    list of its storages; then for each storage its number of elements and its bytes.
    """

    def no_storage(_kind: StorageType, _key: str, _count: int) -> None:
        return None

    _, position = interpret(content, no_storage)
    protocol, position = interpret(content, no_storage, position)
    machine, position = interpret(content, no_storage, position)
    if protocol != _LEGACY_PROTOCOL or not isinstance(machine, dict):
        raise damaged(f"torch's older format, but not its protocol {_LEGACY_PROTOCOL}")
    byte_order = "<" if machine.get("little_endian", True) else ">"

    # The tensors come before their bytes: a first reading learns which storages there are.
    kinds: dict[str, tuple[StorageType, int]] = {}

    def note(kind: StorageType, key: str, count: int) -> None:
        kinds.setdefault(key, (kind, count))

    start = position
    _, position = interpret(content, note, start)
    keys, position = interpret(content, no_storage, position)
    if not isinstance(keys, list):
        raise damaged("the list of storages is missing")
    storages: dict[str, tuple[StorageType, np.ndarray]] = {}
    for key in keys:
        if not isinstance(key, str) or key not in kinds or key in storages:
            raise damaged("the list of storages does not fit the tensors")
        kind, count = kinds[key]
        end = position + 8 + count * kind.item_size
        stated = int.from_bytes(content[position : position + 8], "little" if byte_order == "<" else "big")
        if stated != count or end > len(content):
            raise damaged(
                f"storage {key[:80]!r} should hold {count} elements of {kind.item_size} bytes, "
                f"but states {stated} and {max(0, len(content) - position - 8)} bytes follow"
            )
        storages[key] = kind, kind.decode(content[position + 8 : end], byte_order)
        position = end

    def storage(kind: StorageType, key: str, count: int) -> np.ndarray:
        if key not in storages:
            raise damaged(f"a tensor's storage {key[:80]!r} is not in the file")
        return _same_storage(storages[key], kind, key, count)

    return interpret(content, storage, start)[0]
