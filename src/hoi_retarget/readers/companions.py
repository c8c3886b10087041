"""What a recording's main file needs beside it: other files of its source, found in the source's own tree."""

import json
from pathlib import Path
from typing import Any

from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.readers.fields import Fields
from hoi_retarget.readers.reader import ReadOptions

_FARTHEST = 5
"""Folders above the recording that are searched for a folder of the source's tree."""


def json_table(file: SourceFile, path: Path) -> Fields:
    """Return the object in a JSON file that belongs to a recording as fields; raises `ReadError`."""
    return Fields(path, json_values(file, path))


def json_values(file: SourceFile, path: Path) -> dict[str, Any]:
    """Return the object in a JSON file that belongs to a recording; raises `ReadError`."""
    try:
        values = json.loads(file.read(path))
    except (ValueError, RecursionError) as error:
        raise ReadError(f"{path}: not readable as JSON ({error}). Download it again.") from error
    if not isinstance(values, dict):
        raise ReadError(f"{path}: it holds a {type(values).__name__}, expected an object. Download it again.")
    return values


def folder_above(path: Path, *steps: str) -> Path | None:
    """Return the nearest folder of that name beside the recording or one of the folders that it is in; None without."""
    for folder in path.resolve().parents[:_FARTHEST]:
        if folder.joinpath(*steps).is_dir():
            return folder.joinpath(*steps)
    return None


def folder_of_tree(path: Path, *steps: str, beside: str = "") -> Path:
    """Return the same, and without one where it should be: beside a folder of that name that the recording is in."""
    above = path.resolve().parents
    place = next((folder.parent for folder in above if folder.name == beside), above[0])
    return folder_above(path, *steps) or place.joinpath(*steps)


def refuse_object_name(file: SourceFile, options: ReadOptions, names: str) -> None:
    """Raise `ArgumentError` where an object's name is given, although the recording tells the names of its objects."""
    if options.object_name is not None:
        raise ArgumentError(
            f"{file.name}: --object {options.object_name} is for clips that do not name their object; this one "
            f"names {names}. Leave the option out."
        )
