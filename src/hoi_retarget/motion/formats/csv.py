"""Tables of comma-separated values, a frame a row.

- `named-csv`: a header names the columns of root, joints and times, in any order.
- `bones-seed`: centimetres and degrees, the root's rotation as angles about the world's x, y, z axes.
- `unitree-csv`: root (rotation xyzw) and joints without header or rate, as both csv_to_npz scripts read them.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats.containers import CSV, HEADER, TABLE, ArraysByName, has
from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.formats.motion_file import LARGEST, MIN_COLUMNS, Convention
from hoi_retarget.motion.links import source_joints
from hoi_retarget.motion.resample import ResampledMotion
from hoi_retarget.numerics import se3

_ROOT = {"", "root", "base", "pelvis", "floating", "free", "joint", "body", "global", "world", "xyz", "wxyz", "xyzw"}
_POSITION = {"p", "t", "pos", "position", "trans", "translate", "translation"}
_ROTATION = {"q", "r", "quat", "quaternion", "rot", "rotate", "rotation", "ori", "orn", "orientation"}
_COUNTERS = {"frame", "frame_id", "frame_index", "index", "idx", "step"}
_SECONDS = {"time", "timestamp", "time_s", "seconds"}
_LAST = re.compile(r"([a-z]*?)([wxyz])")
_NUMBERED = re.compile(r"(?:joint|dof|joint_pos|dof_pos|joint_vel|dof_vel|q|dq)_?(\d+)")
_ANGLE = re.compile(r"_(dof|pos|position|angle|rad)$", re.IGNORECASE)
Columns = tuple[int, ...]


@dataclass(frozen=True)
class NamedColumns:
    """The meanings of a table's columns, by their places."""

    positions: tuple[Columns, ...]  # Of x, y, z; more than one where several may be the root's.
    quaternions: tuple[Columns, ...]  # Of w, x, y, z.
    angles: tuple[Columns, ...]  # Of rotations by three angles, about x, y, z.
    joints: Columns
    joint_names: tuple[str, ...] | None  # Of columns that are nothing else; None where they are numbered.
    times: int | None  # Of the frames [s].

    @property
    def has_root(self) -> bool:
        """Whether the root's path is there, and only one."""
        return len(self.positions) == len(self.quaternions) == 1


def named_columns(header: Sequence[str]) -> NamedColumns:
    """Return the meanings of the columns under a header; no robot is known here."""
    words = [
        re.sub(r"[^a-z0-9]+", "_", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()).strip("_") for name in header
    ]
    groups: dict[str, dict[str, int]] = {}
    rest: list[int] = []
    for index, word in enumerate(words):
        component = _component(word)
        if component is not None:
            groups.setdefault(component[0], {})[component[1]] = index
        elif word not in _COUNTERS | _SECONDS:
            rest.append(index)
    quaternions = [_columns(group, "wxyz") for group in groups.values() if "w" in group]
    turned = [_columns(group, "xyz") for stem, group in groups.items() if "w" not in group and _turns(stem)]
    moved = [_columns(group, "xyz") for stem, group in groups.items() if "w" not in group and not _turns(stem)]
    joints, names = _joints(header, words, rest)
    return NamedColumns(
        positions=tuple(filter(None, moved)),
        quaternions=tuple(filter(None, quaternions)),
        angles=tuple(filter(None, turned)),
        joints=joints,
        joint_names=names,
        times=next((index for index, word in enumerate(words) if word in _SECONDS), None),
    )


def _component(word: str) -> tuple[str, str] | None:
    """Return the vector of the root and the axis that a word names, such as ('root_t', 'x') for 'root_tx'."""
    *before, last = word.split("_")
    match = _LAST.fullmatch(last)
    if match is None:
        return None
    stem = [*before, match[1]]
    return ("_".join(stem), match[2]) if all(part in _ROOT | _POSITION | _ROTATION for part in stem) else None


def _turns(stem: str) -> bool:
    return not _ROTATION.isdisjoint(stem.split("_"))


def _columns(group: dict[str, int], axes: str) -> Columns:
    """Return the columns of a vector; none where one of its axes is not there."""
    return tuple(group[axis] for axis in axes) if set(axes) <= set(group) else ()


def _joints(header: Sequence[str], words: list[str], rest: list[int]) -> tuple[Columns, tuple[str, ...] | None]:
    numbers = {index: int(match[1]) for index in rest if (match := _NUMBERED.fullmatch(words[index]))}
    if numbers:
        return tuple(sorted(numbers, key=numbers.__getitem__)), None
    return tuple(rest), tuple(_ANGLE.sub("", header[index]) for index in rest)


_NAMED_ROOT = ("root_x", "root_y", "root_z", "root_qw", "root_qx", "root_qy", "root_qz")
_MAX_UNEVENNESS = 0.1  # Of a step between frames of one rate.


def _read_named(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; raises `ReadError`."""
    table, header = arrays.numbers(TABLE), arrays.names(HEADER)
    columns = named_columns(header)
    if not columns.has_root:
        raise ReadError(f"{arrays.path}: {_no_root(columns)} Its columns are {', '.join(header)}.")
    if not columns.joints:
        raise ReadError(f"{arrays.path}: no column is a joint. Its columns are {', '.join(header)}.")
    return {
        "contents": (f"table {table.shape}", f"columns {', '.join(header)}"),
        "fps": _rate(arrays, table, columns),
        "root": table[:, [*columns.positions[0], *columns.quaternions[0]]],
        "joint_pos": table[:, columns.joints],
        "joint_names": columns.joint_names,
    }


def _rate(arrays: ArraysByName, table: np.ndarray, columns: NamedColumns) -> float | None:
    """Return the rate by the frames' times [1/s], None where the table has none; raises `ReadError`."""
    if columns.times is None or len(table) < 2:
        return None
    steps = np.diff(table[:, columns.times])
    step = float(np.median(steps))
    if not (np.isfinite(steps).all() and step > 0 and np.abs(steps - step).max() <= _MAX_UNEVENNESS * step):
        raise ReadError(
            f"{arrays.path}: the times of its frames are no even steps: from {steps.min():.4g} to {steps.max():.4g} s. "
            "Resample the motion at one rate."
        )
    return float((len(table) - 1) / (table[-1, columns.times] - table[0, columns.times]))


def _no_root(columns: NamedColumns) -> str:
    if columns.angles and not columns.quaternions:
        return "the root's rotation is three angles, the order of which no column tells: write a quaternion."
    for what, found in (("position (x, y, z)", columns.positions), ("rotation (w, x, y, z)", columns.quaternions)):
        if len(found) != 1:
            return f"{'several columns' if found else 'no columns'} name the root's {what}, such as root_x and root_qw."
    raise AssertionError


def _write_named(motion: ResampledMotion) -> Written:
    """Return one motion as a table: times of frames [s], the root's path and all joints."""
    joints = source_joints(motion)
    times = np.arange(motion.frames)[:, None] / motion.fps
    header = ("time", *_NAMED_ROOT, *joints.names)
    return Written(
        {TABLE: np.concatenate([times, motion.qpos[:, :7], joints.pos], axis=1), HEADER: header}, joints.names
    )


NAMED_CSV = Format(
    name="named-csv",
    convention=Convention("named-csv", usual_fps=30.0, order="names"),
    holds=has(TABLE, HEADER),
    read=_read_named,
    container=CSV,
    write=_write_named,
    title="any program that reads tables",
)


_SEED_ROOT = [f"root_{kind}{axis}" for kind in ("translate", "rotate") for axis in "XYZ"]


def _read_seed(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`, in metres and radians; raises `ReadError`."""
    table, header = arrays.numbers(TABLE), arrays.names(HEADER)
    columns = named_columns(header)
    root = table[:, [header.index(name) for name in _SEED_ROOT]]
    if (np.abs(root) > LARGEST).any():  # Turns by such numbers overflow.
        raise ReadError(f"{arrays.path}: the root's columns hold numbers beyond {LARGEST:g}. Make the file again.")
    return {
        "contents": (f"table {table.shape}", f"columns {', '.join(header)}"),
        "root": np.concatenate([root[:, :3] / 100.0, _rotation(np.radians(root[:, 3:]))], axis=1),
        "joint_pos": np.radians(table[:, columns.joints]),
        "joint_names": columns.joint_names,
    }


def _rotation(angles: np.ndarray) -> np.ndarray:
    """Return quaternions of turns about the world's x axis first, then its y and its z axis."""
    about_x, about_y, about_z = (se3.exp(angles[:, [axis]] * np.eye(3)[axis]) for axis in range(3))
    return se3.quat_multiply(about_z, se3.quat_multiply(about_y, about_x))


SEED_CSV = Format(
    name="bones-seed",
    convention=Convention("bones-seed", usual_fps=120.0, order="names"),
    holds=lambda values: set(_SEED_ROOT) <= set(values.get(HEADER, ())),
    read=_read_seed,
    container=CSV,
)


def _read_unitree(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; raises `ReadError`."""
    table = arrays.numbers(TABLE)
    if table.shape[1] < MIN_COLUMNS:
        raise ReadError(f"{arrays.path}: {table.shape[1]} columns, expected a free joint (7) and the angles of hinges.")
    return {"contents": (f"table {table.shape}",), "root": table[:, :7], "joint_pos": table[:, 7:]}


def _write_unitree(motion: ResampledMotion) -> Written:
    """Return one motion as a table."""
    qpos, joints = motion.qpos, source_joints(motion)
    table = np.concatenate([qpos[:, :3], se3.quat_to_xyzw(qpos[:, 3:7]), joints.pos], axis=1)
    note = f"The file does not tell its rate: pass --input_fps {motion.rate} to what reads it."
    fingers = ("Its readers expect a G1 without fingers: --as unitree_g1.",) if motion.model.spec.fingers else ()
    return Written({TABLE: table}, notes=(note, *fingers))


UNITREE_CSV = Format(
    name="unitree-csv",
    convention=Convention("unitree-csv", quat_order="xyzw", usual_fps=30.0),
    holds=lambda values: set(values) == {TABLE},
    read=_read_unitree,
    container=CSV,
    write=_write_unitree,
    title="csv_to_npz of BeyondMimic and mjlab, Unitree's LAFAN1 set",
    fps=30.0,
)
