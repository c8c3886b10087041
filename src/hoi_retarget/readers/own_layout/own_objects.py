"""Objects of a clip, with shapes from the clip, beside it, or from the user's folder; contacts by frame or segment."""

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.errors import ClipError, GeometryError
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import ALL_PARTS
from hoi_retarget.objects import object_joint
from hoi_retarget.objects.track import ObjectGeometry, ObjectJoint, ObjectTrack
from hoi_retarget.readers.object_files import MAX_OBJECT_SIZE, load_geometry, load_mesh
from hoi_retarget.readers.own_layout.own_arrays import FLAGS, INTEGERS, NUMBERS, TEXT, Arrays, check_unit

_POINTS_NOTE = "Contact points are where the parts are, as the clip names none."


class _Touch(NamedTuple):
    """A part of a person and the object that it touches, as `ContactTrack` begins."""

    person: int
    object: int
    part: str


def has_contacts(arrays: Arrays) -> bool:
    """Return whether the clip has contacts, by frame or by segment."""
    return "contact_part" in arrays or "segment_part" in arrays


def contacts_of(
    arrays: Arrays, people: tuple[Person, ...], tracks: tuple[ObjectTrack, ...]
) -> tuple[tuple[ContactTrack, ...], tuple[str, ...]]:
    """Return the contacts, none where the clip has none, and notes of derived ones; raises `ClipError`."""
    if not has_contacts(arrays):
        return (), ()
    if "contact_part" in arrays and "segment_part" in arrays:
        raise ClipError(f"{arrays.path}: there are contact_part and segment_part. Give contacts in one way.")
    prefix, contacts = ("contact", _frame_contacts) if "contact_part" in arrays else ("segment", _segment_contacts)
    touches = tuple(_touches(arrays, prefix, len(people), len(tracks)))
    points = [tracks[touch.object].to_object(people[touch.person].part_position(touch.part)) for touch in touches]
    notes = () if f"{prefix}_points" in arrays else (_POINTS_NOTE,)
    return contacts(arrays, len(people[0].joint_positions), touches, points), notes


def _touches(arrays: Arrays, prefix: str, people: int, objects: int) -> Iterator[_Touch]:
    parts = arrays.array(f"{prefix}_part", TEXT, ("C",), "the parts that touch").tolist()
    columns = {}
    for what, count in (("person", people), ("object", objects)):
        name = f"{prefix}_{what}"
        if name in arrays or (what == "object" and objects != 1):
            columns[what] = arrays.array(name, INTEGERS, (len(parts),), f"the index of the {what}")
        else:
            columns[what] = np.zeros(len(parts), dtype=int)
        bad = (columns[what] < 0) | (columns[what] >= count)
        if bad.any():
            raise ClipError(f"{arrays.path}: {name} has {columns[what][bad][0]}; there are {count}, counted from 0.")
    for part, person, object_ in zip(parts, columns["person"], columns["object"], strict=True):
        if part not in ALL_PARTS:
            close = difflib.get_close_matches(part, ALL_PARTS, n=1)
            hint = f"Did you mean {close[0]!r}? " if close else ""
            raise ClipError(
                f"{arrays.path}: {prefix}_part has {part[:40]!r}, which is no part. {hint}"
                f"Parts: {', '.join(ALL_PARTS)}."
            )
        yield _Touch(int(person), int(object_), part)


def _frame_contacts(
    arrays: Arrays, frames: int, touches: Sequence[_Touch], points: Sequence[np.ndarray]
) -> tuple[ContactTrack, ...]:
    flags = arrays.array("contact_flags", FLAGS, (frames, len(touches)), "when the parts touch")
    if "contact_points" in arrays:
        shape = (frames, len(touches), 3)
        given = arrays.array("contact_points", NUMBERS, shape, "where, in the object's frame [m]")
        bad = np.argwhere(flags & ~np.isfinite(given).all(axis=2))
        if len(bad):
            raise ClipError(
                f"{arrays.path}: contact_points{bad[0].tolist()} is not finite, although contact_flags says that "
                f"{touches[bad[0][1]].part} touches there. Name the point, or leave contact_points out."
            )
        points = [given[:, index] for index in range(len(touches))]
    return tuple(ContactTrack(*touch, flags[:, index], points[index]) for index, touch in enumerate(touches))


def _segment_contacts(
    arrays: Arrays, frames: int, touches: Sequence[_Touch], points: Sequence[np.ndarray]
) -> tuple[ContactTrack, ...]:
    bounds = arrays.array("segment_frames", INTEGERS, (len(touches), 2), "first frame and one past the last")
    fixed = None
    if "segment_points" in arrays:
        fixed = arrays.array("segment_points", NUMBERS, (len(touches), 3), "where, in the object's frame [m]")
    active = {touch: np.zeros(frames, dtype=bool) for touch in touches}
    places = {touch: own.copy() for touch, own in zip(touches, points, strict=True)}
    for index, (touch, (start, stop)) in enumerate(zip(touches, bounds.tolist(), strict=True)):
        if not 0 <= start < stop <= frames:
            raise ClipError(
                f"{arrays.path}: segment_frames[{index}] is {start} to {stop}, expected the first frame and one past "
                f"the last, within 0 and {frames}."
            )
        if active[touch][start:stop].any():
            raise ClipError(
                f"{arrays.path}: segment_frames[{index}] overlaps another segment of {touch.part} on "
                f"{object_names(arrays)[touch.object]!r}. Join them or cut one."
            )
        active[touch][start:stop] = True
        if fixed is not None:
            places[touch][start:stop] = fixed[index]
    return tuple(ContactTrack(*touch, active[touch], places[touch]) for touch in active)


def objects_of(arrays: Arrays, frames: int, folder: Path | None) -> tuple[ObjectTrack, ...]:
    """Return the objects; `folder` is the user's, with `<name>/<name>.obj`.

    Raises `ClipError` where arrays are missing or disagree, `GeometryError` where a shape cannot be had.
    """
    names = object_names(arrays)
    if not names:
        return ()
    positions = arrays.array("object_pos", NUMBERS, (frames, len(names), 3), "the objects' positions [m]")
    quats = arrays.array("object_quat", NUMBERS, (frames, len(names), 4), "the objects' rotations, wxyz").astype(float)
    check_unit(arrays.path, "object_quat", quats)
    tracks = [
        ObjectTrack(name, positions[:, index], quats[:, index], _geometry(arrays, index, name, folder))
        for index, name in enumerate(names)
    ]
    return tuple(replace(track, joint=_joint(arrays, index, tracks)) for index, track in enumerate(tracks))


def _joint(arrays: Arrays, index: int, tracks: Sequence[ObjectTrack]) -> ObjectJoint | None:
    """Return an object's joint: as the clip says, or where it names no axis, as poses say."""
    key, part, known = f"object_{index}_joint", tracks[index], {track.name: track for track in tracks}
    if key not in arrays:
        return None
    kind, parent = arrays.text(key, f"one of {', '.join(object_joint.KINDS)}"), ""
    if kind not in object_joint.KINDS:
        raise ClipError(f"{arrays.path}: {key} is {ascii(kind)[:40]}, expected one of {', '.join(object_joint.KINDS)}.")
    if f"object_{index}_parent" in arrays or kind != "fixed":
        parent = arrays.text(f"object_{index}_parent", "the name of the object that it is a part of")
    if (parent or kind != "fixed") and (parent not in known or parent == part.name):
        raise ClipError(f"{arrays.path}: object_{index}_parent is {ascii(parent)[:40]}, which is no other object.")
    axis, anchor = (f"object_{index}_{name}" for name in ("axis", "anchor"))
    above = known[parent] if parent else object_joint.world_of(part)
    if axis not in arrays and anchor not in arrays:
        if (joint := object_joint.fitted_joint(above, part, kind)) is not None:
            return joint
        most = f"{object_joint.MAX_OFF} m and {object_joint.MAX_OFF_DEG:g} deg"
        raise ClipError(
            f"{arrays.path}: {part.name!r} does not move as on a {kind} of {parent or 'the world'}, within {most}, or "
            f"too little to find its axis. Name another, or give {axis} and {anchor}."
        )
    given = (arrays.array(name, NUMBERS, (3,), "in its parent's frame").tolist() for name in (axis, anchor))
    try:
        joint = ObjectJoint(parent, kind, *map(tuple, given))
    except ClipError as error:
        raise ClipError(f"{arrays.path}: {error}") from error
    off, turned = object_joint.distance_from(object_joint.path_of(joint, above, part), above, part)
    if off > object_joint.MAX_OFF or turned > object_joint.MAX_OFF_DEG:
        raise ClipError(
            f"{arrays.path}: {part.name!r} is up to {off:.3g} m and {turned:.3g} deg from where {axis} and {anchor} "
            "put it. Give these in the parent's frame, the axis as a unit vector."
        )
    return joint


def mesh_paths(arrays: Arrays) -> tuple[Path, ...]:
    """Return the files beside a clip that shapes may come from, whether there or not; raises `ClipError`."""
    files = []
    for index, name in enumerate(object_names(arrays)):
        named = _named_mesh(arrays, index)
        files.append(named if named is not None or _holds(arrays, index) else _mesh_called(arrays, name))
    return tuple(path for path in files if path is not None)


def object_names(arrays: Arrays) -> list[str]:
    """Return the objects' names; raises `ClipError`."""
    names = arrays.array("object_names", TEXT, ("O",), "what the objects are called; none is allowed").tolist()
    if len(set(names)) < len(names):
        raise ClipError(f"{arrays.path}: object_names has a name twice ({', '.join(names)}). Name every object once.")
    return names


def _holds(arrays: Arrays, index: int) -> bool:
    """Return whether the clip itself has an object's shape."""
    return any(f"object_{index}_{what}" in arrays for what in ("points", "faces"))


def _geometry(arrays: Arrays, index: int, name: str, folder: Path | None) -> ObjectGeometry:
    points, faces, mesh = (f"object_{index}_{what}" for what in ("points", "faces", "mesh"))
    if faces in arrays and mesh in arrays:
        raise ClipError(f"{arrays.path}: there are {faces} and {mesh}. Give the triangles or the file, not both.")
    mesh_path = _named_mesh(arrays, index)
    if not _holds(arrays, index):
        return load_mesh(mesh_path) if mesh_path is not None else _geometry_elsewhere(arrays, index, name, folder)
    vertices = arrays.array(points, NUMBERS, ("V", 3), "points of the object's surface [m]").astype(float)
    if len(vertices) == 0 or np.abs(vertices).max() > MAX_OBJECT_SIZE:
        raise ClipError(
            f"{arrays.path}: {points} has {len(vertices)} point(s) with coordinates up to "
            f"{np.abs(vertices).max(initial=0.0):.4g}, expected metres up to {MAX_OBJECT_SIZE:g}."
        )
    triangles = None
    if faces in arrays:
        triangles = arrays.array(faces, INTEGERS, ("F", 3), "triangles over the points").astype(int)
        if ((triangles < 0) | (triangles >= len(vertices))).any():
            raise ClipError(f"{arrays.path}: {faces} names points beyond the {len(vertices)} of {points}.")
    return ObjectGeometry(vertices, mesh_path, triangles)


def _geometry_elsewhere(arrays: Arrays, index: int, name: str, folder: Path | None) -> ObjectGeometry:
    """Return the shape of an object of which the clip has nothing but the name."""
    beside = _mesh_called(arrays, name)
    try:
        if beside is not None and beside.is_file():
            return load_mesh(beside)
    except OSError as error:
        raise GeometryError(f"{beside}: cannot be read ({error}). Check its permissions.") from error
    if folder is None:
        raise GeometryError(
            f"{arrays.path}: the clip does not hold the shape of object {name!r} (object_{index}_points, or "
            f"object_{index}_mesh), and no {name}.obj is beside it. Put one there, or pass --objects DIR with "
            f"{name}/{name}.obj in it."
        )
    return load_geometry(folder, name)


def _named_mesh(arrays: Arrays, index: int) -> Path | None:
    """Return the mesh file that a clip names for an object; None where it names none."""
    mesh = f"object_{index}_mesh"
    return _inside(arrays, mesh, arrays.text(mesh, "a mesh file beside the clip")) if mesh in arrays else None


def _mesh_called(arrays: Arrays, name: str) -> Path | None:
    """Return the mesh file beside the clip that is called as the object; None where no file can be called so."""
    if not name or any(character in name for character in "/\\:\0"):
        return None
    return _inside(arrays, f"the mesh of {name!r}", f"{name}.obj")


def _inside(arrays: Arrays, owner: str, text: str) -> Path:
    """Return the path of a mesh; it lies in the clip's folder or below, links followed."""
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
            f"{arrays.path}: {owner} is {ascii(text)[:80]}, expected a file in the clip's folder, such as 'box.obj'. "
            "Put the mesh beside the clip."
        )
    return folder / text
