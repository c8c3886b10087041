"""Values of a source's files by name, each checked as it is taken, and the search for files in the source's tree."""

import difflib
import json
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.clip.clip import MINIMUM_FRAMES
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ClipError, ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.source_file import SELECTION, SourceFile
from hoi_retarget.numerics.arrays import describe_frames

MAX_VALUE = 1e4  # Of any number; metres, radians and parameters of bodies stay below.


def other_shape(values: np.ndarray, shape: tuple[int | str, ...]) -> str:
    """Return that an array has another shape than the expected one, in words; empty where it fits.

    Numbers in `shape` must agree; letters stand for any length, the same letter for the same one.
    """
    lengths: dict[str, int] = {}
    fits = len(shape) == values.ndim and all(
        have == (size if isinstance(size, int) else lengths.setdefault(size, have))
        for size, have in zip(shape, values.shape, strict=True)
    )
    expected = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
    return "" if fits else f"has shape {values.shape}, expected {expected}"


class Fields:
    """A table of a file's values; each is checked for its kind, shape and size as it is taken."""

    def __init__(self, path: Path, values: Mapping[str, Any], *, within: str = "") -> None:
        """Take the values of a file; `within` says where in the file they stand."""
        self.path, self._values, self._within = path, values, within

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def get(self, name: str) -> Any:
        """Return a value as it is stored; None where there is none."""
        return self._values.get(name)

    def array(self, name: str, shape: tuple[int | str, ...], meaning: str) -> np.ndarray:
        """Return an array of finite numbers in double precision, of a shape as for `other_shape`.

        Raises `ClipError`, which says `meaning`, where it is missing, of another kind or shape, or has numbers that are
        not finite or absurdly large.
        """
        try:
            values = np.asarray(self._value(name, meaning))
        except ValueError as error:  # Lists of different lengths.
            raise ClipError(f"{self._where(name, meaning)} is no array ({error}). Download it again.") from error
        if values.dtype.kind not in "fiub":
            raise ClipError(f"{self._where(name, meaning)} holds {values.dtype}, expected numbers. Download it again.")
        if other := other_shape(values, shape):
            raise ClipError(f"{self._where(name, meaning)} {other}.")
        values = values.astype(float)
        bad = ~(np.abs(values) <= MAX_VALUE)
        if bad.any():
            rows = describe_frames(np.unique(np.argwhere(bad)[:, 0])) if values.ndim else "its only one"
            raise ClipError(
                f"{self._where(name, meaning)} holds numbers that are not finite or above {MAX_VALUE:g} in "
                f"{rows}. Cut them off, or convert the recording again."
            )
        return values

    def rows(self, name: str, frames: int | str, width: int, meaning: str) -> np.ndarray:
        """Return an array with so many numbers in a row for each frame, stored so or three by three.

        `name`: in the file; `frames`: their number, or a letter for any; `width`: numbers in a row; `meaning`: for
        errors.
        """
        stored = self.get(name)
        if isinstance(stored, np.ndarray) and stored.shape[1:] == (width // 3, 3):
            values = self.array(name, (frames, width // 3, 3), meaning)
            return values.reshape(len(values), width)
        return self.array(name, (frames, width), meaning)

    def text(self, name: str, meaning: str) -> str:
        """Return a text; raises `ClipError`."""
        value = self._value(name, meaning)
        if isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind in "US":
            value = value.reshape(()).item()
            value = value.decode("utf-8", "backslashreplace") if isinstance(value, bytes) else value
        if not isinstance(value, str):
            raise ClipError(f"{self._where(name, meaning)} is {type(value).__name__}, expected a text.")
        return value

    def table(self, name: str, meaning: str) -> "Fields":
        """Return a dictionary in it as fields of their own; raises `ClipError`."""
        value = self._value(name, meaning)
        if not isinstance(value, dict):
            raise ClipError(f"{self._where(name, meaning)} is {type(value).__name__}, expected a dictionary.")
        return Fields(self.path, value, within=f"{self._within}{name}/")

    def _value(self, name: str, meaning: str) -> Any:
        if name not in self._values:
            known = [str(key) for key in self._values]
            close = difflib.get_close_matches(name, known, n=1)
            hint = f"Did you mean {close[0]!r}?" if close else f"It has {', '.join(sorted(known)[:20]) or 'nothing'}."
            raise ClipError(f"{self._where(name, meaning)} is missing. {hint} Download the recording again.")
        return self._values[name]

    def _where(self, name: str, meaning: str) -> str:
        return f"{self.path}: {self._within}{name}, {meaning},"


_MAX_LEVELS_UP = 5  # Folders above the recording that are searched for a folder of the source's tree.


class _Arrays(Mapping[str, Any]):
    """The arrays of an `.npz` file, each read when it is asked for: much of a file is of no use here."""

    def __init__(self, path: Path, members: npz.Members) -> None:
        self._path, self._members = path, members

    def __getitem__(self, name: str) -> Any:
        try:
            return npz.object_or_array(self._path, name, self._members[name])
        except ValueError as error:
            raise _unreadable(self._path, error) from error

    def __contains__(self, name: object) -> bool:
        return name in self._members

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)


def npz_fields(file: SourceFile, path: Path) -> Fields:
    """Return the arrays of an `.npz` file, of the recording or itself; raises `ReadError`, also later."""
    try:
        members = file.members if path == file.path else npz.Members(file.read(path))
    except ValueError as error:
        raise _unreadable(path, error) from error
    return Fields(path, _Arrays(path, members))


def _unreadable(path: Path, error: ValueError) -> ReadError:
    return ReadError(f"{path}: not a readable .npz file ({error}). Download it again.")


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
    for folder in path.resolve().parents[:_MAX_LEVELS_UP]:
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

    `frames` has each track's number by its owner; `path` is the recording, for errors.
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
