"""Reads InterMimic's `.pt` clips of one person and one object: a tensor of the 591 columns in `FIELDS`.

Two generations of files share the layout. The older ones (25 of 33 public OMOMO clips looked at)
took the 55 joint positions of SMPL-X for the 52 of SMPL-H: jaw and eyes stand in the place of the
left index finger, every finger stands three places late, and the right thumb is lost. It shows as
fingers far from their wrists; undone, all bones are constant in their parent's frame to 1e-6 m.
"""

import re
from typing import Any

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.errors import GeometryError, ReadError
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT
from hoi_retarget.numerics import se3
from hoi_retarget.readers import intermimic_layouts as layouts
from hoi_retarget.readers.reader import SourceRecording, Tracks

FORMAT = "intermimic-591"
LICENCE = "OMOMO: MIT; repackaged via InterAct: CC BY-NC-SA 4.0"
COLUMNS = 591
FIELDS = layouts.column_table(
    {
        **layouts.PERSON,
        "object position": 3,
        "object rotation": 4,
        "second padding": 5,
        "object contact label": 1,
        "body contact labels": 52,
        "body rotations": 208,
    }
)

_ADVICE = "Write the clip again, with one person and one object, by InterAct's simulation/interact2mimic.py."
_FIRST_FINGER = JOINT_INDEX["left_index1"]
_LATE = 3  # jaw, left eye and right eye come between wrists and fingers in SMPL-X
_THUMB = ("thumb1", "thumb2", "thumb3")
_FILE_NAME = re.compile(r"(?:.*?_)??sub(?P<subject>\d+)_(?P<object>.+)_\d+")
# Of OMOMO's subjects 1 to 17 [m], as amazon-far/holosoma has them; a skeleton gives them within 2.2 cm.
_STATURES = (
    *(1.664, 1.844, 1.941, 1.790, 1.817, 1.762, 1.808, 1.845, 1.753),
    *(1.651, 1.767, 1.803, 1.811, 1.826, 1.685, 1.723, 1.737),
)
_MAX_STATURE_DIFFERENCE = 0.05  # [m]
_OMOMO_OBJECTS = (
    *("clothesstand", "floorlamp", "largebox", "largetable", "monitor", "mop", "plasticbox", "smallbox"),
    *("smalltable", "suitcase", "trashcan", "tripod", "vacuum", "whitechair", "woodchair"),
)


def holds(file: SourceFile) -> bool:
    """Return whether a torch file is one tensor of this layout's width."""
    return layouts.is_table(file.torch, FIELDS)


def record(file: SourceFile, options: ReadOptions) -> SourceRecording:
    """Return the clip; its object is named by `options.object_name`, or by the file, `sub<N>_<object>_<n>.pt`.

    Raises `ReadError` where the file is of another layout.
    """
    rows = _rows(file)
    match = _FILE_NAME.fullmatch(file.path.stem)
    name = options.object_name or (match["object"] if match else "")

    def read_tracks() -> Tracks:
        rows.check()
        if not name:
            raise GeometryError(
                f"{file.path}: the object's name is not in the file's name, expected sub<N>_<object>_<n>.pt. "
                "Pass --object NAME."
            )
        person, late = _person(rows)
        labels = rows.labels("body contact labels")
        notes = (
            f"The object's name is from {'the argument' if options.object_name else 'the file name'}.",
            *_notes(labels, rows.used("object contact label")[:, 0], late),
            *_stature_notes(int(match["subject"]) if match and name in _OMOMO_OBJECTS else 0, person),
        )
        return layouts.tracks_of(rows, person, {name: labels}, options.objects, notes)

    return layouts.recording_of(rows, (name,) if name else (), licence=LICENCE, read_tracks=read_tracks)


def _rows(file: SourceFile) -> layouts.Rows:
    """Return the clip's rows in double precision; raises `ReadError` naming the layout if it is another."""
    value = file.torch
    if not layouts.is_table(value, FIELDS) or value.dtype.kind != "f":
        raise ReadError(
            f"{file.path}: the file holds {describe(value)}; expected one tensor of {COLUMNS} columns of "
            f"floating-point numbers, a frame in each row ({FORMAT}). {_ADVICE}"
        )
    rows = layouts.Rows(file.path, value.astype(float), FIELDS)
    if _is_multi_object(rows):
        raise ReadError(
            f"{file.path}: the tensor has {COLUMNS} columns in the order of InterMimic's multi-object layout "
            f"(rotations in columns 318:526), expected that of {FORMAT} (rotations in 383:591). {_ADVICE}"
        )
    return rows


def describe(value: Any) -> str:
    """Return a description of a torch file's content that is of no layout that is read."""
    if isinstance(value, np.ndarray):
        known = f": {_describe_columns(value.shape[1])}" if value.ndim == 2 and value.shape[1] != COLUMNS else ""
        return f"one tensor of shape {value.shape} and type {value.dtype}{known}"
    if not isinstance(value, dict):
        name = type(value).__name__
        return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"
    keys = ", ".join(ascii(key)[:40] for key in list(value)[:6])
    data = value.get("data")
    count = layouts.object_count(data.shape[1]) if isinstance(data, np.ndarray) and data.ndim == 2 else 0
    looks = f": this looks like InterMimic's multi-object layout with {count} object(s)"
    return f"a dictionary ({keys}){looks if count and 'objects' in value else ''}"


def _describe_columns(columns: int) -> str:
    if columns == 337:
        return (
            "it has 337 columns and looks like SkillMimic's layout, whose 53 bodies are of a humanoid of its own; "
            "PhysHOI's, with 331 columns and SMPL-X's bodies, is read"
        )
    if count := layouts.object_count(columns):
        return (
            f"it has {columns} columns and looks like InterMimic's multi-object layout "
            f"(526 + 65 for each of {count} objects) without the dictionary that names the objects"
        )
    return f"it has {columns} columns, which is no layout known here"


def _is_multi_object(rows: layouts.Rows) -> bool:
    """Return whether the columns are those of the multi-object layout, which has 591 of them for one object."""
    used = rows.values[rows.first :, 318:526]
    with np.errstate(over="ignore"):  # Damage may hold any number.
        lengths = np.linalg.norm(used.reshape(len(used), 52, 4), axis=-1)
    return len(used) > 0 and bool((np.abs(lengths - 1.0) < 0.01).all())


def _person(rows: layouts.Rows) -> tuple[Person, bool]:
    """Return the person, and whether the file has finger positions three places late; raises `ClipError`."""
    positions, quats = (
        rows.vectors("body positions"),
        se3.quat_multiply(rows.rotations("body rotations"), layouts.UPRIGHT_QUAT),
    )
    late = _has_late_fingers(positions)
    if late:
        positions = _without_delay(positions, quats)
    rows.check_hands(positions)
    return Person("person", positions, quats, fingers_recorded=layouts.fingers_move(quats)), late


def _has_late_fingers(positions: Float[np.ndarray, "T 52 3"]) -> bool:
    """Return whether fingers are hands' breadths from their wrists only when each is read three places later."""
    present = len(JOINTS) - _LATE > layouts.KNUCKLES
    late = np.linalg.norm(
        positions[:, layouts.KNUCKLES[present] + _LATE] - positions[:, layouts.WRISTS[present]], axis=-1
    )
    return bool(layouts.palm_lengths(positions).max() > layouts.MAX_PALM_LENGTH >= late.max())


def _without_delay(
    stored: Float[np.ndarray, "T 52 3"], quats: Float[np.ndarray, "T 52 4"]
) -> Float[np.ndarray, "T 52 3"]:
    """Return positions with the fingers in their places and the right thumb, which is lost, as the left's mirror image.

    The hands of SMPL-X mirror each other to about 2 mm.
    """
    positions = stored.copy()
    positions[:, _FIRST_FINGER:-_LATE] = stored[:, _FIRST_FINGER + _LATE :]
    for bone in _THUMB:
        joint, parent = JOINT_INDEX[f"left_{bone}"], JOINT_INDEX[str(PARENT[f"left_{bone}"])]
        offset = se3.rotate_inverse(quats[:, parent], positions[:, joint] - positions[:, parent])
        joint, parent = JOINT_INDEX[f"right_{bone}"], JOINT_INDEX[str(PARENT[f"right_{bone}"])]
        positions[:, joint] = positions[:, parent] + se3.rotate(quats[:, parent], offset * [-1.0, 1.0, 1.0])
    return positions


def _notes(
    joint_labels: Float[np.ndarray, "T 52"], object_labels: Float[np.ndarray, "T"], late_fingers: bool
) -> tuple[str, ...]:
    """Return notes of contradictions between the bodies' labels and the object's own one, which is not used."""
    body = (joint_labels == layouts.CONTACT_LABEL).any(axis=1)
    item = object_labels == layouts.CONTACT_LABEL
    notes = ()
    if late_fingers:
        notes += (
            "Finger positions stood three places late, as an older conversion wrote them, and were put right; "
            "the right thumb, which such files lack, mirrors the left one.",
        )
    if (body & ~item).any():
        notes += (f"{(body & ~item).sum()} frame(s) label a body in contact, but not the object.",)
    if (item & ~body).any():
        notes += (f"{(item & ~body).sum()} frame(s) label the object in contact, but no body.",)
    return notes


def _stature_notes(subject: int, person: Person) -> tuple[str, ...]:
    """Return whether the skeleton is another one than that of an OMOMO subject, 0 where that is not known."""
    if not 0 < subject <= len(_STATURES) or abs(person.height - _STATURES[subject - 1]) <= _MAX_STATURE_DIFFERENCE:
        return ()
    return (
        f"The skeleton is {person.height:.2f} m tall, OMOMO's subject {subject} {_STATURES[subject - 1]:.2f} m: the "
        "motion was put onto another body. All sizes follow the skeleton in the file.",
    )


READER = layouts.reader_of(FORMAT, record, holds)
