"""A folder of CSV that GEAR-SONIC plays: joints and bodies in Isaac Lab's order, the first body is the root."""

from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats.containers import CSV_FOLDER, JOINTS, ArraysByName, has
from hoi_retarget.motion.formats.csv import named_columns
from hoi_retarget.motion.formats.format import Format
from hoi_retarget.motion.formats.motion_file import Convention

_POSITIONS, _ROTATIONS, _VELOCITIES = "body_pos", "body_quat", ("body_lin_vel", "body_ang_vel")


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; bodies but the first are left out. Raises `ReadError`."""
    joints = named_columns(arrays.names(f"{JOINTS} columns"))
    root = arrays.joined(_first_body(arrays, _POSITIONS, 3), _first_body(arrays, _ROTATIONS, 4))
    velocities = [_first_body(arrays, name, 3) for name in _VELOCITIES if name in arrays]
    joint_vel = None
    if joints.joint_names is None and "joint_vel" in arrays:
        joint_vel = arrays.numbers("joint_vel")[:, named_columns(arrays.names("joint_vel columns")).joints]
    return {
        "root": root,
        "joint_pos": arrays.numbers(JOINTS)[:, joints.joints],
        "joint_names": joints.joint_names,
        "joint_vel": joint_vel,
        "root_vel": arrays.joined(*velocities) if len(velocities) == len(_VELOCITIES) else None,
    }


def _first_body(arrays: ArraysByName, name: str, width: int) -> np.ndarray:
    if name not in arrays:
        raise ReadError(f"{arrays.path.with_name(name)}.csv: there is no such file. The root's path is in it.")
    return arrays.table(name, width)[:, :width]


FORMAT = Format(
    name="sonic",
    convention=Convention("sonic", order="breadth_first", usual_fps=50.0),
    holds=has(JOINTS),
    read=read,
    container=CSV_FOLDER,
)
