"""What a recording's main file needs beside it: other files of its source, found in the source's own tree."""

import json
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from hoi_retarget.clip.clip import MINIMUM_FRAMES
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ClipError, ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.source_file import SELECTION, SourceFile
from hoi_retarget.readers.fields import Fields

_FARTHEST = 5
"""Folders above the recording that are searched for a folder of the source's tree."""


class _Arrays(Mapping[str, Any]):
    """The arrays of an `.npz` file, each read when it is asked for: much of a file is of no use here."""

    def __init__(self, path: Path, members: Mapping[str, bytes]) -> None:
        self._path, self._members = path, members

    def __getitem__(self, name: str) -> Any:
        return npz.object_or_array(self._path, name, self._members[name])

    def __contains__(self, name: object) -> bool:
        return name in self._members

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)


def npz_fields(file: SourceFile, path: Path) -> Fields:
    """Return what an `.npz` file, of the recording or itself, holds as fields; raises `ReadError`, also later."""
    try:
        members = file.members if path == file.path else npz.members(file.read(path))
    except ValueError as error:
        raise ReadError(f"{path}: not a readable .npz file ({error}). Download it again.") from error
    return Fields(path, _Arrays(path, members))


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


def chosen_clip(file: SourceFile, names: Collection[str], kind: str) -> str:
    """Return the name of the clip that is selected in a file, or of its only one; raises `ReadError`."""
    first = next(iter(names))
    name = first if file.selection is None and len(names) == 1 else file.selection
    if name is None or name not in names:
        raise ReadError(
            f"{file.name}: it does not say which of its {len(names)} {kind}. Choose one: {file.path}{SELECTION}{first}"
        )
    return name


def check_frames(path: Path, frames: Mapping[str, int]) -> None:
    """Raise `ClipError` unless all tracks of a recording have equally many frames, and enough.

    Args:
        path: the recording, for errors.
        frames: whose track -> its number of frames.
    """
    listing = ", ".join(f"{owner}: {count}" for owner, count in frames.items())
    if len(set(frames.values())) > 1:
        raise ClipError(f"{path}: its files differ in their number of frames ({listing}). Download them again.")
    if min(frames.values()) < MINIMUM_FRAMES:
        raise ClipError(f"{path}: there are too few frames ({listing}); at least {MINIMUM_FRAMES} are needed.")


def refuse_object_name(file: SourceFile, options: ReadOptions, names: str) -> None:
    """Raise `ArgumentError` where an object's name is given, although the recording tells the names of its objects."""
    if options.object_name is not None:
        raise ArgumentError(
            f"{file.name}: --object {options.object_name} is for clips that do not name their object; this one "
            f"names {names}. Leave the option out."
        )
