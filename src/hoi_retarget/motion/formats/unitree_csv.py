"""Unitree's CSV of root (rotation xyzw) and joints, without header or rate, which both csv_to_npz scripts read."""

from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats.arrays_by_name import ArraysByName
from hoi_retarget.motion.formats.containers import CSV, TABLE
from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.formats.motion_file import Convention
from hoi_retarget.motion.resample import ResampledMotion
from hoi_retarget.numerics import se3

_LEAST_COLUMNS = 8  # A free joint and a hinge.


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return what a table holds."""
    table = arrays.numbers(TABLE)
    if table.shape[1] < _LEAST_COLUMNS:
        raise ReadError(f"{arrays.path}: {table.shape[1]} columns, expected a free joint (7) and the angles of hinges.")
    return {"contents": (f"table {table.shape}",), "root": table[:, :7], "joint_pos": table[:, 7:]}


def write(motion: ResampledMotion) -> Written:
    """Return one motion as a table."""
    qpos = motion.qpos
    table = np.concatenate([qpos[:, :3], se3.quat_to_xyzw(qpos[:, 3:7]), qpos[:, 7:]], axis=1)
    note = f"The file does not tell its rate: pass --input_fps {motion.rate} to what reads it."
    return Written({TABLE: table}, notes=(note,))


FORMAT = Format(
    name="unitree-csv",
    convention=Convention("unitree-csv", quat_order="xyzw", usual_fps=30.0),
    holds=lambda values: set(values) == {TABLE},
    read=read,
    container=CSV,
    write=write,
    title="csv_to_npz of BeyondMimic and mjlab, Unitree's LAFAN1 set",
    fps=30.0,
    # Nothing in the file tells the robot; its readers take 29 joints for the G1's.
    robots=("unitree_g1",),
)
