"""Readers of recorded interactions: one module for each source, each a function `read(path, ...) -> Clip`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from hoi_retarget.clip import Clip
from hoi_retarget.errors import ReadError
from hoi_retarget.readers import intermimic

READERS: Mapping[str, Callable[..., Clip]] = MappingProxyType({intermimic.FORMAT: intermimic.read})
"""Format name -> `read(path, *, objects, object_name)`."""

SUFFIXES: Mapping[str, str] = MappingProxyType({".pt": intermimic.FORMAT, ".pth": intermimic.FORMAT})
"""File name ending -> format name."""


def read_clip(path: Path, *, objects: Path | None = None, object_name: str | None = None) -> Clip:
    """Return the clip in `path`, whatever supported format it has.

    Args:
        path: The recording.
        objects: Folder with `<name>/<name>.obj` of each object.
        object_name: The object's name, where the file does not tell it.

    Raises:
        ReadError: The file is missing, damaged, or of no supported format.
        ClipError: What it holds cannot be used.
        GeometryError: The object's geometry cannot be had.
    """
    name = SUFFIXES.get(path.suffix.lower())
    if name is None:
        supported = ", ".join(f"*{suffix} ({format_name})" for suffix, format_name in SUFFIXES.items())
        raise ReadError(f"{path}: files of type {path.suffix or 'without suffix'!r} are not supported: {supported}.")
    return READERS[name](path, objects=objects, object_name=object_name)
