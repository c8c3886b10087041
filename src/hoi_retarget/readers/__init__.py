"""Readers of recorded interactions: one module for each source, chosen by the content of a file."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from hoi_retarget.clip import grasp_check
from hoi_retarget.clip.augment import at_rate
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.files.reading import check_file
from hoi_retarget.files.source_file import FOLDER, SELECTION, SourceFile
from hoi_retarget.readers.reader import Reader

MODULES: Mapping[str, tuple[str, ...]] = {
    "intermimic": (".pt", ".pth"),
    "intermimic_objects": (".pt", ".pth"),
    "theia": (".pt", ".pth"),
    "physhoi": (".pt", ".pth"),
    "own_layout": (".npz", FOLDER),
    "core4d": (FOLDER,),
    "cari4d": (".pth",),
    "behave": (FOLDER,),
    "intercap": (".pkl",),
    "grab": (".npz",),
    "interact": (FOLDER,),
    "hodome": (".npz",),
    "imhd": (".pkl",),
    "omomo": (".p",),
    "humoto": (".glb",),
    "parahome": (FOLDER,),
    "amass": (".npz",),
    "gvhmr": (".pt", ".npz"),
    "soma": (".npz", ".pt"),
    "hiphi": (".bvh",),
    "omnicontact": (".bvh",),
    "bvh": (".bvh",),
    "mvnx": (".mvnx",),
}
"""A reader's module, imported when it may fit -> endings of its files in small letters, or `FOLDER`."""
SUFFIXES: tuple[str, ...] = tuple(dict.fromkeys(suffix for suffixes in MODULES.values() for suffix in suffixes))
"""Endings that the file of a clip can have; `FOLDER` for clips that are folders."""

_EXPLAINING = {".pt": "intermimic", ".pth": "intermimic", ".npz": "own_layout", ".fbx": "humoto"}
"""Modules of the readers with the best explanation of a file that nobody reads."""
_UNDOCUMENTED = {
    "corolehoi": "CoRoleHOI's own files are documented nowhere, so they are not read. Two ways are open: InterAct's "
    "canonical layout, each of the two people in a folder omomo_corole/sequences_canonical/ID, and clips of two people "
    "in the layout of your own clips (docs/sources.md).",
    ".c3d": "a C3D file holds markers, not a skeleton. Solve one in the capture software and export it as BVH, or fit "
    "SMPL-X to the markers (SOMA, MoSh++) and give that as AMASS's .npz, or as a clip of your own (docs/sources.md).",
    ".tar.": "an archive is read by `hoi-retarget batch` alone, with all recordings in it. Unpack one to look at it.",
}
"""Part of a path, in small letters -> the reason why files of this kind are not read, and a way out."""
_OF_A_ROBOT = (
    "this is a robot's motion, not a clip. Use `hoi-retarget evaluate` on it, or pass --from ROBOT to retarget it to "
    "another robot."
)
_MAX_LISTED = 12  # Names of clips.


def readers(suffix: str | None = None) -> tuple[Reader, ...]:
    """Return the readers of files with an ending, or all of them, in the order in which they are asked."""
    return tuple(_reader(module) for module, suffixes in MODULES.items() if suffix is None or suffix in suffixes)


def _reader(module: str) -> Reader:
    return import_module(f"{__name__}.{module}").READER


def read_clip(path: Path, options: ReadOptions = ReadOptions()) -> Clip:
    """Return the clip in `path` as `read_recording` does."""
    return read_recording(path, options)[0]


def read_recording(path: Path, options: ReadOptions) -> tuple[Clip, Reader]:
    """Return the clip in `path`, of any supported format, as its source has it, and its reader.

    Contacts are the source's labels, none where it labels none; `open.open_clip` finds them then, and the floor.
    `FILE#NAME` is one clip of a file that holds several.

    Raises `ReadError`: the file is missing, damaged, or of no supported format; `ClipError`: its content cannot be
    used, or its grasps contradict how it is read; `GeometryError`: the object's geometry cannot be had;
    `BodyModelError`: the body model that it needs cannot be had; `ArgumentError`: the object's name is given, although
    the file tells it, or a clip is named that is not in it.
    """
    file = SourceFile(path)
    reader = reader_of(file, options.from_robot)
    select(file, reader)
    clip = at_rate(reader.read(file, options), options.fps)
    meshes = (track.geometry.file for track in clip.objects)
    others = sorted({str(path) for path in (*file.files, *meshes) if path is not None and path != file.path})
    clip = replace(clip, source=replace(clip.source, files=tuple(others)))
    return grasp_check.with_grasp_warnings(clip, reader.rotation_readings, grasps=options.grasps), reader


def reader_of(file: SourceFile, from_robot: str | None = None) -> Reader:
    """Return the reader of a file, or of a named robot's motion; raises `ReadError` where nobody reads it."""
    if not file.exists:
        raise ReadError(f"{file.name}: there is no such file. Check the path.")
    if from_robot is not None:
        return _reader("robot_motion")
    if file.suffix != FOLDER or file.clip_file.is_file():
        check_file(file.clip_file)
    fitting = readers(file.suffix)
    for reader in fitting:
        if reader.holds(file):
            return reader
    if text := undocumented(file.path) or (_reader("robot_motion").holds(file) and _OF_A_ROBOT):
        raise ReadError(f"{file.name}: {text}")
    if file.suffix in _EXPLAINING:
        return _reader(_EXPLAINING[file.suffix])
    if file.suffix == FOLDER:
        raise ReadError(f"{file.name}: {why_no_clip(file.path)}")
    if fitting:
        names = ", ".join(reader.format for reader in fitting)
        raise ReadError(
            f"{file.name}: it holds something else than clips of {names}. docs/sources.md tells the layouts."
        )
    supported = ", ".join(
        f"*{suffix} ({', '.join(reader.format for reader in readers(suffix))})" for suffix in SUFFIXES
    )
    kind = file.suffix or "without suffix"
    raise ReadError(f"{file.name}: files of type {kind!r} are not supported: {supported}.")


def undocumented(path: Path) -> str:
    """Return why the files of a data set that a path names are not read; empty where it names none of these."""
    return next((text for name, text in _UNDOCUMENTED.items() if name in str(path.absolute()).lower()), "")


def clips_in(path: Path) -> tuple[Path, ...]:
    """Return the names of all clips in a file, one where it is one clip; raises `ReadError` as `read_clip`."""
    file = SourceFile(path)
    reader = reader_of(file)
    names = reader.clips_in(file) if file.selection is None else ()
    return tuple(Path(f"{path}{SELECTION}{name}") for name in names) or (path,)


def recordings_below(folder: Path, pattern: str = "**/*", from_robot: str | None = None) -> tuple[Path, ...]:
    """Return all files and folders in a folder that fit a pattern and may be clips, as `can_be_clip` says, in order."""
    found: list[Path] = []
    for path in sorted(folder.glob(pattern)):
        # Files in a clip's own folder, right behind it in this order, are part of it.
        if not (found and path.is_relative_to(found[-1])) and can_be_clip(path, from_robot):
            found.append(path)
    return tuple(found)


def why_no_clip(folder: Path) -> str:
    """Return the reason why a folder is not one clip: missing files, where others of a format are there."""
    if text := undocumented(next(folder.glob("*.tar.*"), folder)):
        return text
    fitting = readers(FOLDER)
    for reader in fitting:
        missing = [name for name in reader.parts if not (folder / name).is_file()]
        if 0 < len(missing) < len(reader.parts):
            return f"It looks like a recording of {reader.format}, but lacks {', '.join(missing)}. Download it again."
    kinds = ", ".join(reader.format for reader in fitting)
    return f"This folder is not the recording of one clip ({kinds}). Name a clip in it."


def has_companions(path: Path) -> bool:
    """Return whether a recording may need files that are not known until it is read."""
    file = SourceFile(path)
    try:
        return reader_of(file).has_companions(file)
    except ReadError:
        return False


def select(file: SourceFile, reader: Reader) -> None:
    """Choose the only clip of a file where its name chooses none; raises `ArgumentError` where that does not do."""
    names = reader.clips_in(file)
    if file.selection is None and len(names) == 1:
        file.selection = names[0]
    if file.selection in names or (file.selection is None and not names):
        return
    if not names:
        raise ArgumentError(f"{file.name}: the file is one clip. Leave {SELECTION}{file.selection} away.")
    listing = listed(names)
    if file.selection is None:
        raise ArgumentError(
            f"{file.name}: there are {len(names)} clips in it ({listing}). Choose one: {file.path}{SELECTION}{names[0]}"
        )
    close = difflib.get_close_matches(file.selection, names, n=1)
    hint = f"Did you mean {close[0]!r}? " if close else ""
    raise ArgumentError(f"{file.name}: no clip {file.selection!r} is in it. {hint}There are {len(names)}: {listing}.")


def listed(names: Sequence[str]) -> str:
    """Return the first names of a list in words."""
    return f"{', '.join(names[:_MAX_LISTED])}{', ...' if len(names) > _MAX_LISTED else ''}"


def can_be_clip(path: Path, from_robot: str | None = None) -> bool:
    """Return whether a file or a folder may be a clip by its name, or by its content where the name says little.

    With the name of a robot, motions of robots are clips, and nothing else is.
    """
    file = SourceFile(path)
    if from_robot is not None:
        return _reader("robot_motion").holds(file)
    if file.suffix in (".pt", ".pth"):
        return True
    try:
        return any(reader.holds(file) for reader in readers(file.suffix))
    except (ReadError, OSError):
        return False
