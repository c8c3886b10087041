"""CSV of the BONES-SEED set: centimetres and degrees, the root's rotation as angles about the world's x, y, z axes."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats.arrays_by_name import ArraysByName
from hoi_retarget.motion.formats.containers import CSV, HEADER, TABLE
from hoi_retarget.motion.formats.format import Format
from hoi_retarget.motion.formats.motion_file import LARGEST, Convention
from hoi_retarget.motion.formats.named_columns import named_columns
from hoi_retarget.numerics import se3

_ROOT = [f"root_{kind}{axis}" for kind in ("translate", "rotate") for axis in "XYZ"]


def holds(values: Mapping[str, Any]) -> bool:
    """Return whether a table has this set's columns of the root."""
    return set(_ROOT) <= set(values.get(HEADER, ()))


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return what a table holds, in metres and radians; raises `ReadError`."""
    table, header = arrays.numbers(TABLE), arrays.names(HEADER)
    columns = named_columns(header)
    root = table[:, [header.index(name) for name in _ROOT]]
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


FORMAT = Format(
    name="bones-seed",
    convention=Convention("bones-seed", usual_fps=120.0, order="names"),
    holds=holds,
    read=read,
    container=CSV,
)
