"""Reads and writes clips in a layout of our own, for recordings that no other reader knows: one `.npz`, documented.

z up, floor at z = 0, metres, seconds, quaternions wxyz, no pickled objects; `docs/sources.md` describes every
array. What is missing is derived by a stated rule or refused: fingers are straight where there are none, contact
points are the parts' own points where none are given. Nothing else is made up.
"""

import difflib
import hashlib
import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from hoi_retarget import npz
from hoi_retarget.clip import MINIMUM_FRAMES, Clip, ContactTrack, ObjectGeometry, ObjectTrack, Person, Source
from hoi_retarget.errors import ArgumentError, ClipError, GeometryError, ReadError, WriteError
from hoi_retarget.motion import write_atomically
from hoi_retarget.readers import fingers, rest_pose
from hoi_retarget.readers.objects import LARGEST_OBJECT, load_geometry, load_mesh
from hoi_retarget.readers.reader import Reader, ReadOptions
from hoi_retarget.readers.source_file import SourceFile
from hoi_retarget.readers.torch_file import read_bytes
from hoi_retarget.readers.upright import SHORTEST, TALLEST, standing_axis
from hoi_retarget.skeleton import JOINT_INDEX, JOINTS, LEFT_FINGERS, PARTS, RIGHT_FINGERS

FORMAT = "hoi-retarget-clip"
SCHEMA = 1
SCHEMA_KEY = "clip_schema"
UP, UNIT = "z", "m"
DOCUMENT = "docs/sources.md describes the layout."

BODY_JOINTS = tuple(joint for joint in JOINTS if joint not in (*LEFT_FINGERS, *RIGHT_FINGERS))
"""The joints that every clip has."""

LARGEST_VALUE = 1e4
"""Of any number; metres, frames a second and quaternions stay below."""
FLOOR_TOLERANCE = 0.3
"""[m]; the lowest joint is that near the floor in most frames of any recording."""

_POINTS_NOTE = "Contact points are where the parts are, as the clip names none."

_MESH = re.compile(r"object_\d+_mesh")

# Kinds of numpy arrays by what they mean.
_NUMBERS, _INTEGERS, _TEXT, _FLAGS = "fiu", "iu", "U", "b"


def holds(file: SourceFile) -> bool:
    """Return whether an `.npz` file says that it is a clip of this layout."""
    return SCHEMA_KEY in file.members


def read_file(file: SourceFile, options: ReadOptions) -> Clip:
    """Return the clip of an opened file; otherwise as `read`."""
    return clip_of(file.path, file.content, objects=options.objects, object_name=options.object_name)


def read(path: Path, *, objects: Path | None = None, object_name: str | None = None) -> Clip:
    """Return the clip in `path`.

    Args:
        path: The `.npz` file.
        objects: Folder with `<name>/<name>.obj`, for objects whose shape the clip does not hold.
        object_name: Must be None: the clip names its objects.

    Raises:
        ReadError: the file is missing, damaged, or of another layout.
        ClipError: arrays are missing, disagree, or contradict what the layout says.
        GeometryError: the shape of an object cannot be had.
        ArgumentError: an object's name is given.
    """
    return clip_of(path, read_bytes(path), objects=objects, object_name=object_name)


def clip_of(path: Path, content: bytes, *, objects: Path | None = None, object_name: str | None = None) -> Clip:
    """Return the clip that the bytes of a file are; otherwise as `read`."""
    try:
        arrays = _Arrays(path, npz.members(content))
    except ValueError as error:
        raise ReadError(f"{path}: not a readable .npz file ({error}). Write it again.") from error
    arrays.check_schema()
    if object_name is not None:
        raise ArgumentError(f"{path}: --object {object_name} is for clips that do not name their object. Leave it out.")
    people, notes = _people(arrays)
    tracks = _objects(arrays, objects)
    contacts, contact_notes = _contacts(arrays, people, tracks)
    licence = arrays.text("licence", "the terms of the data, such as 'CC BY 4.0'")
    arrays.check_all_used()
    try:
        clip = Clip(
            name=arrays.text("name", "what the clip is called"),
            fps=arrays.number("fps", "frames a second"),
            people=people,
            objects=tracks,
            contacts=contacts,
            source=Source(
                str(path),
                hashlib.sha256(content).hexdigest(),
                FORMAT,
                licence,
                (*arrays.texts("notes"), *notes, *contact_notes),
            ),
            first_source_frame=arrays.count("first_source_frame"),
        )
    except ClipError as error:
        raise ClipError(f"{path}: {error}") from error
    for person in people:
        check_person(path, person)
    return clip


def mesh_files(path: Path) -> tuple[Path, ...]:
    """Return the mesh files that the clip in `path` names, whether there or not; none where it cannot be read."""
    try:
        members = npz.members(path.read_bytes())
        arrays = _Arrays(path, members)
        return tuple(_mesh_file(arrays, name) for name in sorted(members) if _MESH.fullmatch(name))
    except (OSError, ValueError, ClipError):
        return ()


def write(clip: Clip, path: Path) -> None:
    """Write a clip so that reading it gives the same people, objects, contacts, notes and licence.

    Raises:
        WriteError: the file cannot be written, or the mesh of an object is not in the file's folder.
    """
    write_atomically(path, encode(clip, path.parent))


def encode(clip: Clip, folder: Path) -> bytes:
    """Return the content of a clip's file that will lie in `folder`; raises `WriteError` as `write`."""
    values: dict[str, Any] = {
        SCHEMA_KEY: np.int64(SCHEMA),
        "name": np.str_(clip.name),
        "fps": np.float64(clip.fps),
        "up": np.str_(UP),
        "unit": np.str_(UNIT),
        "licence": np.str_(clip.source.licence),
        "notes": np.array(clip.source.notes, dtype=np.str_),
        "first_source_frame": np.int64(clip.first_source_frame),
        "joint_names": np.array(JOINTS, dtype=np.str_),
        "person_names": np.array([person.name for person in clip.people], dtype=np.str_),
        "joint_pos": np.stack([person.joint_positions for person in clip.people], axis=1),
        "joint_quat": np.stack([person.joint_quats for person in clip.people], axis=1),
        "object_names": np.array([track.name for track in clip.objects], dtype=np.str_),
    }
    if clip.objects:
        values["object_pos"] = np.stack([track.positions for track in clip.objects], axis=1)
        values["object_quat"] = np.stack([track.quats for track in clip.objects], axis=1)
    for index, track in enumerate(clip.objects):
        values |= _shape_values(index, track, folder)
    if clip.contacts:
        values |= {
            "contact_part": np.array([track.part for track in clip.contacts], dtype=np.str_),
            "contact_person": np.array([track.person for track in clip.contacts], dtype=np.int64),
            "contact_object": np.array([track.object for track in clip.contacts], dtype=np.int64),
            "contact_flags": np.stack([track.active for track in clip.contacts], axis=1),
            "contact_points": np.stack([track.points_object for track in clip.contacts], axis=1),
        }
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **values)
    return buffer.getvalue()


def _shape_values(index: int, track: ObjectTrack, folder: Path) -> dict[str, Any]:
    geometry = track.geometry
    values: dict[str, Any] = {f"object_{index}_points": geometry.points}
    if geometry.faces is not None:
        values[f"object_{index}_faces"] = geometry.faces
    elif geometry.mesh_path is not None:
        try:
            inside = geometry.mesh_path.resolve().relative_to(folder.resolve())
        except ValueError as error:
            raise WriteError(
                f"object {track.name!r}: its mesh {geometry.mesh_path} is not in the folder of the clip, {folder}. "
                "Put it there, or give the object faces."
            ) from error
        values[f"object_{index}_mesh"] = np.str_(inside.as_posix())
    return values


def check_person(path: Path, person: Person) -> None:
    """Raise `ClipError` when a person is in another unit, another order of rotations, or another up axis."""
    height = person.height
    if not SHORTEST <= height <= TALLEST:
        raise ClipError(
            f"{path}: person {person.name!r} would be {height:.4g} m tall. Lengths are in metres: divide by 1000 if "
            f"these are millimetres, by 100 if centimetres. {DOCUMENT}"
        )
    fit = rest_pose.agreement(person.joint_positions, person.joint_quats)
    if fit < rest_pose.LEAST_AGREEMENT:
        raise ClipError(
            f"{path}: person {person.name!r}: joint_quat does not fit joint_pos: in its parent's frame a knee or an "
            f"elbow lies {np.rad2deg(np.arccos(np.clip(fit, -1, 1))):.0f} deg from where the T-pose has it. Rotations "
            "are of the world, wxyz, and identity in the T-pose that stands along +y and looks along +z. "
            f"{DOCUMENT}"
        )
    axis = standing_axis(person.joint_positions)
    lowest = float(np.median(person.joint_positions[..., 2].min(axis=1)))
    if axis != "z" and abs(lowest) > FLOOR_TOLERANCE:
        raise ClipError(
            f"{path}: person {person.name!r} stands along {axis}, the lowest joint mostly at z = {lowest:.2f} m, "
            f"but z is up and the floor at 0. Turn and shift the recording. {DOCUMENT}"
        )


# Arrays by name


class _Arrays:
    """The arrays of a file, each checked as it is taken; what nobody takes is not known."""

    def __init__(self, path: Path, members: Mapping[str, bytes]) -> None:
        self.path, self._members, self._used = path, members, set[str]()

    def __contains__(self, name: str) -> bool:
        return name in self._members

    def array(self, name: str, kinds: str, shape: tuple[int | str, ...], meaning: str) -> np.ndarray:
        """Return an array; letters in its shape stand for any length. Raises `ClipError`."""
        self._used.add(name)
        if name not in self._members:
            close = difflib.get_close_matches(name, self._members, n=1)
            known = f"Did you mean {close[0]!r}?" if close else f"It has {', '.join(sorted(self._members)[:20])}."
            raise ClipError(f"{self.path}: the clip lacks {name!r}, {meaning}. {known} {DOCUMENT}")
        try:
            values = npz.array(name, self._members[name], kinds)
        except (ValueError, UnicodeDecodeError) as error:
            raise ClipError(f"{self.path}: {name}, {meaning}, cannot be used: {error}. {DOCUMENT}") from error
        fits = len(shape) == values.ndim and all(
            isinstance(want, str) or want == have for want, have in zip(shape, values.shape, strict=True)
        )
        if not fits:
            wanted = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
            raise ClipError(f"{self.path}: {name}, {meaning}, has shape {values.shape}, expected {wanted}. {DOCUMENT}")
        if values.dtype.kind == "f" and name != "contact_points" and not np.isfinite(values).all():
            frames = np.unique(np.argwhere(~np.isfinite(values))[:, 0]) if values.ndim else np.zeros(1, dtype=int)
            raise ClipError(
                f"{self.path}: {name}, {meaning}, holds numbers that are not finite, first at row {frames[0]}. "
                "Cut those frames, or fill them where the recording is made."
            )
        if values.dtype.kind == "f" and np.abs(np.nan_to_num(values)).max(initial=0.0) > LARGEST_VALUE:
            raise ClipError(
                f"{self.path}: {name}, {meaning}, reaches {np.abs(np.nan_to_num(values)).max():.4g}, expected at most "
                f"{LARGEST_VALUE:g}: damage, or another unit. Lengths are in metres."
            )
        return values

    def text(self, name: str, meaning: str) -> str:
        return str(self.array(name, _TEXT, (), meaning))

    def texts(self, name: str) -> tuple[str, ...]:
        return tuple(self.array(name, _TEXT, ("N",), "sentences").tolist()) if name in self else ()

    def number(self, name: str, meaning: str) -> float:
        return float(self.array(name, _NUMBERS, (), meaning))

    def count(self, name: str) -> int:
        return int(self.array(name, _INTEGERS, (), "a number of frames")) if name in self else 0

    def check_schema(self) -> None:
        if SCHEMA_KEY not in self:
            if "schema" in self:
                raise ReadError(
                    f"{self.path}: this is a result, not a clip. Use `hoi-retarget evaluate` on it, or name the "
                    "recording that it was made from."
                )
            listing = ", ".join(ascii(name)[:40] for name in sorted(self._members)[:10])
            raise ReadError(f"{self.path}: not a clip of {FORMAT}: it has no {SCHEMA_KEY!r}, but {listing}. {DOCUMENT}")
        schema = int(self.array(SCHEMA_KEY, _INTEGERS, (), "the version of the layout"))
        if schema != SCHEMA:
            raise ReadError(f"{self.path}: {SCHEMA_KEY} is {schema}; this version reads {SCHEMA}.")
        for name, wanted, advice in (
            ("up", UP, "Turn the recording: from y-up, (x, y, z) becomes (x, -z, y)"),
            ("unit", UNIT, "Convert lengths to metres"),
        ):
            stated = self.text(name, f"always {wanted!r}")
            if stated != wanted:
                raise ClipError(f"{self.path}: {name} is {stated[:40]!r}, expected {wanted!r}. {advice}. {DOCUMENT}")

    def check_all_used(self) -> None:
        allowed = {"name", "fps", "licence", "notes", "first_source_frame"}
        unknown = sorted(set(self._members) - self._used - allowed)
        if unknown:
            known = sorted(self._used | allowed)
            close = difflib.get_close_matches(unknown[0], known, n=1)
            hint = f"Did you mean {close[0]!r}?" if close else f"Known here: {', '.join(known)}."
            raise ClipError(f"{self.path}: the clip has {unknown[0]!a}, which the layout does not know. {hint}")


# People


def _people(arrays: _Arrays) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    names = arrays.array("joint_names", _TEXT, ("J",), "the joints, in the order of the arrays").tolist()
    _check_joint_names(arrays.path, names)
    positions = arrays.array("joint_pos", _NUMBERS, ("T", "P", len(names), 3), "joint positions [m]").astype(float)
    frames, people = positions.shape[:2]
    if frames < MINIMUM_FRAMES or people == 0:
        raise ClipError(
            f"{arrays.path}: joint_pos has {frames} frame(s) of {people} people; at least {MINIMUM_FRAMES} frames of "
            "one person are needed. Use a longer recording."
        )
    quats = arrays.array("joint_quat", _NUMBERS, (frames, people, len(names), 4), "joint rotations, wxyz")
    quats = quats.astype(float)
    _check_unit(arrays.path, "joint_quat", quats)
    if "person_names" in arrays:
        called = arrays.array("person_names", _TEXT, (people,), "what the people are called").tolist()
    else:
        called = [f"person {index}" for index in range(people)] if people > 1 else ["person"]
    present = [JOINT_INDEX[name] for name in names]
    all_positions, all_quats = np.zeros((frames, people, len(JOINTS), 3)), np.zeros((frames, people, len(JOINTS), 4))
    all_positions[:, :, present], all_quats[:, :, present] = positions, quats
    notes = ()
    if len(names) < len(JOINTS):
        fingers.add_straight_fingers(all_positions, all_quats)
        notes = (fingers.NOTE,)
    made = tuple(Person(name, all_positions[:, i], all_quats[:, i]) for i, name in enumerate(called))
    return made, notes


def _check_joint_names(path: Path, names: list[str]) -> None:
    unknown = [name for name in names if name not in JOINT_INDEX]
    if unknown:
        close = difflib.get_close_matches(unknown[0], JOINTS, n=1)
        hint = f"Did you mean {close[0]!r}? " if close else ""
        raise ClipError(
            f"{path}: joint_names has {unknown[0][:40]!r}, which is no joint. {hint}Joints: {', '.join(JOINTS)}."
        )
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ClipError(f"{path}: joint_names has {twice!r} twice. Name every joint once.")
    absent = [joint for joint in BODY_JOINTS if joint not in names]
    if absent:
        raise ClipError(
            f"{path}: joint_names lacks {', '.join(absent)}. All {len(BODY_JOINTS)} joints of the body are needed; "
            "only the fingers can be left out."
        )
    fingers = [joint for joint in JOINTS if joint not in BODY_JOINTS]
    absent = [joint for joint in fingers if joint not in names]
    if absent and len(absent) < len(fingers):
        raise ClipError(
            f"{path}: joint_names has some fingers but lacks {', '.join(absent)}. Give all {len(fingers)} finger "
            "joints or none."
        )


def _check_unit(path: Path, name: str, quats: np.ndarray) -> None:
    lengths = np.linalg.norm(quats, axis=-1)
    bad = np.argwhere(np.abs(lengths - 1.0) > 0.01)
    if len(bad):
        at = tuple(int(index) for index in bad[0])
        raise ClipError(
            f"{path}: {name}{list(at)} has length {lengths[at]:.4g}, expected unit quaternions, wxyz. "
            f"({len(bad)} of {lengths.size} are not.) {DOCUMENT}"
        )


# Objects


def _objects(arrays: _Arrays, folder: Path | None) -> tuple[ObjectTrack, ...]:
    names = arrays.array("object_names", _TEXT, ("O",), "what the objects are called; none is allowed").tolist()
    if len(set(names)) < len(names):
        raise ClipError(f"{arrays.path}: object_names has a name twice ({', '.join(names)}). Name every object once.")
    if not names:
        return ()
    frames = len(arrays.array("joint_pos", _NUMBERS, ("T", "P", "J", 3), "joint positions"))
    positions = arrays.array("object_pos", _NUMBERS, (frames, len(names), 3), "the objects' positions [m]")
    quats = arrays.array("object_quat", _NUMBERS, (frames, len(names), 4), "the objects' rotations, wxyz").astype(float)
    _check_unit(arrays.path, "object_quat", quats)
    return tuple(
        ObjectTrack(name, positions[:, index], quats[:, index], _geometry(arrays, index, name, folder))
        for index, name in enumerate(names)
    )


def _geometry(arrays: _Arrays, index: int, name: str, folder: Path | None) -> ObjectGeometry:
    points, faces, mesh = (f"object_{index}_{what}" for what in ("points", "faces", "mesh"))
    if faces in arrays and mesh in arrays:
        raise ClipError(f"{arrays.path}: there are {faces} and {mesh}. Give the triangles or the file, not both.")
    mesh_path = None if mesh not in arrays else _mesh_file(arrays, mesh)
    if points not in arrays and faces not in arrays:
        if mesh_path is not None:
            return load_mesh(mesh_path)
        if folder is None:
            raise GeometryError(
                f"{arrays.path}: the clip does not hold the shape of object {name!r} ({points}, or {mesh}). "
                f"Pass --objects DIR with {name}/{name}.obj in it."
            )
        return load_geometry(folder, name)
    vertices = arrays.array(points, _NUMBERS, ("V", 3), "points of the object's surface [m]").astype(float)
    if len(vertices) == 0 or np.abs(vertices).max() > LARGEST_OBJECT:
        raise ClipError(
            f"{arrays.path}: {points} has {len(vertices)} point(s) with coordinates up to "
            f"{np.abs(vertices).max(initial=0.0):.4g}, expected metres up to {LARGEST_OBJECT:g}."
        )
    triangles = None
    if faces in arrays:
        triangles = arrays.array(faces, _INTEGERS, ("F", 3), "triangles over the points").astype(int)
        if ((triangles < 0) | (triangles >= len(vertices))).any():
            raise ClipError(f"{arrays.path}: {faces} names points beyond the {len(vertices)} of {points}.")
    return ObjectGeometry(vertices, mesh_path, triangles)


def _mesh_file(arrays: _Arrays, name: str) -> Path:
    """Return the mesh file that a clip names; it lies in the clip's folder or below, links followed."""
    text = arrays.text(name, "a mesh file beside the clip")
    folder = arrays.path.parent
    parts = PurePosixPath(text).parts
    try:
        leaves = (
            not parts
            or text.startswith("/")
            or ".." in parts
            or any(character in text for character in "\\:\0")
            or not (folder / text).resolve().is_relative_to(folder.resolve())
        )
    except (OSError, RuntimeError, ValueError):
        leaves = True
    if leaves:
        raise ClipError(
            f"{arrays.path}: {name} is {ascii(text)[:80]}, expected a file in the clip's folder, such as 'box.obj'. "
            "Put the mesh beside the clip."
        )
    return folder / text


# Contacts


@dataclass(frozen=True)
class _Touch:
    """Who touches what."""

    person: int
    object: int
    part: str


def _contacts(
    arrays: _Arrays, people: tuple[Person, ...], tracks: tuple[ObjectTrack, ...]
) -> tuple[tuple[ContactTrack, ...], tuple[str, ...]]:
    if "contact_part" in arrays and "segment_part" in arrays:
        raise ClipError(f"{arrays.path}: there are contact_part and segment_part. Give contacts in one way.")
    if "contact_part" in arrays:
        return _frame_contacts(arrays, people, tracks)
    if "segment_part" in arrays:
        return _segment_contacts(arrays, people, tracks)
    return (), ()


def _touches(arrays: _Arrays, prefix: str, people: int, objects: int) -> Iterator[_Touch]:
    parts = arrays.array(f"{prefix}_part", _TEXT, ("C",), "the parts that touch").tolist()
    columns = {}
    for what, count in (("person", people), ("object", objects)):
        name = f"{prefix}_{what}"
        if name in arrays or (what == "object" and objects != 1):
            columns[what] = arrays.array(name, _INTEGERS, (len(parts),), f"the index of the {what}")
        else:
            columns[what] = np.zeros(len(parts), dtype=int)
        bad = (columns[what] < 0) | (columns[what] >= count)
        if bad.any():
            raise ClipError(f"{arrays.path}: {name} has {columns[what][bad][0]}; there are {count}, counted from 0.")
    for part, person, thing in zip(parts, columns["person"], columns["object"], strict=True):
        if part not in PARTS:
            close = difflib.get_close_matches(part, PARTS, n=1)
            hint = f"Did you mean {close[0]!r}? " if close else ""
            raise ClipError(
                f"{arrays.path}: {prefix}_part has {part[:40]!r}, which is no part. {hint}Parts: {', '.join(PARTS)}."
            )
        yield _Touch(int(person), int(thing), part)


def _part_points(touch: _Touch, people: tuple[Person, ...], tracks: tuple[ObjectTrack, ...]) -> np.ndarray:
    return tracks[touch.object].to_object(people[touch.person].part_position(touch.part))


def _frame_contacts(
    arrays: _Arrays, people: tuple[Person, ...], tracks: tuple[ObjectTrack, ...]
) -> tuple[tuple[ContactTrack, ...], tuple[str, ...]]:
    touches = tuple(_touches(arrays, "contact", len(people), len(tracks)))
    shape = (len(people[0].joint_positions), len(touches))
    flags = arrays.array("contact_flags", _FLAGS, shape, "when the parts touch")
    if "contact_points" not in arrays:
        made = (_part_points(touch, people, tracks) for touch in touches)
        points, notes = np.stack(list(made), axis=1) if touches else np.zeros((*shape, 3)), (_POINTS_NOTE,)
    else:
        points, notes = arrays.array("contact_points", _NUMBERS, (*shape, 3), "where, in the object's frame [m]"), ()
        bad = np.argwhere(flags & ~np.isfinite(points).all(axis=2))
        if len(bad):
            raise ClipError(
                f"{arrays.path}: contact_points{bad[0].tolist()} is not finite, although contact_flags says that "
                f"{touches[bad[0][1]].part} touches there. Name the point, or leave contact_points out."
            )
    return tuple(
        ContactTrack(touch.person, touch.object, touch.part, flags[:, index], points[:, index])
        for index, touch in enumerate(touches)
    ), notes


def _segment_contacts(
    arrays: _Arrays, people: tuple[Person, ...], tracks: tuple[ObjectTrack, ...]
) -> tuple[tuple[ContactTrack, ...], tuple[str, ...]]:
    touches = tuple(_touches(arrays, "segment", len(people), len(tracks)))
    frames = len(people[0].joint_positions)
    bounds = arrays.array("segment_frames", _INTEGERS, (len(touches), 2), "first frame and one past the last")
    fixed = None
    if "segment_points" in arrays:
        fixed = arrays.array("segment_points", _NUMBERS, (len(touches), 3), "where, in the object's frame [m]")
    active = {touch: np.zeros(frames, dtype=bool) for touch in touches}
    points = {touch: _part_points(touch, people, tracks).copy() for touch in touches}
    for index, (touch, (start, stop)) in enumerate(zip(touches, bounds.tolist(), strict=True)):
        if not 0 <= start < stop <= frames:
            raise ClipError(
                f"{arrays.path}: segment_frames[{index}] is {start} to {stop}, expected the first frame and one past "
                f"the last, within 0 and {frames}."
            )
        if active[touch][start:stop].any():
            raise ClipError(
                f"{arrays.path}: segment_frames[{index}] overlaps another segment of {touch.part} on "
                f"{tracks[touch.object].name!r}. Join them or cut one."
            )
        active[touch][start:stop] = True
        if fixed is not None:
            points[touch][start:stop] = fixed[index]
    made = tuple(ContactTrack(it.person, it.object, it.part, active[it], points[it]) for it in active)
    return made, (_POINTS_NOTE,) if fixed is None else ()


READER = Reader(format=FORMAT, suffixes=(".npz",), floor_at_zero=True, holds=holds, read=read_file)
