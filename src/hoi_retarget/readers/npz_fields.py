"""The arrays of the `.npz` files that a recording is made of, and whether they are of the same frames."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hoi_retarget.clip.clip import MINIMUM_FRAMES
from hoi_retarget.errors import ClipError, ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.npz import object_or_array
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.readers.fields import Fields


def npz_fields(file: SourceFile, path: Path) -> Fields:
    """Return what an `.npz` file holds as fields; otherwise as `npz_values`."""
    return Fields(path, npz_values(file, path))


def npz_values(file: SourceFile, path: Path) -> dict[str, Any]:
    """Return what an `.npz` file holds by name; raises `ReadError`.

    Args:
        file: the recording that it belongs to.
        path: the file, which may be the recording itself.
    """
    try:
        members = file.members if path == file.path else npz.members(file.read(path))
    except ValueError as error:
        raise ReadError(f"{path}: not a readable .npz file ({error}). Download it again.") from error
    return {name: object_or_array(path, name, content) for name, content in members.items()}


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
