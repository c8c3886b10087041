"""Readers of recorded interactions: one module for each source, each a function `read(path, ...) -> Clip`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from hoi_retarget.clip import Clip
from hoi_retarget.errors import ReadError
from hoi_retarget.readers import grasp_check, intermimic, intermimic_objects, own_layout
from hoi_retarget.readers.torch_file import parse_torch, read_bytes

READERS: Mapping[str, Callable[..., Clip]] = MappingProxyType(
    {module.FORMAT: module.read for module in (intermimic, intermimic_objects, own_layout)}
)
"""Format name -> `read(path, *, objects, object_name)`."""

SUFFIXES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        **{suffix: (intermimic.FORMAT, intermimic_objects.FORMAT) for suffix in (".pt", ".pth")},
        ".npz": (own_layout.FORMAT,),
    }
)
"""File name ending -> names of the formats that such a file can have; its content tells which."""


def read_clip(path: Path, *, objects: Path | None = None, object_name: str | None = None) -> Clip:
    """Return the clip in `path`, whatever supported format it has.

    Args:
        path: The recording.
        objects: Folder with `<name>/<name>.obj` of each object.
        object_name: The object's name, where the file does not tell it.

    Raises:
        ReadError: The file is missing, damaged, or of no supported format.
        ClipError: What it holds cannot be used, or its grasps contradict how it is read.
        GeometryError: The object's geometry cannot be had.
        ArgumentError: The object's name is given, although the file tells it.
    """
    if path.suffix.lower() not in SUFFIXES:
        if path.is_dir():
            raise ReadError(f"{path}: this is a folder. Name a clip in it.")
        supported = ", ".join(f"*{suffix} ({', '.join(names)})" for suffix, names in SUFFIXES.items())
        raise ReadError(f"{path}: files of type {path.suffix or 'without suffix'!r} are not supported: {supported}.")
    content = read_bytes(path)
    if path.suffix.lower() == ".npz":
        return grasp_check.checked(own_layout.clip_of(path, content, objects=objects, object_name=object_name))
    value = parse_torch(content, path)
    module = intermimic_objects if intermimic_objects.is_multi_object(value) else intermimic
    return grasp_check.checked(module.clip_of(value, path, content, objects=objects, object_name=object_name))


def can_be_clip(path: Path) -> bool:
    """Return whether a file may be a clip by its name, and where results are called alike, by what it holds."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        return False
    try:
        return suffix != ".npz" or own_layout.holds(path.read_bytes())
    except OSError:
        return False
