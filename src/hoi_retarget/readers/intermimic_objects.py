"""Reads InterMimic's `.pt` clips of one person and several objects, as its forks for GRAB and ParaHome have them.

A dictionary with `data`, one row of 526 + 65 n columns a frame, and `objects`, the names of the n
objects. Up to column 318 rows are those of the layout with one object; then come the bodies'
rotations, then for each object its position, its rotation, a padding, its own label, and a label for
each body. 30 Hz, z-up, in metres, with scalar-last quaternions.

Labels go from -1 to 6. Measured on twenty ParaHome clips, the joint is 1.5 cm from the object at
label 1, and farther with each number up to 4.7 cm at 6; nobody says what these stand for. Only 1
counts as contact here.

Some of these files hold the bodies' rotations as SMPL-X has them, others, like all files with one
object, turned by a fixed rotation. The limbs tell which: in SMPL-X's T-pose arms lie along x and
legs along -y.
"""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import Clip, ContactTrack, Source
from hoi_retarget.errors import ArgumentError, ClipError, GeometryError, ReadError
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.files.torch_file import parse_torch
from hoi_retarget.human import rest_pose
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINTS, PARTS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.intermimic import (
    FPS,
    JOINT_ORDER,
    UPRIGHT_QUAT,
    check_frames,
    check_hands,
    check_labels,
    check_numbers,
    check_root,
    check_unit,
    leading_zero_frames,
    object_count,
    part_active,
)
from hoi_retarget.readers.object_files import load_geometry
from hoi_retarget.readers.reader import Reader, ReadOptions

FORMAT = "intermimic-multi-object"
PARAHOME_LICENCE = "ParaHome: CC BY-NC-SA 4.0; repackaged by a fork of InterMimic, whose terms are not stated"
UNKNOWN_LICENCE = "not stated by the file; the layout is used for GRAB and ParaHome, both for non-commercial use"
CONTACT_LABEL = 1.0
BASE = "_base"
"""Ending of ParaHome's name for the main part of an object; the mesh has the object's name."""

_PERSON: Mapping[str, slice] = {
    "root position": slice(0, 3),
    "root rotation": slice(3, 7),
    "padding": slice(7, 9),
    "joint angles": slice(9, 162),
    "body positions": slice(162, 318),
    "body rotations": slice(318, 526),
}
_OBJECT: Mapping[str, slice] = {
    "position": slice(0, 3),
    "rotation": slice(3, 7),
    "padding": slice(7, 12),
    "own contact label": slice(12, 13),
    "body contact labels": slice(13, 65),
}
_FIRST_OBJECT, _WIDTH = 526, 65
_EXPECTED_LABELS = "whole numbers from -1 (far) over 0 (near) and 1 (contact) to 6"


@dataclass(frozen=True, eq=False)
class ObjectColumns:
    """One object's columns by their meaning, joints in the order of `skeleton.JOINTS`, nothing checked."""

    name: str
    positions: Float[np.ndarray, "T 3"]
    quats: Float[np.ndarray, "T 4"]
    """wxyz"""
    joint_labels: Float[np.ndarray, "T 52"]


def is_multi_object(value: Any) -> bool:
    """Return whether what a torch file holds is of this layout, as far as names and shapes tell."""
    if not isinstance(value, dict):
        return False
    data, names = value.get("data"), value.get("objects")
    return (
        isinstance(data, np.ndarray)
        and data.ndim == 2
        and data.dtype.kind == "f"
        and isinstance(names, list)
        and all(isinstance(name, str) for name in names)
        and 0 < len(names) == object_count(data.shape[1])
    )


def read(path: Path, *, objects: Path | None = None, object_name: str | None = None) -> Clip:
    """Return the clip in `path`, with the geometry of its objects from the folder `objects`.

    Raises:
        ReadError: the file is missing, damaged, or of another layout.
        ClipError: numbers are not finite, rotations zero, labels unknown, or parts contradict each other.
        GeometryError: the geometry of an object cannot be had.
        ArgumentError: an object's name is given, although the file names its objects.
    """
    content = read_bytes(path)
    return clip_of(parse_torch(content, path), path, content, objects=objects, object_name=object_name)


def holds(file: SourceFile) -> bool:
    """Return whether a torch file is a dictionary of this layout."""
    return is_multi_object(file.torch)


def read_file(file: SourceFile, options: ReadOptions) -> Clip:
    """Return the clip of an opened file; otherwise as `read`."""
    return clip_of(file.torch, file.path, file.content, objects=options.objects, object_name=options.object_name)


def clip_of(
    value: Any, path: Path, content: bytes, *, objects: Path | None = None, object_name: str | None = None
) -> Clip:
    """Return the clip that the value in a torch file is; otherwise as `read`."""
    if not is_multi_object(value):
        raise ReadError(
            f"{path}: expected a dictionary with `data`, a tensor of 526 + 65 n columns, and `objects`, a list of n "
            f"names ({FORMAT}). Convert the clip again."
        )
    names = tuple(value["objects"])
    _check_names(path, names, object_name)
    matrix = value["data"].astype(float)
    first = leading_zero_frames(matrix)
    check(path, matrix, names, first)
    positions, quats, turned = person_of(matrix[first:], path)
    check_hands(path, positions, first)
    if objects is None:
        wanted = ", ".join(f"{mesh_name(name)}/{mesh_name(name)}.obj" for name in names)
        raise GeometryError(
            f"{path}: the clip needs the geometry of its objects. Pass --objects DIR with {wanted} in it."
        )
    person = Person("person", positions, quats)
    columns = tuple(objects_of(matrix[first:], names))
    tracks = tuple(
        ObjectTrack(item.name, item.positions, item.quats, geometry_of(objects, item.name)) for item in columns
    )
    contacts = tuple(
        ContactTrack(0, index, part, part_active(item.joint_labels, part), track.to_object(person.part_position(part)))
        for index, (item, track) in enumerate(zip(columns, tracks, strict=True))
        for part in PARTS
    )
    notes = (
        f"Body rotations are {'turned by a fixed rotation' if turned else 'those of SMPL-X'}, as the limbs tell.",
        *label_notes(columns, contacts),
        *content_notes(value, names),
    )
    if first:
        notes += (f"{first} leading frame(s) without data were dropped.",)
    return Clip(
        name=path.stem,
        fps=FPS,
        people=(person,),
        objects=tracks,
        contacts=contacts,
        source=Source(str(path), hashlib.sha256(content).hexdigest(), FORMAT, licence_of(value), notes),
        first_source_frame=first,
    )


def _check_names(path: Path, names: tuple[str, ...], object_name: str | None) -> None:
    if object_name is not None:
        raise ArgumentError(
            f"{path}: --object {object_name} is for clips that do not name their object; this one names "
            f"{', '.join(names)}. Leave the option out."
        )
    if len(set(names)) < len(names):
        raise ClipError(f"{path}: two of its objects have one name ({', '.join(names)}). Convert the clip again.")


def check(path: Path, matrix: Float[np.ndarray, "T columns"], names: tuple[str, ...], first: int) -> None:
    """Raise `ClipError` unless all frames from `first` on can be used; frames are counted from the file's first."""
    fields = _fields(names)
    check_frames(path, matrix, first)
    check_numbers(path, matrix, fields)
    check_unit(path, matrix, first, {name: field for name, field in fields.items() if name.endswith("rotation")})
    check_unit(path, matrix, first, {"body rotations": fields["body rotations"]})
    labels = {name: field for name, field in fields.items() if name.endswith(("contact label", "contact labels"))}
    check_labels(path, matrix, labels, (-1, 6), _EXPECTED_LABELS)
    check_root(path, matrix, first, fields)


def _fields(names: tuple[str, ...]) -> dict[str, slice]:
    fields = dict(_PERSON)
    for index, name in enumerate(names):
        start = _FIRST_OBJECT + _WIDTH * index
        fields |= {f"{name}: {what}": slice(start + at.start, start + at.stop) for what, at in _OBJECT.items()}
    return fields


def person_of(
    matrix: Float[np.ndarray, "T columns"], path: Path
) -> tuple[Float[np.ndarray, "T 52 3"], Float[np.ndarray, "T 52 4"], bool]:
    """Return joint positions, joint rotations, and whether the file had these turned by the fixed rotation.

    Raises `ClipError` where limbs fit neither reading.
    """
    order = list(JOINT_ORDER)
    positions = matrix[:, _PERSON["body positions"]].reshape(-1, len(JOINTS), 3)[:, order]
    stored = se3.quat_from_xyzw(matrix[:, _PERSON["body rotations"]].reshape(-1, len(JOINTS), 4)[:, order])
    readings = (stored, se3.quat_multiply(stored, UPRIGHT_QUAT))
    fits = [rest_pose.agreement(positions, quats) for quats in readings]
    turned = fits[1] > fits[0]
    if max(fits) < rest_pose.LEAST_AGREEMENT:
        raise ClipError(
            f"{path}: body rotations (columns 318:526) do not fit the body positions (columns 162:318): in its "
            f"parent's frame a knee or an elbow lies {np.rad2deg(np.arccos(np.clip(max(fits), -1, 1))):.0f} deg from "
            "where SMPL-X's T-pose has it. Convert the clip again."
        )
    return positions, readings[turned], turned


def objects_of(matrix: Float[np.ndarray, "T columns"], names: tuple[str, ...]) -> Iterator[ObjectColumns]:
    """Yield the objects' columns in the order of their names."""
    for index, name in enumerate(names):
        block = matrix[:, _FIRST_OBJECT + _WIDTH * index : _FIRST_OBJECT + _WIDTH * (index + 1)]
        yield ObjectColumns(
            name,
            block[:, _OBJECT["position"]],
            se3.quat_from_xyzw(block[:, _OBJECT["rotation"]]),
            block[:, _OBJECT["body contact labels"]][:, list(JOINT_ORDER)],
        )


def geometry_of(objects: Path, name: str) -> ObjectGeometry:
    """Return the geometry called as the object is, or as the object whose main part it is; raises `GeometryError`."""
    try:
        return load_geometry(objects, name)
    except GeometryError:
        if mesh_name(name) == name:
            raise
        return load_geometry(objects, mesh_name(name))


def mesh_name(name: str) -> str:
    """Return what the mesh of an object is called, where none is called as the object itself."""
    return name.removesuffix(BASE) or name


def licence_of(value: Mapping[str, Any]) -> str:
    """Return the terms of the data; ParaHome's clips alone say which scene and interval they are."""
    metadata = value.get("metadata")
    is_parahome = isinstance(metadata, dict) and {"scene", "interval_key"} <= set(metadata)
    return PARAHOME_LICENCE if is_parahome else UNKNOWN_LICENCE


def label_notes(columns: tuple[ObjectColumns, ...], contacts: tuple[ContactTrack, ...]) -> tuple[str, ...]:
    """Return what the labels say that does not become contacts."""
    notes: tuple[str, ...] = ()
    used = {joint for part in PARTS.values() for joint in part.label_joints}
    for item in columns:
        touching = (item.joint_labels == CONTACT_LABEL).any(axis=0)
        others = [joint for joint, touches in zip(JOINTS, touching, strict=True) if touches and joint not in used]
        if others:
            notes += (f"{item.name} is also touched by {', '.join(others)}, which no part of the robot follows.",)
    graded = sum(int((item.joint_labels > CONTACT_LABEL).any(axis=1).sum()) for item in columns)
    if graded:
        notes += (f"Labels 2 to 6, in {graded} frame(s) of the objects, are graded nearness, not taken as contact.",)
    for part in PARTS:
        active = np.sum([track.active for track in contacts if track.part == part], axis=0)
        if (active > 1).any():
            notes += (f"{part} touches two objects at once in {(active > 1).sum()} frame(s); the first one counts.",)
    return notes


def content_notes(value: Mapping[str, Any], names: tuple[str, ...]) -> tuple[str, ...]:
    """Return what else the file says: its description, objects that it lacks, and articulated parts."""
    notes: tuple[str, ...] = ()
    metadata, joints = value.get("metadata"), value.get("joints")
    metadata = metadata if isinstance(metadata, dict) else {}
    if isinstance(metadata.get("expression"), str):
        notes += (f"Described as {metadata['expression'][:200]!r}.",)
    touched = metadata.get("contact_objects")
    absent = [str(name)[:40] for name in touched if name not in names] if isinstance(touched, list | tuple) else []
    if absent:
        notes += (f"Said to be touched, but not in the file: {', '.join(absent[:20])}.",)
    if isinstance(joints, dict) and joints:
        listing = ", ".join(str(name)[:40] for name in list(joints)[:20])
        notes += (f"Angles of articulated parts are not used: {listing}.",)
    return notes


READER = Reader(format=FORMAT, suffixes=(".pt", ".pth"), floor_at_zero=True, holds=holds, read=read_file)
