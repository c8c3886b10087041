"""CSV with a header that names the root's columns and the joints, in any order."""

from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats.arrays_by_name import ArraysByName, has
from hoi_retarget.motion.formats.containers import CSV, HEADER, TABLE
from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.formats.motion_file import Convention
from hoi_retarget.motion.formats.named_columns import NamedColumns, named_columns
from hoi_retarget.motion.makers_joints import makers_joints
from hoi_retarget.motion.resample import ResampledMotion

_ROOT = ("root_x", "root_y", "root_z", "root_qw", "root_qx", "root_qy", "root_qz")
_EVEN = 0.1  # Of a step: times that differ more are not those of one rate.


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return what a table holds, quaternions wxyz; raises `ReadError`."""
    table, header = arrays.numbers(TABLE), arrays.names(HEADER)
    columns = named_columns(header)
    if not columns.has_root:
        raise ReadError(f"{arrays.path}: {_no_root(columns)} Its columns are {', '.join(header)}.")
    if not columns.joints:
        raise ReadError(f"{arrays.path}: no column is a joint. Its columns are {', '.join(header)}.")
    return {
        "contents": (f"table {table.shape}", f"columns {', '.join(header)}"),
        "fps": rate(arrays, table, columns),
        "root": table[:, [*columns.positions[0], *columns.quaternions[0]]],
        "joint_pos": table[:, columns.joints],
        "joint_names": columns.joint_names,
    }


def rate(arrays: ArraysByName, table: np.ndarray, columns: NamedColumns) -> float | None:
    """Return the rate by the frames' times [1/s], None where the table has none; raises `ReadError`."""
    if columns.times is None or len(table) < 2:
        return None
    steps = np.diff(table[:, columns.times])
    step = float(np.median(steps))
    if not (np.isfinite(steps).all() and step > 0 and np.abs(steps - step).max() <= _EVEN * step):
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


def write(motion: ResampledMotion) -> Written:
    """Return one motion as a table: times of frames [s], the root's path and all joints."""
    joints = makers_joints(motion)
    times = np.arange(motion.frames)[:, None] / motion.fps
    header = ("time", *_ROOT, *joints.names)
    return Written(
        {TABLE: np.concatenate([times, motion.qpos[:, :7], joints.pos], axis=1), HEADER: header}, joints.names
    )


FORMAT = Format(
    name="named-csv",
    convention=Convention("named-csv", usual_fps=30.0, order="names"),
    holds=has(TABLE, HEADER),
    read=read,
    container=CSV,
    write=write,
    title="any program that reads tables",
)
