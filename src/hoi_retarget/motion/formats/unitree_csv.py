"""Unitree's CSV of root (rotation xyzw) and joints, without header or rate, which both csv_to_npz scripts read."""

import io
from pathlib import Path

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.motion.formats.arrays_by_name import ArraysByName, has
from hoi_retarget.motion.formats.encoding import rate
from hoi_retarget.motion.formats.format import Format, ResampledMotion, Written
from hoi_retarget.motion.formats.motion_file import Convention, MotionFile
from hoi_retarget.numerics import se3

_TABLE = "table"  # The file's one array, which has no name in it.
_LEAST = 8  # Columns: a free joint and a hinge.


def read_table(path: Path) -> dict[str, np.ndarray]:
    """Return the table of a file; raises `ReadError`."""
    try:
        lines = read_bytes(path).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ReadError(f"{path}: not a text file. Expected rows of numbers with commas between them.") from error
    rows = [(number, line.split(",")) for number, line in enumerate(lines, 1) if line.strip()]
    if not rows:
        raise ReadError(f"{path}: the file is empty, expected rows of numbers with commas between them.")
    width = len(rows[0][1])
    if width < _LEAST:
        raise ReadError(f"{path}: {width} columns, expected a free joint (7) and the angles of hinges.")
    table = np.zeros((len(rows), width))
    for index, (number, cells) in enumerate(rows):
        if len(cells) != width:
            raise ReadError(f"{path}: line {number} has {len(cells)} columns, those before it {width}.")
        try:
            table[index] = [float(cell) for cell in cells]
        except ValueError as error:
            raise ReadError(f"{path}: line {number}: {error}. Expected numbers only, without a header.") from error
    return {_TABLE: table}


def read(arrays: ArraysByName) -> MotionFile:
    """Return what a table holds."""
    table = arrays.numbers(_TABLE)
    return arrays.motion(
        FORMAT.convention,
        contents=(f"table {table.shape}",),
        root=table[:, :7],
        joint_pos=table[:, 7:],
    )


def write(motion: ResampledMotion) -> Written:
    """Return the file of one motion."""
    qpos = motion.trajectory.qpos
    text = io.StringIO()
    rows = np.concatenate([qpos[:, :3], se3.quat_to_xyzw(qpos[:, 3:7]), qpos[:, 7:]], axis=1)
    np.savetxt(text, rows, fmt="%.9f", delimiter=",")
    note = f"The file does not tell its rate: pass --input_fps {rate(motion.trajectory.fps)} to what reads it."
    return Written(files={".csv": text.getvalue().encode()}, joint_names=motion.model.joint_names, notes=(note,))


FORMAT = Format(
    name="unitree-csv",
    convention=Convention("unitree-csv", quat_order="xyzw", usual_fps=30.0),
    holds=has(_TABLE),
    read=read,
    suffix=".csv",
    write=write,
    title="csv_to_npz of BeyondMimic and mjlab, Unitree's LAFAN1 set",
    fps=30.0,
    # Nothing in the file tells the robot; its readers take 29 joints for the G1's.
    robots=("unitree_g1",),
)
