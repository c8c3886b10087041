"""Results exported: the files of a format, and those beside them that say what is in it."""

from collections.abc import Mapping
from dataclasses import dataclass

from hoi_retarget.errors import ArgumentError, did_you_mean
from hoi_retarget.files import npz
from hoi_retarget.motion.contacts import contact_arrays
from hoi_retarget.motion.formats import WRITABLE, Format
from hoi_retarget.motion.formats.containers import to_json
from hoi_retarget.motion.formats.dataset import NAME as DATASET
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.resample import resample
from hoi_retarget.motion.result import Result
from hoi_retarget.motion.sidecar import describe

NAMES: tuple[str, ...] = (*WRITABLE, DATASET)
"""Names of all formats that can be written, the last of which takes many results into one folder."""


@dataclass(frozen=True)
class Exported:
    """One result in a format."""

    files: Mapping[str, bytes]
    """By file name; a folder's files with its name before them."""
    fps: float
    frames: int
    notes: tuple[str, ...]
    """What a user has to mind, a sentence each."""


def format_named(name: str) -> Format:
    """Return a format of one motion per file; raises `ArgumentError` that lists those there are."""
    if name not in WRITABLE:
        near = did_you_mean(name, NAMES)
        raise ArgumentError(f"--to {name}: there is no such format.{near} Formats: {', '.join(NAMES)}.")
    return WRITABLE[name]


def export(
    result: Result, format: Format, *, name: str, fps: float | None = None, object_name: str | None = None
) -> Exported:
    """Return a result's files in a format, with those beside them.

    Args:
        result: What to export.
        format: How.
        name: What the files are called, without suffix.
        fps: Frames a second; by default what the format's readers expect.
        object_name: Which object goes into the format's one place for it, where there are several.

    Raises:
        ArgumentError: The format knows the robot or the object not, or the rate is out of range.
        ClipError: The motion has a single frame.
        GeometryError: An object's mesh cannot be read.
    """
    motion, model = result.motion, result.model
    if format.robots and motion.robot not in format.robots:
        raise ArgumentError(
            f"--to {format.name} is for {', '.join(format.robots)}, and the result is of {motion.robot}. For this "
            f"robot: {', '.join(other.name for other in WRITABLE.values() if not other.robots)}, {DATASET}."
        )
    chosen = _object(motion, format, object_name)
    resampled = resample(motion, model, format.fps if fps is None else fps, chosen)
    contacts = contact_arrays(resampled, result.surfaces)
    assert format.write is not None
    assert format.container.encode is not None
    written = format.write(resampled)
    contents = format.container.encode({**written.values, **(contacts if format.contacts_inside else {})})
    files = {f"{name}{suffix}": content for suffix, content in contents.items()}
    if not format.contacts_inside:
        files[f"{name}.contacts.npz"] = npz.encode(contacts)
    files[f"{name}.meta.json"] = to_json(describe(result, resampled, format, written, list(files)))
    return Exported(files, resampled.fps, resampled.frames, written.notes)


def _object(motion: Motion, format: Format, name: str | None) -> int | None:
    """Return the index of the object that goes into a format's one place for it."""
    names = motion.object_names
    listing = f"Objects: {', '.join(names)}." if names else "The result has none."
    if not format.place_for_object:
        if name is not None:
            raise ArgumentError(
                f"--object {name}: the format {format.name} has no place for an object. Leave the option out."
            )
        return None
    if name is not None and name not in names:
        raise ArgumentError(f"--object {name}: the result has no such object. {listing}")
    if name is None and len(names) > 1:
        raise ArgumentError(
            f"the format {format.name} has one place for an object, and the result has {len(names)}. "
            f"Name one with --object. {listing}"
        )
    if not names:
        return None
    return 0 if name is None else names.index(name)
