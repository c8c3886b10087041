"""Reads InterMimic's `.pt` clips of one person and one object: a tensor of 591 columns at 30 Hz.

The layout is what `simulation/interact2mimic.py` of the public InterAct repository writes and
InterMimic reads; it is z-up, in metres, with scalar-last quaternions. Body order is that of its
`smpl_2_mujoco`. The names of columns are `FIELDS`.

Two generations of files share the layout. The older ones (25 of 33 public OMOMO clips looked at)
took the 55 joint positions of SMPL-X for the 52 of SMPL-H: jaw and eyes stand in the place of the
left index finger, every finger stands three places late, and the right thumb is lost. It shows as
fingers far from their wrists; undone, all bones are constant in their parent's frame to 1e-6 m.
"""

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import MINIMUM_FRAMES, Clip, ContactTrack, Source
from hoi_retarget.errors import ClipError, GeometryError, ReadError
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.files.torch_file import parse_torch
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, LEFT_FINGERS, PARENT, PARTS, RIGHT_FINGERS
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import describe_frames
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers.object_files import load_geometry
from hoi_retarget.readers.reader import Reader, ReadOptions

FORMAT = "intermimic-591"
FPS = 30.0
"""[Hz]; the file does not state it, all tools that write or read the layout use it."""
LICENCE = "OMOMO: MIT; repackaged via InterAct: CC BY-NC-SA 4.0"

ADVICE = "Write the clip again, with one person and one object, by InterAct's simulation/interact2mimic.py."

COLUMNS = 591
FIELDS: dict[str, slice] = {
    "root position": slice(0, 3),
    "root rotation": slice(3, 7),
    "padding": slice(7, 9),
    "joint angles": slice(9, 162),
    "body positions": slice(162, 318),
    "object position": slice(318, 321),
    "object rotation": slice(321, 325),
    "second padding": slice(325, 330),
    "object contact label": slice(330, 331),
    "body contact labels": slice(331, 383),
    "body rotations": slice(383, 591),
}

BODIES: tuple[str, ...] = (
    "pelvis",
    *(f"left_{name}" for name in ("hip", "knee", "ankle", "foot")),
    *(f"right_{name}" for name in ("hip", "knee", "ankle", "foot")),
    *("spine1", "spine2", "spine3", "neck", "head"),
    *(f"left_{name}" for name in ("collar", "shoulder", "elbow", "wrist")),
    *LEFT_FINGERS,
    *(f"right_{name}" for name in ("collar", "shoulder", "elbow", "wrist")),
    *RIGHT_FINGERS,
)
"""The order of bodies in the file, in the names of `skeleton.JOINTS`."""

# Each rotation in the file was multiplied on the right by the inverse of this one (its four
# components are equal, so wxyz and xyzw are the same); multiplying by it restores SMPL-X's.
UPRIGHT_QUAT: Float[np.ndarray, "4"] = np.array([0.5, 0.5, 0.5, 0.5])
UPRIGHT_QUAT.setflags(write=False)

LARGEST_VALUE = 1e4
"""[m] or [rad]; numbers beyond it are damage."""
LONGEST_PALM = 0.25
"""[m]; no first finger bone begins farther from its wrist."""
ROOT_TOLERANCE = 1e-3
"""[m]; the root and the pelvis are the same point, up to rounding."""
ROOT_ANGLE_TOLERANCE = np.deg2rad(1.0)

JOINT_ORDER = tuple(BODIES.index(joint) for joint in JOINTS)
"""Where each of `skeleton.JOINTS` stands in the file."""
_FIRST_FINGER = JOINT_INDEX["left_index1"]
_LATE = 3  # jaw, left eye and right eye come between wrists and fingers in SMPL-X
_THUMB = ("thumb1", "thumb2", "thumb3")
_KNUCKLES = np.array([JOINT_INDEX[joint] for joint in JOINTS[_FIRST_FINGER:] if joint.endswith("1")])
_WRISTS = np.array([JOINT_INDEX[str(PARENT[JOINTS[knuckle]])] for knuckle in _KNUCKLES])
_FILE_NAME = re.compile(r"sub\d+_(?P<object>.+)_\d+")


@dataclass(frozen=True, eq=False)
class Recording:
    """The columns by their meaning; joints in the order of `skeleton.JOINTS`, quaternions wxyz, nothing checked."""

    joint_positions: Float[np.ndarray, "T 52 3"]
    joint_quats: Float[np.ndarray, "T 52 4"]
    object_positions: Float[np.ndarray, "T 3"]
    object_quats: Float[np.ndarray, "T 4"]
    joint_labels: Float[np.ndarray, "T 52"]
    """1 contact, 0 near or do not care, -1 far."""
    object_labels: Float[np.ndarray, "T"]
    late_fingers: bool
    """Whether the finger positions stood three places late and were put right."""


def read(path: Path, *, objects: Path | None = None, object_name: str | None = None) -> Clip:
    """Return the clip in `path`, with the geometry of its object from the folder `objects`.

    Leading frames that are zero throughout are dropped, as some conversions begin with one. The
    object's name is `object_name`, or else in the file's name, `sub<N>_<object>_<n>.pt`.

    Raises:
        ReadError: the file is missing, damaged, or of another layout.
        ClipError: numbers are not finite, rotations zero, labels unknown, or parts contradict each other.
        GeometryError: the object has no name, or its geometry cannot be had.
    """
    content = read_bytes(path)
    return clip_of(parse_torch(content, path), path, content, objects=objects, object_name=object_name)


def holds(file: SourceFile) -> bool:
    """Return whether a torch file is one tensor of this layout's width."""
    return isinstance(file.torch, np.ndarray) and file.torch.ndim == 2 and file.torch.shape[1] == COLUMNS


def read_file(file: SourceFile, options: ReadOptions) -> Clip:
    """Return the clip of an opened file; otherwise as `read`."""
    return clip_of(file.torch, file.path, file.content, objects=options.objects, object_name=options.object_name)


def clip_of(
    value: Any, path: Path, content: bytes, *, objects: Path | None = None, object_name: str | None = None
) -> Clip:
    """Return the clip that the value in a torch file is; otherwise as `read`."""
    matrix = matrix_of(value, path)
    first = leading_zero_frames(matrix)
    check(path, matrix, first)
    recording = split(matrix[first:])
    check_hands(path, recording.joint_positions, first)
    name = object_name or name_in_file_name(path)
    if name is None:
        raise GeometryError(
            f"{path}: the object's name is not in the file's name, expected sub<N>_<object>_<n>.pt. Pass --object NAME."
        )
    if objects is None:
        raise GeometryError(
            f"{path}: the clip needs the geometry of its object {name!r}. "
            f"Pass --objects DIR with {name}/{name}.obj or {name}/sample_points.npy in it."
        )
    track = ObjectTrack(name, recording.object_positions, recording.object_quats, load_geometry(objects, name))
    person = Person("person", recording.joint_positions, recording.joint_quats)
    notes = (f"The object's name is from {'the argument' if object_name else 'the file name'}.", *_notes(recording))
    if first:
        notes += (f"{first} leading frame(s) without data were dropped.",)
    return Clip(
        name=path.stem,
        fps=FPS,
        people=(person,),
        objects=(track,),
        contacts=tuple(_contact(recording, person, track, part) for part in PARTS),
        source=Source(str(path), hashlib.sha256(content).hexdigest(), FORMAT, LICENCE, notes),
        first_source_frame=first,
    )


def name_in_file_name(path: Path) -> str | None:
    """Return the object's name in `sub<N>_<object>_<n>.pt`, or None."""
    match = _FILE_NAME.fullmatch(path.stem)
    return match["object"] if match else None


def matrix_of(value: Any, path: Path) -> Float[np.ndarray, "T 591"]:
    """Return the clip's tensor in double precision; raises `ReadError` naming the layout if it is another."""
    expected = f"expected one tensor of {COLUMNS} columns, a frame in each row ({FORMAT})"
    if not isinstance(value, np.ndarray):
        raise ReadError(f"{path}: the file holds {describe_other(value)}; {expected}. {ADVICE}")
    if value.ndim != 2 or value.dtype.kind != "f":
        raise ReadError(
            f"{path}: the tensor has shape {value.shape} and type {value.dtype}; {expected}, of floating-point "
            f"numbers. {ADVICE}"
        )
    if value.shape[1] != COLUMNS:
        raise ReadError(f"{path}: {describe_columns(value.shape[1])}; {expected}. {ADVICE}")
    return value.astype(float)


def describe_columns(columns: int) -> str:
    """Return what a tensor with this number of columns is known to be."""
    if columns == 594:
        return "the tensor has 594 columns: this looks like Theia's layout with two objects, which is not supported"
    if object_count(columns):
        return (
            f"the tensor has {columns} columns: this looks like InterMimic's multi-object layout "
            f"(526 + 65 for each of {object_count(columns)} objects) without the dictionary that names the objects"
        )
    return f"the tensor has {columns} columns, which is no layout known here"


def describe_other(value: Any) -> str:
    """Return what a torch file's content is when it is not one tensor."""
    if not isinstance(value, dict):
        name = type(value).__name__
        return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"
    keys = ", ".join(ascii(key)[:40] for key in list(value)[:6])
    data = value.get("data")
    if isinstance(data, np.ndarray) and data.ndim == 2 and object_count(data.shape[1]) and "objects" in value:
        return (
            f"a dictionary ({keys}): this looks like InterMimic's multi-object layout with "
            f"{object_count(data.shape[1])} object(s)"
        )
    return f"a dictionary ({keys})"


def object_count(columns: int) -> int:
    """Return the number of objects in a row of the multi-object layout, 0 where it is another layout."""
    return (columns - 526) // 65 if columns > 526 and (columns - 526) % 65 == 0 else 0


def leading_zero_frames(matrix: Float[np.ndarray, "T columns"]) -> int:
    """Return how many frames at the beginning are zero throughout."""
    filled = np.flatnonzero(matrix.any(axis=1))
    return int(filled[0]) if len(filled) else len(matrix)


def split(matrix: Float[np.ndarray, "T 591"]) -> Recording:
    """Return the columns by their meaning."""
    frames = len(matrix)
    columns = {name: matrix[:, field] for name, field in FIELDS.items()}
    stored = columns["body positions"].reshape(frames, 52, 3)[:, list(JOINT_ORDER)]
    body_quats = se3.quat_from_xyzw(columns["body rotations"].reshape(frames, 52, 4)[:, list(JOINT_ORDER)])
    quats = se3.quat_multiply(body_quats, UPRIGHT_QUAT)
    late = has_late_fingers(stored)
    return Recording(
        joint_positions=_without_delay(stored, quats) if late else stored,
        joint_quats=quats,
        object_positions=columns["object position"],
        object_quats=se3.quat_from_xyzw(columns["object rotation"]),
        joint_labels=columns["body contact labels"][:, list(JOINT_ORDER)],
        object_labels=columns["object contact label"][:, 0],
        late_fingers=late,
    )


def has_late_fingers(positions: Float[np.ndarray, "T 52 3"]) -> bool:
    """Return whether fingers are hands' breadths from their wrists only when each is read three places later."""
    present = len(JOINTS) - _LATE > _KNUCKLES
    late = np.linalg.norm(positions[:, _KNUCKLES[present] + _LATE] - positions[:, _WRISTS[present]], axis=-1)
    return bool(_palm_lengths(positions).max() > LONGEST_PALM >= late.max())


def _palm_lengths(positions: Float[np.ndarray, "T 52 3"]) -> Float[np.ndarray, "T 10"]:
    return np.linalg.norm(positions[:, _KNUCKLES] - positions[:, _WRISTS], axis=-1)


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


def check(path: Path, matrix: Float[np.ndarray, "T 591"], first: int) -> None:
    """Raise `ClipError` unless all frames from `first` on can be used; frames are counted from the file's first."""
    check_frames(path, matrix, first)
    check_numbers(path, matrix, FIELDS)
    _check_rotations(path, matrix, first)
    labels = ("object contact label", "body contact labels")
    check_labels(path, matrix, {name: FIELDS[name] for name in labels}, (-1, 1), "-1 (far), 0 (near) or 1 (contact)")
    check_root(path, matrix, first, FIELDS)


def check_frames(path: Path, matrix: Float[np.ndarray, "T columns"], first: int) -> None:
    """Raise `ClipError` unless there are enough frames from `first` on, and data in all of them."""
    usable = len(matrix) - first
    if usable < MINIMUM_FRAMES:
        zero = f", {first} of them zero throughout" if first else ""
        raise ClipError(
            f"{path}: {len(matrix)} frame(s){zero}; at least {MINIMUM_FRAMES} usable ones are needed. "
            "Use a longer recording."
        )
    zero = ~_any_in_frame(matrix != 0)
    zero[:first] = False
    last = int(np.flatnonzero(~zero)[-1])
    if zero[last:].any() and not zero[:last].any():
        raise ClipError(
            f"{path}: {_frames(zero)} at the end hold zeros only: data are missing there. "
            f"Cut them off: tensor[:{last + 1}]."
        )
    if zero.any():
        raise ClipError(
            f"{path}: {_frames(zero)} in the middle hold zeros only: data are missing there. Cut the clip there."
        )


def check_numbers(path: Path, matrix: Float[np.ndarray, "T columns"], fields: Mapping[str, slice]) -> None:
    """Raise `ClipError` where a number is not finite or too large for metres, radians and quaternions."""
    for name, field in fields.items():
        values = matrix[:, field]
        bad = _any_in_frame(~(np.abs(values) <= LARGEST_VALUE))  # Not a number compares as False.
        if bad.any():
            how = f"exceeds {LARGEST_VALUE:g}" if np.isfinite(values).all() else "is not finite"
            raise ClipError(
                f"{path}: {name} (columns {field.start}:{field.stop}) {how} in {_frames(bad)}, expected metres, "
                "radians and unit quaternions. Cut those frames or convert the clip again."
            )


def check_hands(path: Path, positions: Float[np.ndarray, "T 52 3"], first: int) -> None:
    """Raise `ClipError` where fingers are farther from their wrists than any hand is long."""
    lengths = _palm_lengths(positions)
    far = _any_in_frame(lengths > LONGEST_PALM)
    if far.any():
        raise ClipError(
            f"{path}: fingers begin up to {lengths.max():.3g} m from their wrists in "
            f"{describe_frames(np.flatnonzero(far) + first)}, expected at most {LONGEST_PALM:g} m: the body positions "
            "(columns 162:318) are in another order or another unit. Convert the clip again."
        )


def _any_in_frame(mask: Bool[np.ndarray, "T *rest"]) -> Bool[np.ndarray, "T"]:
    return np.asarray(mask.reshape(len(mask), -1).any(axis=1))


def _frames(bad: Bool[np.ndarray, "T"]) -> str:
    return describe_frames(np.flatnonzero(bad))


def _check_rotations(path: Path, matrix: Float[np.ndarray, "T 591"], first: int) -> None:
    fields = {name: FIELDS[name] for name in ("root rotation", "object rotation", "body rotations")}
    try:
        check_unit(path, matrix, first, fields)
    except ClipError as error:
        if not _is_multi_object(matrix[first:]):
            raise
        raise ReadError(
            f"{path}: the tensor has {COLUMNS} columns in the order of InterMimic's multi-object layout "
            f"(rotations in columns 318:526), expected that of {FORMAT} (rotations in 383:591). {ADVICE}"
        ) from error


def check_unit(path: Path, matrix: Float[np.ndarray, "T columns"], first: int, fields: Mapping[str, slice]) -> None:
    """Raise `ClipError` where a rotation is no unit quaternion in a frame from `first` on."""
    for name, field in fields.items():
        lengths = np.linalg.norm(matrix[:, field].reshape(len(matrix), -1, 4), axis=-1)
        # Single precision leaves far less than a percent.
        bad = np.abs(lengths - 1.0) > 0.01
        bad[:first] = False
        if not bad.any():
            continue
        worst = lengths[bad].min() if lengths[bad].min() < 0.99 else lengths[bad].max()
        of = f" of {', '.join(np.array(BODIES)[bad.any(axis=0)][:5])}" if name == "body rotations" else ""
        raise ClipError(
            f"{path}: {name}{of} (columns {field.start}:{field.stop}) in {_frames(_any_in_frame(bad))} "
            f"{'is zero' if worst < 1e-6 else f'has length {worst:.4g}'}, expected unit quaternions. "
            "Cut those frames or convert the clip again."
        )


def _is_multi_object(matrix: Float[np.ndarray, "T 591"]) -> bool:
    """Return whether the columns are those of the multi-object layout, which has 591 of them for one object."""
    lengths = np.linalg.norm(matrix[:, 318:526].reshape(len(matrix), 52, 4), axis=-1)
    return bool((np.abs(lengths - 1.0) < 0.01).all())


def check_labels(
    path: Path,
    matrix: Float[np.ndarray, "T columns"],
    fields: Mapping[str, slice],
    limits: Sequence[int],
    expected: str,
) -> None:
    """Raise `ClipError` where a label is no whole number within the limits."""
    for name, field in fields.items():
        labels = matrix[:, field]
        bad = (labels != np.round(labels)) | (labels < limits[0]) | (labels > limits[1])
        if bad.any():
            values = ", ".join(f"{value:g}" for value in np.unique(labels[bad])[:5])
            raise ClipError(
                f"{path}: {name} (columns {field.start}:{field.stop}) has the value(s) {values} in "
                f"{_frames(_any_in_frame(bad))}, expected {expected}. Convert the clip again."
            )


def check_root(path: Path, matrix: Float[np.ndarray, "T columns"], first: int, fields: Mapping[str, slice]) -> None:
    """Raise `ClipError` where the root's pose is not that of the pelvis."""
    body = fields["body positions"].start
    apart = np.linalg.norm(matrix[:, fields["root position"]] - matrix[:, body : body + 3], axis=1)
    if (apart > ROOT_TOLERANCE).any():
        raise ClipError(
            f"{path}: the root position (columns 0:3) and that of the pelvis (columns {body}:{body + 3}) are up to "
            f"{apart.max():.3g} m apart in {_frames(apart > ROOT_TOLERANCE)}, expected the same point: the file "
            "contradicts itself. Convert the clip again."
        )
    body = fields["body rotations"].start
    used = matrix[first:]
    angle = np.zeros(len(matrix))
    angle[first:] = se3.angle_between(
        se3.quat_from_xyzw(used[:, fields["root rotation"]]), se3.quat_from_xyzw(used[:, body : body + 4])
    )
    if (angle > ROOT_ANGLE_TOLERANCE).any():
        raise ClipError(
            f"{path}: the root rotation (columns 3:7) and that of the pelvis (columns {body}:{body + 4}) differ by up "
            f"to {np.rad2deg(angle.max()):.3g} deg in {_frames(angle > ROOT_ANGLE_TOLERANCE)}, expected the same: the "
            "file contradicts itself. Convert the clip again."
        )


def part_active(joint_labels: Float[np.ndarray, "T 52"], part: str) -> Bool[np.ndarray, "T"]:
    """Return the frames in which any joint that stands for the part is labelled 1."""
    indices = [JOINTS.index(joint) for joint in PARTS[part].label_joints]
    return _any_in_frame(joint_labels[:, indices] == 1)


def _contact(recording: Recording, person: Person, track: ObjectTrack, part: str) -> ContactTrack:
    return ContactTrack(
        person=0,
        object=0,
        part=part,
        active=part_active(recording.joint_labels, part),
        contact_points=track.to_object(person.part_position(part)),
    )


def _notes(recording: Recording) -> tuple[str, ...]:
    """Return what the two kinds of labels say against each other; the object's own label is not used."""
    body = (recording.joint_labels == 1).any(axis=1)
    item = recording.object_labels == 1
    notes = ()
    if recording.late_fingers:
        notes += (
            "Finger positions stood three places late, as an older conversion wrote them, and were put right; "
            "the right thumb, which such files lack, mirrors the left one.",
        )
    if (body & ~item).any():
        notes += (f"{(body & ~item).sum()} frame(s) label a body in contact, but not the object.",)
    if (item & ~body).any():
        notes += (f"{(item & ~body).sum()} frame(s) label the object in contact, but no body.",)
    return notes


READER = Reader(format=FORMAT, suffixes=(".pt", ".pth"), floor_at_zero=True, holds=holds, read=read_file)
