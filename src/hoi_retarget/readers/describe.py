"""Says what a file is and what it holds, before anything is retargeted; plain facts, nothing printed."""

import io
import shlex
import struct
import warnings
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError, BodyModelError, ClipError, GeometryError, ReadError
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.files.source_file import FOLDER, SELECTION, SourceFile
from hoi_retarget.files.torch_file import parse_torch
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINTS, PARTS
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import load
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers import (
    READERS,
    SUFFIXES,
    can_be_clip,
    intermimic,
    intermimic_objects,
    own_layout,
    reader_of,
    recordings_below,
    select,
    why_no_clip,
)
from hoi_retarget.readers.body_parameters import TITLES
from hoi_retarget.readers.intermimic_objects import geometry_of
from hoi_retarget.readers.object_files import NUMPY_ERRORS
from hoi_retarget.readers.open import open_clip
from hoi_retarget.readers.reader import Reader
from hoi_retarget.readers.upright import standing_axis

MOTION = "hoi-retarget-motion"
_SHOWN = 12  # Names of clips that are listed.
UNKNOWN = "unknown"
UP_AXIS = "z, by the format"
FLOOR_TOLERANCE = 0.3
"""[m]; the lowest joint is that near the floor in most frames of any recording."""

# The last two: an entry that is no array at all, and strings of characters that do not exist.
_ARCHIVE_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    KeyError,
    NotImplementedError,
    RuntimeError,
    AttributeError,
    SystemError,
)


@dataclass(frozen=True)
class ObjectFacts:
    """What is known of one object."""

    name: str
    moved: float | None
    """Largest distance from where it was first [m]; None where it could not be read."""
    lowest: float | None
    """Height of its lowest point over all frames [m]; None without geometry."""
    geometry: str
    """The file of its shape, or what is missing and how to add it."""
    has_geometry: bool


@dataclass(frozen=True)
class ContactFacts:
    """How often one part touches one object."""

    part: str
    object: str
    frames: int
    segments: int
    """Contiguous runs of frames."""


@dataclass(frozen=True)
class Inspection:
    """What a file is, what it holds, what is missing, and what to run."""

    path: str
    format: str
    description: str
    frames: int = 0
    fps: float | None = None
    """Frames a second."""
    fps_stated: bool = False
    """Whether the file states its rate; otherwise its format implies it."""
    skeleton: str = ""
    up_axis: str = ""
    """Which way is up; what contradicts it is in `warnings`."""
    lowest_joint: float | None = None
    """[m]"""
    height: float | None = None
    """The person's standing height, estimated from the skeleton [m]."""
    objects: tuple[ObjectFacts, ...] = ()
    contacts: tuple[ContactFacts, ...] = ()
    contacts_from: str = ""
    """Where contacts come from, where the source does not label them all."""
    label_values: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    """What looks wrong but does not stop retargeting."""
    problems: tuple[str, ...] = ()
    """Why the file cannot be retargeted as it is."""
    missing: tuple[str, ...] = ()
    """What has to be added, and how."""
    command: str = ""
    """What to run next; empty where nothing can be."""
    result: Motion | None = None
    """The motion, where the file is a result."""


@dataclass(frozen=True, eq=False)
class _Item:
    """One object's columns."""

    name: str
    positions: Float[np.ndarray, "T 3"]
    quats: Float[np.ndarray, "T 4"]
    labels: Float[np.ndarray, "T 52"]


def inspect(path: Path, **reading: Any) -> Inspection:
    """Return what is in a file or a folder; neither it nor its objects need to be complete.

    Args:
        path: Any file, or a folder that is a recording.
        reading: What it would be read with, as `recordings.open_clip` takes it; what is not given counts as missing.

    Raises:
        ReadError: The file is missing or damaged.
    """
    file = SourceFile(path)
    if file.suffix == FOLDER and not can_be_clip(path):
        return _inspect_folder(path, reading)
    reader = reader_of(file) if file.suffix in SUFFIXES else None
    if reader is not None and reader.outline is not None:
        return _inspect_source(file, reader, reading)
    if reader is own_layout.READER and own_layout.holds(file):
        facts = _inspect_own(path, reading)
    else:
        facts = _described(path, reading.get("objects"), reading.get("object_name"))
    if facts.format not in READERS or facts.problems or facts.missing:
        return facts
    # All is there: what only the whole clip shows is asked too.
    try:
        clip = open_clip(path, **reading)
    except (ClipError, ReadError, GeometryError, ArgumentError) as error:
        return replace(facts, problems=(str(error),), command="")
    if reader is own_layout.READER:  # What was found is told, too.
        facts = _with_clip(facts, clip)
    return _with_doubts(facts, clip)


def _with_doubts(facts: Inspection, clip: Clip) -> Inspection:
    """Return the facts with what speaks against a clip, as warnings."""
    return replace(facts, warnings=(*facts.warnings, *map(str, clip.source.warnings)))


def _described(path: Path, objects: Path | None, object_name: str | None) -> Inspection:
    content = read_bytes(path)
    if path.suffix.lower() == ".npz":
        return _inspect_archive(path, content)
    if content and not content.startswith((b"PK", b"\x80")):
        return _unknown(path, f"a file of {len(content)} bytes that is neither a torch file nor a result")
    value = parse_torch(content, path)
    if isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] == intermimic.COLUMNS:
        return _inspect_single(path, value, objects, object_name)
    if isinstance(value, dict) and intermimic_objects.is_multi_object(value):
        return _inspect_multi(path, value, objects)
    if isinstance(value, np.ndarray):
        shape = f"a torch file with one tensor of shape {value.shape}"
        known = f": {intermimic.describe_columns(value.shape[1])}" if value.ndim == 2 else ""
        return _unknown(path, shape + known)
    return _unknown(path, f"a torch file that holds {intermimic.describe_other(value)}")


def _unknown(path: Path, description: str) -> Inspection:
    problem = (
        f"No reader fits. Supported: {', '.join(READERS)}. docs/sources.md tells what each reads, and how to "
        "write a clip of your own."
    )
    return Inspection(str(path), UNKNOWN, description, problems=(problem,))


# InterMimic's clip of one object


def _inspect_single(path: Path, value: np.ndarray, objects: Path | None, object_name: str | None) -> Inspection:
    name = object_name or intermimic.name_in_file_name(path)
    facts = Inspection(
        str(path),
        intermimic.FORMAT,
        "InterMimic clip of one person and one object",
        frames=len(value),
        fps=intermimic.FPS,
        notes=(f"Licence of the data: {intermimic.LICENCE}.",),
    )
    try:
        matrix = intermimic.matrix_of(value, path)
        first = intermimic.leading_zero_frames(matrix)
        intermimic.check(path, matrix, first)
        intermimic.check_hands(path, intermimic.split(matrix[first:]).joint_positions, first)
    except (ClipError, ReadError) as error:
        facts = replace(facts, problems=(str(error),))
    usable = _usable_rows(value)
    facts = replace(facts, notes=(*facts.notes, *_row_notes(value, usable)))
    if usable.any():
        recording = intermimic.split(value[usable].astype(float))
        item = _Item(name or "", recording.object_positions, recording.object_quats, recording.joint_labels)
        facts = _with_scene(facts, recording.joint_positions, [item], objects)
        if recording.late_fingers:
            facts = replace(
                facts, notes=(*facts.notes, "Finger positions stand three places late; the reader puts them right.")
            )
    if name is None:
        facts = replace(facts, missing=("the object's name: pass --object NAME", *facts.missing))
    return _with_command(facts, path, objects, object_name or ("NAME" if name is None else None))


def _usable_rows(value: np.ndarray) -> Bool[np.ndarray, "T"]:
    """Return which frames hold numbers that can be computed with."""
    if value.dtype.kind not in "fiu" or value.shape[1] == 0:
        return np.zeros(len(value), dtype=bool)
    sound = (np.abs(value.astype(float)) <= intermimic.LARGEST_VALUE).all(axis=1)
    return np.asarray(sound & value.any(axis=1))


def _row_notes(value: np.ndarray, usable: Bool[np.ndarray, "T"]) -> tuple[str, ...]:
    left_out = len(value) - int(usable.sum())
    return (f"{left_out} frame(s) are zero or hold no usable numbers; figures are of the others.",) if left_out else ()


# InterMimic's dictionary of several objects


def _inspect_multi(path: Path, value: dict, objects: Path | None) -> Inspection:
    data, names = value["data"], tuple(value["objects"])
    usable = _usable_rows(data)
    facts = Inspection(
        str(path),
        intermimic_objects.FORMAT,
        f"InterMimic clip of one person and {len(names)} object(s)",
        frames=len(data),
        fps=intermimic.FPS,
        notes=(
            f"Licence of the data: {intermimic_objects.licence_of(value)}.",
            *_row_notes(data, usable),
            *intermimic_objects.content_notes(value, names),
        ),
    )
    if usable.any():
        rows = data[usable].astype(float)
        items = [
            _Item(item.name, item.positions, item.quats, item.joint_labels)
            for item in intermimic_objects.objects_of(rows, names)
        ]
        bodies = intermimic.FIELDS["body positions"]
        positions = rows[:, bodies].reshape(-1, len(JOINTS), 3)[:, list(intermimic.JOINT_ORDER)]
        facts = _with_scene(facts, positions, items, objects)
    return _with_command(_with_problems(facts, path, data, names), path, objects, None)


def _with_problems(facts: Inspection, path: Path, data: np.ndarray, names: tuple[str, ...]) -> Inspection:
    """Return the facts with what the layout's reader refuses."""
    matrix = data.astype(float)
    first = intermimic.leading_zero_frames(matrix)
    try:
        intermimic_objects.check(path, matrix, names, first)
        positions, _, _ = intermimic_objects.person_of(matrix[first:], path)
        intermimic.check_hands(path, positions, first)
    except ClipError as error:
        return replace(facts, problems=(*facts.problems, str(error)))
    return facts


# Clips in the layout of our own


def _inspect_own(path: Path, reading: Mapping[str, Any]) -> Inspection:
    facts = Inspection(str(path), own_layout.FORMAT, "a clip in the layout of this project")
    try:
        clip = own_layout.read(path, **{name: reading.get(name) for name in ("objects", "object_name", "body_models")})
    except (GeometryError, BodyModelError) as error:
        return _lacking(facts, path, reading, error)
    except (ClipError, ReadError) as error:
        return replace(facts, problems=(str(error),))
    people = "" if len(clip.people) == 1 else f" of {len(clip.people)} people"
    facts = replace(
        facts,
        frames=clip.frames,
        fps=clip.fps,
        fps_stated=True,
        skeleton=f"{len(JOINTS)} joints{people}, {_given_as(clip)}",
        up_axis="z, as the file says",
        contacts_from="the file" if clip.contacts else "none in the file; found from distances",
        notes=(f"Licence of the data: {clip.source.licence or 'not stated'}.",),
    )
    return replace(_with_clip(facts, clip), command=_run_command(path, reading))


def _given_as(clip: Clip) -> str:
    """Return what the joints of a clip in our own layout come from."""
    shapes = [person.shape for person in clip.people if person.shape is not None]
    if not shapes:
        return "positions and rotations"
    title = TITLES[shapes[0].model.family]
    genders = " and ".join(dict.fromkeys(shape.model.gender for shape in shapes))
    return f"from parameters of {title} {genders}, {len(shapes[0].betas)} betas"


def _with_clip(facts: Inspection, clip: Clip) -> Inspection:
    """Return the facts with what a clip that could be read holds."""
    described = tuple(_describe_track(track) for track in clip.objects)
    contacts = (
        # Parts of others than the first person are called as in contact edits.
        _describe_contact(
            track.active,
            f"p{track.person}.{track.part}" if track.person else track.part,
            clip.objects[track.object].name,
        )
        for track in clip.contacts
    )
    doubts = (doubt for person in clip.people for doubt in _doubts(person.joint_positions, described))
    return replace(
        facts,
        lowest_joint=min(float(person.joint_positions[..., 2].min()) for person in clip.people),
        height=float(np.mean([person.height for person in clip.people])),
        objects=described,
        contacts=tuple(contacts),
        notes=tuple(dict.fromkeys((*facts.notes, *clip.source.notes))),
        warnings=tuple(dict.fromkeys(doubts)),
    )


def _describe_track(track: ObjectTrack) -> ObjectFacts:
    geometry = track.geometry
    of = f", {len(geometry.faces)} triangles" if geometry.faces is not None else ""
    found = f"found: {geometry.mesh_path or f'in the file, {len(geometry.points)} points{of}'}"
    return ObjectFacts(track.name, _moved(track.positions), float(track.lowest.min()), found, True)


# Facts of a scene


def _with_scene(
    facts: Inspection, positions: Float[np.ndarray, "T 52 3"], items: list[_Item], objects: Path | None
) -> Inspection:
    # A height needs positions only; these rotations are never looked at.
    person = Person("person", positions, np.tile(se3.IDENTITY_QUAT, (*positions.shape[:2], 1)))
    described = tuple(_describe_object(item, objects) for item in items)
    contacts = (
        _describe_contact(intermimic.part_active(item.labels, part), part, item.name)
        for item in items
        for part in PARTS
    )
    labels = np.unique(np.concatenate([item.labels for item in items]))
    absent = [
        f"geometry of {item.name or 'the object'}: {item.geometry}" for item in described if not item.has_geometry
    ]
    return replace(
        facts,
        skeleton=f"{len(JOINTS)} joints of SMPL-X without jaw and eyes, positions and rotations",
        up_axis=UP_AXIS,
        lowest_joint=float(positions[..., 2].min()),
        height=person.height,
        objects=described,
        contacts=tuple(contacts),
        label_values=tuple(float(label) for label in labels[:20]),
        warnings=_doubts(positions, described),
        missing=(*facts.missing, *absent),
    )


def _doubts(positions: Float[np.ndarray, "T 52 3"], objects: Iterable[ObjectFacts]) -> tuple[str, ...]:
    """Return what speaks against z being up and the floor being at 0.

    A person who bends has the head beside the pelvis, but hardly ever beside the feet.
    """
    doubts: tuple[str, ...] = ()
    axis = standing_axis(positions)
    if axis != "z":
        doubts += (
            f"z is up by the format, but from feet to head it is farthest along {axis} in most frames: turn the "
            "recording if the person does not lie.",
        )
    lowest = float(np.median(positions[..., 2].min(axis=1)))
    if abs(lowest) > FLOOR_TOLERANCE:
        doubts += (f"The floor should be at 0, but the lowest joint is mostly at {lowest:.2f} m: shift the recording.",)
    sunk = [item for item in objects if item.lowest is not None and item.lowest < -FLOOR_TOLERANCE]
    doubts += tuple(f"{item.name or 'The object'} reaches {item.lowest:.2f} m, below the floor at 0." for item in sunk)
    return doubts


def _describe_object(item: _Item, objects: Path | None) -> ObjectFacts:
    moved = _moved(item.positions)
    if objects is None:
        return ObjectFacts(item.name, moved, None, "missing, pass --objects DIR", False)
    try:
        geometry = geometry_of(objects, item.name)
    except GeometryError as error:
        return ObjectFacts(item.name, moved, None, f"missing: {error}", False)
    lowest = None
    lengths = np.linalg.norm(item.quats, axis=1)
    if (lengths > 0.99).all():
        track = ObjectTrack(item.name, item.positions, item.quats / lengths[:, None], geometry)
        lowest = float(track.lowest.min())
    found = f"found: {geometry.mesh_path}" if geometry.mesh_path else f"found: {len(geometry.points)} surface points"
    return ObjectFacts(item.name, moved, lowest, found, True)


def _describe_contact(active: Bool[np.ndarray, "T"], part: str, name: str) -> ContactFacts:
    begins = active & ~np.concatenate([[False], active[:-1]])
    return ContactFacts(part, name, int(active.sum()), int(begins.sum()))


def _with_command(facts: Inspection, path: Path, objects: Path | None, object_name: str | None) -> Inspection:
    if facts.problems:
        return facts
    words = ["hoi-retarget", "run", str(path), "--objects", str(objects or "DIR")]
    words += ["--object", object_name] if object_name else []
    return replace(facts, command=shlex.join([*words, "--out", "out"]))


# Folders of recordings


def _inspect_folder(path: Path, reading: Mapping[str, Any]) -> Inspection:
    found = recordings_below(path)
    if not found:
        problem = f"There is no clip in it or below. {why_no_clip(path)}"
        return Inspection(str(path), UNKNOWN, "a folder", problems=(problem,))
    kinds = Counter(map(_format_of, found))
    counted = ", ".join(f"{count} {name}" for name, count in kinds.most_common())
    names = [str(clip.relative_to(path)) for clip in found[:_SHOWN]]
    shown = f"{', '.join(names)}{', ...' if len(found) > _SHOWN else ''}"
    words = ["hoi-retarget", "batch", str(path)]
    for name in ("objects", "body_models"):
        if reading.get(name):
            words += [f"--{name.replace('_', '-')}", str(reading[name])]
    return Inspection(
        str(path),
        "folder",
        f"{len(found)} recording{'s' if len(found) > 1 else ''}: {counted}",
        notes=(f"Recordings in it: {shown}",),
        command=shlex.join([*words, "--out", "out"]),
    )


def _format_of(path: Path) -> str:
    try:
        return reader_of(SourceFile(path)).format
    except ReadError:
        return "unreadable"


# Recordings as their sources give them


def _inspect_source(file: SourceFile, reader: Reader, reading: Mapping[str, Any]) -> Inspection:
    assert reader.outline is not None, "asked before"
    names = reader.clips_in(file)
    if len(names) > 1 and file.selection is None:
        first = shlex.join(["hoi-retarget", "inspect", f"{file.name}{SELECTION}{names[0]}"])
        shown = f"{', '.join(names[:_SHOWN])}{', ...' if len(names) > _SHOWN else ''}"
        notes = (f"Clips in it: {shown}", f"One of them: {first}")
        return Inspection(str(file.name), reader.format, f"{len(names)} clips in one recording", notes=notes)
    select(file, reader)
    try:
        outline = reader.outline(file)
    except ClipError as error:
        return Inspection(str(file.name), reader.format, "a recording that cannot be used", problems=(str(error),))
    facts = Inspection(
        str(file.name),
        reader.format,
        outline.description,
        frames=outline.frames,
        fps=outline.fps,
        fps_stated=outline.fps_stated,
        skeleton=outline.skeleton,
        up_axis=outline.up_axis,
        objects=tuple(ObjectFacts(name, None, None, "not read", False) for name in outline.objects),
        contacts_from=outline.contacts,
        notes=(f"Licence of the data: {outline.licence}.", *outline.notes),
    )
    try:
        clip = open_clip(file.name, **reading)
    except (GeometryError, BodyModelError) as error:
        return _lacking(facts, file.name, reading, error)
    except (ClipError, ReadError, ArgumentError) as error:
        return replace(facts, problems=(str(error),))
    return _with_doubts(replace(_with_clip(facts, clip), command=_run_command(file.name, reading)), clip)


def _lacking(
    facts: Inspection, path: Path, reading: Mapping[str, Any], error: GeometryError | BodyModelError
) -> Inspection:
    """Return the facts with what a recording lacks, and the command with it."""
    needed = "body_models" if isinstance(error, BodyModelError) else "objects"
    command = _run_command(path, {**reading, needed: reading.get(needed) or "DIR"})
    return replace(facts, missing=(str(error),), command=command)


def _run_command(path: Path, reading: Mapping[str, Any]) -> str:
    """Return the command that retargets a recording, read with the same."""
    options = {"object_name": "--object"}
    words = ["hoi-retarget", "run", str(path)]
    for name, value in reading.items():
        if value is not None and value != "auto":
            words += [options.get(name, f"--{name.replace('_', '-')}"), str(value)]
    return shlex.join([*words, "--out", "out"])


# Our own results


def _inspect_archive(path: Path, content: bytes) -> Inspection:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist()]
        if "schema" not in names:
            return _unknown(path, f"a .npz archive of other arrays: {', '.join(map(ascii, names[:10]))[:400]}")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # numpy warns of some damaged headers before it refuses them.
            result = load(path)
    except (*_ARCHIVE_ERRORS, *NUMPY_ERRORS) as error:
        raise ReadError(f"{path}: not a readable .npz archive ({error}). Write it again.") from error
    return Inspection(
        str(path),
        MOTION,
        f"a result of hoi-retarget for the robot {result.robot}",
        frames=result.frames,
        fps=result.fps,
        fps_stated=True,
        skeleton=f"{len(result.joint_names)} robot joints and a free root",
        up_axis=UP_AXIS,
        height=result.human_height,
        objects=tuple(
            ObjectFacts(name, _moved(result.object_pos[:, index]), None, "not stored in results", False)
            for index, name in enumerate(result.object_names)
        ),
        contacts=tuple(_motion_contacts(result)),
        result=result,
    )


def _moved(positions: Float[np.ndarray, "T 3"]) -> float:
    with np.errstate(over="ignore", invalid="ignore"):  # A damaged result may hold any finite number.
        return float(np.linalg.norm(positions - positions[:1], axis=1).max(initial=0.0))


def _motion_contacts(result: Motion) -> Iterable[ContactFacts]:
    for column, link in enumerate(result.contact_links):
        for index, name in enumerate(result.object_names):
            yield _describe_contact(
                result.contact_flags[:, column] & (result.contact_object[:, column] == index), link, name
            )
