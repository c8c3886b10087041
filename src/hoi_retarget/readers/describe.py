"""Facts of a file before anything is retargeted: format, content, missing parts, and the next command."""

import shlex
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget import readers as source_readers
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.read_options import ReadOptions, option_of
from hoi_retarget.errors import ArgumentError, BodyModelError, ClipError, GeometryError, MeshError, ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.source_file import FOLDER, SELECTION, SourceFile
from hoi_retarget.motion import formats
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import load
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers.intermimic import describe
from hoi_retarget.readers.open import open_clip
from hoi_retarget.readers.reader import Headline, Reader
from hoi_retarget.readers.worlds import standing_axis

MOTION = "hoi-retarget-motion"
UNKNOWN = "unknown"
FLOOR_TOLERANCE = 0.3  # [m]; the lowest joint is that near the floor in most frames of any recording.

_MOST_OBJECTS = 12  # Named of a folder.
_SHARED = (".npz", ".pt", ".pth")  # Endings of files that others write, too.


@dataclass(frozen=True)
class ObjectFacts:
    """Facts of one object."""

    name: str
    moved: float | None  # Largest distance from its first place [m]; None where it could not be read.
    lowest: float | None  # Height of its lowest point over all frames [m]; None without geometry.
    geometry: str  # The file of its shape, or the missing one and a way to add it.
    has_geometry: bool


@dataclass(frozen=True)
class ContactFacts:
    """Contact of one part with one object."""

    part: str
    object: str
    frames: int
    segments: int  # Contiguous runs of frames.


@dataclass(frozen=True)
class Inspection:
    """Facts of a file, its faults, its missing parts, and the next command."""

    path: str
    format: str
    description: str
    frames: int = 0
    fps: float | None = None  # Frames a second.
    fps_stated: bool = False  # Whether the file states its rate; otherwise its format implies it.
    skeleton: str = ""
    up_axis: str = ""  # Which way is up; what contradicts it is in `warnings`.
    lowest_joint: float | None = None  # [m]
    height: float | None = None  # The person's standing height, estimated from the skeleton [m].
    objects: tuple[ObjectFacts, ...] = ()
    contacts: tuple[ContactFacts, ...] = ()
    contacts_from: str = ""  # The origin of contacts, where the source does not label them all.
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()  # Doubts that do not stop retargeting.
    problems: tuple[str, ...] = ()  # Why the file cannot be retargeted as it is.
    missing: tuple[str, ...] = ()  # Files and options that have to be added, and how.
    command: str = ""  # To be run next; empty where nothing can be.
    result: Motion | None = None  # The motion, where the file is a result.


def inspect(path: Path, options: ReadOptions = ReadOptions()) -> Inspection:
    """Return the facts of a file or a folder; neither it nor its objects need to be complete.

    Files of options that are not given count as missing. Raises `ReadError` where the file is missing or damaged,
    `ArgumentError` where there is no clip of the name that follows the file's.
    """
    file = SourceFile(path)
    if file.suffix == FOLDER and not source_readers.can_be_clip(path, options.from_robot):
        return _describe_folder(path, options)
    robot = options.from_robot
    if robot is None and file.suffix == ".npz" and "schema" in file.array_names:
        return _describe_result(path, load(path))
    try:
        reader = (
            source_readers.reader_of(file, robot)
            if robot is not None or file.suffix in source_readers.SUFFIXES
            else None
        )
    except ReadError:
        if (motion := _describe_robot_motion(path)) is None:
            raise
        return motion
    if reader is not None and (robot is not None or file.suffix not in _SHARED or reader.holds(file)):
        return _describe_recording(file, reader, options)
    if (motion := _describe_robot_motion(path)) is not None:
        return motion
    known = ", ".join(reader.format for reader in source_readers.readers())
    problem = source_readers.undocumented(path) or (
        f"No reader fits. Supported: {known}. docs/sources.md tells what each reads, and how to write your own clip."
    )
    return Inspection(str(path), UNKNOWN, _content(file), problems=(problem,))


def _content(file: SourceFile) -> str:
    """Return the content of a file that is neither a recording nor a result; raises `ReadError` for a damaged one."""
    if file.suffix in (".pt", ".pth"):
        return f"a torch file that holds {describe(file.torch)}"
    if file.suffix != ".npz":
        return f"a file of {len(file.content)} bytes that is neither a torch file nor a result"
    try:
        names = list(npz.Members(file.content))
    except ValueError as error:
        raise ReadError(f"{file.path}: not a readable .npz file ({error}). Write it again.") from error
    return f"a .npz archive of other arrays: {', '.join(map(ascii, names[:10]))[:400]}"


def _describe_recording(file: SourceFile, reader: Reader, options: ReadOptions) -> Inspection:
    names = reader.clips_in(file)
    if len(names) > 1 and file.selection is None:
        first = shlex.join(["hoi-retarget", "inspect", f"{file.name}{SELECTION}{names[0]}"])
        notes = (f"Clips in it: {source_readers.listed(names)}", f"One of them: {first}")
        return Inspection(str(file.name), reader.format, f"{len(names)} clips in one recording", notes=notes)
    source_readers.select(file, reader)
    try:
        outline = reader.outline(file, ReadOptions(from_robot=options.from_robot))
    except (ClipError, ReadError) as error:
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
        notes=(f"Licence of the data: {outline.licence or 'not stated'}.", *outline.notes),
    )
    try:
        clip = open_clip(file.name, options)
    except MeshError as error:
        return replace(facts, problems=(str(error),))
    except (GeometryError, BodyModelError) as error:
        needed: dict[str, str | Path] = {"body_models" if isinstance(error, BodyModelError) else "objects": Path("DIR")}
        if "" in outline.objects:
            needed["object_name"] = "NAME"
        given = {name: getattr(options, name) or stand_in for name, stand_in in needed.items()}
        return replace(facts, missing=(str(error),), command=_command("run", file.name, replace(options, **given)))
    except (ClipError, ReadError, ArgumentError) as error:
        return replace(facts, problems=(str(error),))
    return replace(_with_clip(facts, clip), command=_command("run", file.name, options))


def _with_clip(facts: Inspection, clip: Clip) -> Inspection:
    """Return the facts with those of the clip, which could be read."""
    described = tuple(_describe_object(track) for track in clip.objects)
    texts = (text for person in clip.people for text in _contradictions(person.joint_positions, described))
    return replace(
        facts,
        lowest_joint=min(float(person.joint_positions[..., 2].min()) for person in clip.people),
        height=float(np.mean([person.height for person in clip.people])),
        objects=described,
        contacts=tuple(
            # Parts of others than the first person are called as in contact edits.
            _describe_contact(
                f"p{track.person}.{track.part}" if track.person else track.part,
                clip.objects[track.object].name,
                track.active,
            )
            for track in clip.contacts
        ),
        notes=tuple(dict.fromkeys((*facts.notes, *clip.source.notes))),
        warnings=(*dict.fromkeys(texts), *map(str, clip.source.warnings)),
    )


def _describe_object(track: ObjectTrack) -> ObjectFacts:
    geometry = track.geometry
    of = f", {len(geometry.faces)} triangles" if geometry.faces is not None else ""
    found = f"found: {geometry.mesh_path or f'with the clip, {len(geometry.points)} points{of}'}"
    return ObjectFacts(track.name, _moved(track.positions), float(track.lowest.min()), found, True)


def _contradictions(positions: Float[np.ndarray, "T 52 3"], objects: Iterable[ObjectFacts]) -> tuple[str, ...]:
    """Return contradictions of z being up and the floor being at 0.

    A person who bends has the head beside the pelvis, but hardly ever beside the feet.
    """
    texts: tuple[str, ...] = ()
    axis = standing_axis(positions)
    if axis != "z":
        texts += (
            f"z is up by the format, but from feet to head it is farthest along {axis} in most frames: turn the "
            "recording if the person does not lie.",
        )
    lowest = float(np.median(positions[..., 2].min(axis=1)))
    if abs(lowest) > FLOOR_TOLERANCE:
        texts += (f"The floor should be at 0, but the lowest joint is mostly at {lowest:.2f} m: shift the recording.",)
    sunk = [item for item in objects if item.lowest is not None and item.lowest < -FLOOR_TOLERANCE]
    texts += tuple(f"{item.name or 'The object'} reaches {item.lowest:.2f} m, below the floor at 0." for item in sunk)
    return texts


def _describe_folder(path: Path, options: ReadOptions) -> Inspection:
    robot = options.from_robot
    found = source_readers.recordings_below(path, from_robot=robot)
    if not found and (motion := _describe_robot_motion(path)) is not None:
        return motion
    if not found:
        problem = f"There is no clip in it or below. {source_readers.why_no_clip(path)}"
        return Inspection(str(path), UNKNOWN, "a folder", problems=(problem,))
    counted = ", ".join(
        f"{count} {name}" for name, count in Counter(_format_of(path, robot) for path in found).most_common()
    )
    names = [str(clip.relative_to(path)) for clip in found]
    shared = ReadOptions(objects=options.objects, body_models=options.body_models, from_robot=robot)
    return Inspection(
        str(path),
        "folder",
        f"{len(found)} recording{'s' if len(found) > 1 else ''}: {counted}{_headlines(found, robot)}",
        notes=(f"Recordings in it: {source_readers.listed(names)}",),
        command=_command("batch", path, shared),
    )


def _headlines(found: Iterable[Path], robot: str | None) -> str:
    """Return the number of recordings with objects, of objects, and hours, where the format tells them cheaply."""
    facts: list[Headline] = []
    for file in map(SourceFile, found):
        with suppress(ReadError, ClipError):
            if (reader := source_readers.reader_of(file, robot)).headline_of is not None:
                facts.append(reader.headline(file))
    if not facts:
        return ""
    with_objects, objects = [item for item in facts if item.objects], Counter(o for item in facts for o in item.objects)
    hours = sum(item.seconds for item in with_objects) / 3600.0
    of = ", ".join(f"{name} {count}" for name, count in objects.most_common(_MOST_OBJECTS))
    return f"; {len(with_objects)} with objects, {hours:.1f} h; {len(objects)} objects: {of}"


def _format_of(path: Path, from_robot: str | None) -> str:
    try:
        return source_readers.reader_of(SourceFile(path), from_robot).format
    except ReadError:
        return "unreadable"


def _describe_robot_motion(path: Path) -> Inspection | None:
    """Return the facts of a robot's motion of another program, None where a file or folder is none."""
    try:
        file = formats.read(path)
    except ReadError:
        return None
    joints = f"{file.joint_pos.shape[1]} robot joints{'' if file.joint_names else ' without names'}"
    return Inspection(
        str(path),
        file.format,
        "a robot's motion, which check-motion, evaluate, view and export read",
        frames=file.frames,
        fps=file.fps or file.convention.usual_fps,
        fps_stated=file.fps is not None,
        skeleton=f"{joints} and a free root",
        objects=tuple(ObjectFacts(item.name, None, None, "no shape in the file", False) for item in file.objects),
        notes=(f"It holds {', '.join(file.contents)}.",),
        command=shlex.join(["hoi-retarget", "check-motion", str(path)]),
    )


def _describe_result(path: Path, result: Motion) -> Inspection:
    return Inspection(
        str(path),
        MOTION,
        f"a result of hoi-retarget for the robot {result.robot}",
        frames=result.frames,
        fps=result.fps,
        fps_stated=True,
        skeleton=f"{len(result.joint_names)} robot joints and a free root",
        up_axis="z, by the format",
        height=result.human_height,
        objects=tuple(
            ObjectFacts(name, _moved(result.object_pos[:, index]), None, "not stored in results", False)
            for index, name in enumerate(result.object_names)
        ),
        contacts=tuple(
            _describe_contact(link, name, result.contact_flags[:, column] & (result.contact_object[:, column] == index))
            for column, link in enumerate(result.contact_links)
            for index, name in enumerate(result.object_names)
        ),
        result=result,
    )


def _command(verb: str, path: Path, options: ReadOptions) -> str:
    """Return the command that retargets recordings, read with the same options."""
    words = ["hoi-retarget", verb, str(path)]
    for name, value in options.as_json().items():
        if value != getattr(ReadOptions, name):
            words += [option_of(name), str(value)]
    return shlex.join([*words, "--out", "out"])


def _describe_contact(part: str, name: str, active: Bool[np.ndarray, "T"]) -> ContactFacts:
    return ContactFacts(part, name, int(active.sum()), len(runs(active)))


def _moved(positions: Float[np.ndarray, "T 3"]) -> float:
    with np.errstate(over="ignore", invalid="ignore"):  # A damaged result may hold any finite number.
        return float(np.linalg.norm(positions - positions[:1], axis=1).max(initial=0.0))
