"""Reads InterMimic's `.pt` clips of one person and several objects, as its forks for GRAB and ParaHome have them.

A dictionary with `data`, one row of 526 + 65 n columns a frame, and `objects`, the names of the n
objects. Up to column 318 rows are those of the layout with one object; then come the bodies'
rotations, then for each object its position, its rotation, a padding, its own label, and a label for
each body.

Labels go from -1 to 6. Measured on twenty ParaHome clips, the joint is 1.5 cm from the object at
label 1, and farther with each number up to 4.7 cm at 6; nobody says what these stand for. Only 1
counts as contact here, in frames in which the object's own label is 1, too.

Some of these files hold the bodies' rotations as SMPL-X has them, others, like all files with one
object, turned by a fixed rotation. The limbs tell which: in SMPL-X's T-pose arms lie along x and
legs along -y.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import Clip, Source
from hoi_retarget.clip.grasp_check import READINGS
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError, GeometryError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINTS, PARTS
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.readers.companions import refuse_object_name
from hoi_retarget.readers.intermimic_rows import (
    CONTACT_LABEL,
    PERSON,
    Rows,
    clip_of,
    object_count,
    outline_of,
    part_active,
)
from hoi_retarget.readers.object_files import load_geometry
from hoi_retarget.readers.reader import Outline, Reader, never_has_companions

FORMAT = "intermimic-multi-object"
PARAHOME_LICENCE = "ParaHome: CC BY-NC-SA 4.0; repackaged by a fork of InterMimic, whose terms are not stated"
UNKNOWN_LICENCE = "not stated by the file; the layout is used for GRAB and ParaHome, both for non-commercial use"
BASE = "_base"
"""Ending of ParaHome's name for the main part of an object; the mesh has the object's name."""

_OBJECT: Mapping[str, slice] = {
    "position": slice(0, 3),
    "rotation": slice(3, 7),
    "padding": slice(7, 12),
    "own contact label": slice(12, 13),
    "body contact labels": slice(13, 65),
}
_FIRST_OBJECT, _WIDTH = 526, 65
_LABELS = "whole numbers from -1 (far) over 0 (near) and 1 (contact) to 6"


def holds(file: SourceFile) -> bool:
    """Return whether a torch file is a dictionary of this layout, as far as names and shapes tell."""
    value = file.torch
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


def read_file(file: SourceFile, options: ReadOptions) -> Clip:
    """Return the clip, with the geometry of its objects from `options.objects`.

    Raises:
        ReadError: the file is missing or damaged.
        ClipError: numbers are not finite, rotations zero, labels unknown, or parts contradict each other.
        GeometryError: the geometry of an object cannot be had.
        ArgumentError: an object's name is given, although the file names its objects.
    """
    names = _names(file)
    refuse_object_name(file, options, ", ".join(names))
    if len(set(names)) < len(names):
        raise ClipError(f"{file.path}: two of its objects have one name ({', '.join(names)}). Convert the clip again.")
    rows = _rows(file)
    rows.check((-1, 6), _LABELS)
    positions, quats, turned = rows.person()
    if options.objects is None:
        wanted = ", ".join(f"{_mesh_name(name)}/{_mesh_name(name)}.obj" for name in names)
        raise GeometryError(
            f"{file.path}: the clip needs the geometry of its objects. Pass --objects DIR with {wanted} in it."
        )
    tracks = tuple(
        ObjectTrack(name, *rows.track(f"{name}: position", f"{name}: rotation"), _geometry(options.objects, name))
        for name in names
    )
    labels, copied = _labels(rows, names)
    notes = (
        f"Body rotations are {'turned by a fixed rotation' if turned else 'those of SMPL-X'}, as the limbs tell.",
        *copied,
        *_label_notes(names, labels),
        *_content_notes(file.torch, names),
    )
    person = Person("person", positions, quats)
    source = Source(str(file.path), file.sha256, FORMAT, licence_of(file.torch), notes)
    return clip_of(rows, person, tracks, labels, source)


def outline(file: SourceFile) -> Outline:
    """Return what the clip holds."""
    names = _names(file)
    return outline_of(_rows(file), names, licence_of(file.torch), _content_notes(file.torch, names))


def _names(file: SourceFile) -> tuple[str, ...]:
    return tuple(file.torch["objects"])


def _rows(file: SourceFile) -> Rows:
    fields = {**PERSON, "body rotations": slice(318, _FIRST_OBJECT)}
    for index, name in enumerate(_names(file)):
        start = _FIRST_OBJECT + _WIDTH * index
        fields |= {f"{name}: {what}": slice(start + at.start, start + at.stop) for what, at in _OBJECT.items()}
    return Rows(file.path, file.torch["data"].astype(float), fields)


def _geometry(objects: Path, name: str) -> ObjectGeometry:
    """Return the geometry called as the object is, or as the object whose main part it is; raises `GeometryError`."""
    try:
        return load_geometry(objects, name)
    except GeometryError:
        if _mesh_name(name) == name:
            raise
        return load_geometry(objects, _mesh_name(name))


def _mesh_name(name: str) -> str:
    """Return what the mesh of an object is called, where none is called as the object itself."""
    return name.removesuffix(BASE) or name


def licence_of(value: Mapping[str, Any]) -> str:
    """Return the terms of the data; ParaHome's clips alone say which scene and interval they are."""
    metadata = value.get("metadata")
    is_parahome = isinstance(metadata, dict) and {"scene", "interval_key"} <= set(metadata)
    return PARAHOME_LICENCE if is_parahome else UNKNOWN_LICENCE


def _labels(rows: Rows, names: Sequence[str]) -> tuple[list[Float[np.ndarray, "T 52"]], tuple[str, ...]]:
    """Return the bodies' labels for each object in the frames in which its own label is contact, 0 elsewhere.

    Beside them, which objects have labels that are not theirs: GRAB's files repeat those of the held thing for the
    table.
    """
    labels: list[np.ndarray] = []
    notes: tuple[str, ...] = ()
    for name in names:
        stored = rows.labels(f"{name}: body contact labels")
        touched = rows.used(f"{name}: own contact label") == CONTACT_LABEL
        others = int(((stored == CONTACT_LABEL).any(axis=1) & ~touched[:, 0]).sum())
        if others:
            notes += (f"{name} is not touched in {others} frame(s) by its own label: labels there are not used.",)
        labels.append(np.where(touched | (stored != CONTACT_LABEL), stored, 0.0))
    return labels, notes


def _label_notes(names: Sequence[str], labels: Sequence[Float[np.ndarray, "T 52"]]) -> tuple[str, ...]:
    """Return what the labels say that does not become contacts."""
    notes: tuple[str, ...] = ()
    used = {joint for part in PARTS.values() for joint in part.label_joints}
    for name, values in zip(names, labels, strict=True):
        touching = (values == CONTACT_LABEL).any(axis=0)
        others = [joint for joint, touches in zip(JOINTS, touching, strict=True) if touches and joint not in used]
        if others:
            notes += (f"{name} is also touched by {', '.join(others)}, which no part of the robot follows.",)
    graded = sum(int((values > CONTACT_LABEL).any(axis=1).sum()) for values in labels)
    if graded:
        notes += (f"Labels 2 to 6, in {graded} frame(s) of the objects, are graded nearness, not taken as contact.",)
    for part in PARTS:
        active = np.sum([part_active(values, part) for values in labels], axis=0)
        if (active > 1).any():
            notes += (f"{part} touches two objects at once in {(active > 1).sum()} frame(s); the first one counts.",)
    return notes


def _content_notes(value: Mapping[str, Any], names: tuple[str, ...]) -> tuple[str, ...]:
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


READER = Reader(
    format=FORMAT,
    suffixes=(".pt", ".pth"),
    floor_at_zero=True,
    rotation_readings=tuple(READINGS),
    holds=holds,
    read=read_file,
    outline=outline,
    has_companions=never_has_companions,
)
