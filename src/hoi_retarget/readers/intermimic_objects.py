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
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import ClipError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.skeleton import FINGER_PARTS, JOINTS, PARTS
from hoi_retarget.readers import intermimic_layouts as layouts
from hoi_retarget.readers.reader import SourceRecording, Tracks

FORMAT = "intermimic-multi-object"
PARAHOME_LICENCE = "ParaHome: CC BY-NC-SA 4.0; repackaged by a fork of InterMimic, whose terms are not stated"
UNKNOWN_LICENCE = "not stated by the file; the layout is used for GRAB and ParaHome, both for non-commercial use"

_BODY: Mapping[str, int] = {**layouts.PERSON, "body rotations": 208}
_OBJECT: Mapping[str, int] = {
    "position": 3,
    "rotation": 4,
    "padding": 5,
    "own contact label": 1,
    "body contact labels": 52,
}


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
        and 0 < len(names) == layouts.object_count(data.shape[1])
    )


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the clip."""
    value, names = file.torch, tuple(file.torch["objects"])
    widths = {f"{name}: {field}": width for name in names for field, width in _OBJECT.items()}
    rows = layouts.Rows(file.path, value["data"].astype(float), layouts.column_table({**_BODY, **widths}))

    def read_tracks() -> Tracks:
        rows.check((-1, 6), "whole numbers from -1 (far) over 0 (near) and 1 (contact) to 6")
        if len(set(names)) < len(names):
            raise ClipError(
                f"{file.path}: two of its objects have one name ({', '.join(names)}). Convert the clip again."
            )
        person, turned = rows.person()
        labels, copied = _labels(rows, names)
        rotations = "turned by a fixed rotation" if turned else "those of SMPL-X"
        note = f"Body rotations are {rotations}, as the limbs tell."
        notes = (note, *copied, *_label_notes(labels))
        tracks = layouts.tracks_of(rows, person, labels, options.objects, notes)
        fingers = _touching_fingers(labels) if person.fingers_recorded else {}
        return replace(tracks, touching={**tracks.touching, **fingers})

    return layouts.recording_of(
        rows,
        names,
        licence=licence_of(value),
        read_tracks=read_tracks,
        notes=_content_notes(value, names),
        names_objects=True,
    )


def licence_of(value: Mapping[str, Any]) -> str:
    """Return the terms of the data; ParaHome's clips alone say which scene and interval they are."""
    metadata = value.get("metadata")
    is_parahome = isinstance(metadata, dict) and {"scene", "interval_key"} <= set(metadata)
    return PARAHOME_LICENCE if is_parahome else UNKNOWN_LICENCE


def _labels(rows: layouts.Rows, names: Sequence[str]) -> tuple[dict[str, Float[np.ndarray, "T 52"]], tuple[str, ...]]:
    """Return the bodies' labels by the objects' names in the frames in which its own label is contact, 0 elsewhere.

    Beside them, notes of objects with labels of others: GRAB's files repeat those of the held object for the table.
    """
    labels: dict[str, np.ndarray] = {}
    notes: tuple[str, ...] = ()
    for name in names:
        stored = rows.labels(f"{name}: body contact labels")
        touched = rows.used(f"{name}: own contact label") == layouts.CONTACT_LABEL
        others = int(((stored == layouts.CONTACT_LABEL).any(axis=1) & ~touched[:, 0]).sum())
        if others:
            notes += (f"{name} is not touched in {others} frame(s) by its own label: labels there are not used.",)
        labels[name] = np.where(touched | (stored != layouts.CONTACT_LABEL), stored, 0.0)
    return labels, notes


def _touching_fingers(labels: Mapping[str, Float[np.ndarray, "T 52"]]) -> dict[tuple[int, str], np.ndarray]:
    """Return when fingers touch objects; nothing where labels are grades of nearness, which come and go at fingers."""
    if any((values > layouts.CONTACT_LABEL).any() for values in labels.values()):
        return {}
    found = {
        (index, part): layouts.part_active(values, part)
        for index, values in enumerate(labels.values())
        for part in FINGER_PARTS
    }
    return {key: active for key, active in found.items() if active.any()}


def _label_notes(labels: Mapping[str, Float[np.ndarray, "T 52"]]) -> tuple[str, ...]:
    """Return notes of labels that do not become contacts."""
    notes: tuple[str, ...] = ()
    used = {joint for part in PARTS.values() for joint in part.label_joints}
    for name, values in labels.items():
        touching = (values == layouts.CONTACT_LABEL).any(axis=0)
        others = [joint for joint, touches in zip(JOINTS, touching, strict=True) if touches and joint not in used]
        if others:
            notes += (f"{name} is also touched by {', '.join(others)}, which no part of the robot follows.",)
    graded = sum(int((values > layouts.CONTACT_LABEL).any(axis=1).sum()) for values in labels.values())
    if graded:
        notes += (f"Labels 2 to 6, in {graded} frame(s) of the objects, are graded nearness, not taken as contact.",)
    for part in PARTS:
        active = np.sum([layouts.part_active(values, part) for values in labels.values()], axis=0)
        if (active > 1).any():
            notes += (f"{part} touches two objects at once in {(active > 1).sum()} frame(s); the first one counts.",)
    return notes


def _content_notes(value: Mapping[str, Any], names: tuple[str, ...]) -> tuple[str, ...]:
    """Return notes of the file's other content: its description, objects that it lacks, and articulated parts."""
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


READER = layouts.reader_of(FORMAT, record, holds)
