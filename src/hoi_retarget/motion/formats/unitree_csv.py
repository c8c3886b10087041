"""Unitree's comma-separated motions: root position, root rotation (xyzw), joint angles; no header, no rate."""

from pathlib import Path

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.motion.formats.motion_file import Convention, MotionFile

FORMAT = "unitree-csv"
_LEAST = 8  # Columns: a free joint and a hinge.


def read(path: Path) -> MotionFile:
    """Return what a table holds; raises `ReadError`."""
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
    return MotionFile(
        path=str(path),
        format=FORMAT,
        convention=Convention(quat_order="xyzw", usual_fps=30.0),
        contents=(f"table {table.shape}",),
        root=table[:, :7],
        joint_pos=table[:, 7:],
    )
