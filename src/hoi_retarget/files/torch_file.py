"""Torch's `.pt` and `.pth` files, and tensors in plain pickles, read without torch and without executing anything.

Formats: the zip archive of torch >= 1.6 (`<name>/data.pkl`, `<name>/data/<key>`, `<name>/byteorder`) and the older
plain one (pickles, then each storage behind its length), both as `torch/serialization.py` writes them. A plain pickle
holds a whole file of the older format for each storage.
"""

import pickletools
from pathlib import Path
from typing import Any

from hoi_retarget.errors import ReadError
from hoi_retarget.files.archive import unpacked
from hoi_retarget.files.numpy_pickle import ARRAYS, unpickle
from hoi_retarget.files.safe_pickle import Function, Names, RefusedError, Unpickler, plain, refusals
from hoi_retarget.files.torch_pickle import TENSORS, Storage, Storages

_LEGACY_MAGIC = (0x1950A86A20F9469CFC6C).to_bytes(10, "little")
_LEGACY_PROTOCOL = 1001
_PICKLE = b"\x80"
_RESAVE = "Save plain tensors again with torch.save(tensor, path) where it was made, or download it again."


def parse_torch(content: bytes, path: Path) -> Any:
    """Return what the bytes of a torch file hold: tensors as read-only arrays, in plain containers.

    bfloat16 becomes float32; every other type keeps its own. `path` is only named in errors.

    Raises:
        ReadError: the file is damaged, or holds anything but tensors, numbers, text, dictionaries, lists, tuples and
            None.
    """
    if not content:
        raise ReadError(f"{path}: the file is empty, expected a torch file. Download it again.")
    with refusals(path, _RESAVE):
        if content.startswith(b"PK"):
            return plain(_parse_archive(content))
        if content.startswith(_PICKLE) and _LEGACY_MAGIC in content[:32]:
            return plain(_parse_legacy(content)[0])
    if content.startswith(_PICKLE) and content.endswith(b"."):
        raise ReadError(
            f"{path}: not a torch file but a plain Python pickle, refused{_first_import(content)}: it could run code. "
            "Save plain tensors with torch.save(tensor, path) where it was made."
        )
    raise ReadError(
        f"{path}: not a torch file: it starts with {content[:8]!r}, expected a zip archive "
        f"(torch >= 1.6) or torch's older format. {_RESAVE}"
    )


def parse_tensors(content: bytes, path: Path) -> Any:
    """Return what a pickle of plain values, arrays and tensors holds, all of these as arrays.

    Raises:
        ReadError: it is damaged, or holds anything else, such as something that would be executed.
    """
    with refusals(path, "Download it again."):
        return plain(unpickle(content, _ARRAYS_AND_TENSORS))


def _load_from_bytes(unpickler: Unpickler, arguments: tuple) -> Storage:
    """Return the only storage in a whole file of torch's older format."""
    if len(arguments) != 1 or not isinstance(arguments[0], bytes):
        raise RefusedError("a tensor's storage is made from something that is no bytes")
    unpickler.spend(len(arguments[0]))
    storage, count = _parse_legacy(arguments[0])
    if not isinstance(storage, Storage) or count != 1:
        raise RefusedError("the file inside, of a tensor's storage, holds something else")
    return storage


_ARRAYS_AND_TENSORS: Names = {
    **ARRAYS,
    **TENSORS,
    ("torch.storage", "_load_from_bytes"): Function(_load_from_bytes),
}


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
        entries = unpacked(content, stored=True)
    except ValueError as error:
        raise RefusedError(str(error)) from error
    prefix = _archive_prefix(entries)
    # Archives from before torch 2.1 do not say; they are little endian on all machines in use.
    order = entries.get(f"{prefix}/byteorder", b"little")
    if order not in (b"little", b"big"):
        raise RefusedError(f"its byte order is {order[:16]!r}, expected b'little' or b'big'")
    storages = Storages()
    value = Unpickler(entries[f"{prefix}/data.pkl"], TENSORS, refer=storages.refer).next()
    for key, storage in storages.items():
        raw = entries.get(f"{prefix}/data/{key}")
        if raw is None:
            raise RefusedError(f"a tensor's storage {key[:80]!r} is not in the archive")
        if storage.size > len(raw):
            raise RefusedError(
                f"storage {key[:80]!r} should hold {storage.count} elements of {storage.kind.item_size} bytes, "
                f"but the archive has {len(raw)} bytes for it"
            )
        storage.fill(raw[: storage.size], "<" if order == b"little" else ">")
    return value


def _archive_prefix(entries: dict[str, bytes]) -> str:
    prefixes = [name.removesuffix("/data.pkl") for name in entries if name.endswith("/data.pkl")]
    if len(prefixes) != 1:
        shown = ", ".join(repr(name[:60]) for name in list(entries)[:5]) or "nothing"
        raise RefusedError(
            f"a zip archive, but not one of torch: expected exactly one NAME/data.pkl, found {len(prefixes)}; "
            f"it holds {shown}"
        )
    return prefixes[0]


def _parse_legacy(content: bytes) -> tuple[Any, int]:
    """Return the object in a file of torch's format before 1.6, and how many storages it has.

    Pickles of the magic number, the protocol, facts of the writing machine, the object, and the list of its storages;
    then for each storage its number of elements and its bytes.
    """
    storages = Storages()
    pickles = Unpickler(content, TENSORS, refer=storages.refer)
    _, protocol, machine, value, keys = (pickles.next() for _ in range(5))
    if protocol != _LEGACY_PROTOCOL or not isinstance(machine, dict):
        raise RefusedError(f"torch's older format, but not its protocol {_LEGACY_PROTOCOL}")
    little = bool(machine.get("little_endian", True))
    if not isinstance(keys, list) or not all(isinstance(key, str) for key in keys) or len(set(keys)) < len(keys):
        raise RefusedError("the list of storages is missing, or names one twice")
    position = pickles.source.position
    for key in keys:
        if key not in storages:
            raise RefusedError("the list of storages does not fit the tensors")
        storage = storages[key]
        start, end = position + 8, position + 8 + storage.size
        stated = int.from_bytes(content[position:start], "little" if little else "big")
        if stated != storage.count or end > len(content):
            raise RefusedError(
                f"storage {key[:80]!r} should hold {storage.count} elements of {storage.kind.item_size} bytes, "
                f"but states {stated} and {max(0, len(content) - start)} bytes follow"
            )
        storage.fill(content[start:end], "<" if little else ">")
        position = end
    return value, len(storages)
