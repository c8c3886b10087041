"""Torch's `.pt` and `.pth` files, read without torch and without executing anything.

Formats: the zip archive of torch >= 1.6 (`<name>/data.pkl`, `<name>/data/<key>`, `<name>/byteorder`) and the older
plain one, both as `torch/serialization.py` writes them.
"""

from pathlib import Path
from typing import Any

from hoi_retarget.errors import ReadError
from hoi_retarget.files.array_pickle import ARRAYS, LEGACY_MAGIC, Storages, parse_legacy_torch
from hoi_retarget.files.reading import Archive
from hoi_retarget.files.safe_pickle import RefusedError, Unpickler, plain, refusals

_PICKLE = b"\x80"
_RESAVE = "Save plain tensors again with torch.save(tensor, path) where it was made, or download it again."


def parse_torch(content: bytes, path: Path) -> Any:
    """Return the value of a torch file: tensors as read-only arrays, in plain containers.

    bfloat16 becomes float32; every other type keeps its own. `path` is only named in errors. Raises `ReadError` where
    the file is damaged, or holds anything but tensors, arrays, numbers, text, dictionaries, lists, tuples and None.
    """
    if not content:
        raise ReadError(f"{path}: the file is empty, expected a torch file. Download it again.")
    with refusals(path, _RESAVE):
        if content.startswith(b"PK"):
            return plain(_parse_archive(content))
        if content.startswith(_PICKLE) and LEGACY_MAGIC in content[:32]:
            return plain(parse_legacy_torch(content)[0])
    if content.startswith(_PICKLE) and content.endswith(b"."):
        raise ReadError(
            f"{path}: not a torch file but a plain Python pickle, {_first_refusal(content)}. "
            "Save plain tensors with torch.save(tensor, path) where it was made."
        )
    raise ReadError(
        f"{path}: not a torch file: it starts with {content[:8]!r}, expected a zip archive "
        f"(torch >= 1.6) or torch's older format. {_RESAVE}"
    )


def _first_refusal(content: bytes) -> str:
    """Return the reason to refuse a plain pickle: its first import, where it has one."""
    try:
        Unpickler(content, {}).next()
    except RefusedError as error:
        return str(error)
    return "refused: it could run code"


def _parse_archive(content: bytes) -> Any:
    try:
        entries = dict(Archive(content, stored=True))
    except ValueError as error:
        raise RefusedError(str(error)) from error
    prefix = _archive_prefix(entries)
    # Archives from before torch 2.1 do not say; they are little endian on all machines in use.
    order = entries.get(f"{prefix}/byteorder", b"little")
    if order not in (b"little", b"big"):
        raise RefusedError(f"its byte order is {order[:16]!r}, expected b'little' or b'big'")
    storages = Storages()
    value = Unpickler(entries[f"{prefix}/data.pkl"], ARRAYS, refer=storages.refer).next()
    for key, storage in storages.items():
        raw = entries.get(f"{prefix}/data/{key}")
        if raw is None:
            raise RefusedError(f"a tensor's storage {key[:80]!r} is not in the archive")
        if storage.size > len(raw):
            raise storage.refused(f"the archive has {len(raw)} bytes for it")
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
