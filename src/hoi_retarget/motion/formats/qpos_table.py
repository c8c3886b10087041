"""Files that hold one table `qpos`: the robot's free joint, its hinges, then the objects' free joints.

Which columns are unit quaternions in every frame tells the objects from the hinges.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hoi_retarget.motion.formats.arrays_by_name import ArraysByName
from hoi_retarget.motion.formats.motion_file import ObjectPoses

UNIT_TOLERANCE = 1e-3
_LEAST = 8  # Columns: a free joint and a hinge.


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return what the table of a file holds; raises `ReadError`."""
    qpos = arrays.table("qpos", _LEAST)
    end = qpos.shape[1]
    poses: list[np.ndarray] = []
    while end - 7 >= _LEAST and _is_pose(qpos[:, end - 7 : end]):
        end -= 7
        poses.insert(0, qpos[:, end : end + 7])
    names = ["object"] if len(poses) == 1 else [f"object{index}" for index in range(len(poses))]
    objects = tuple(ObjectPoses(name, pose) for name, pose in zip(names, poses, strict=True))
    return {"root": qpos[:, :7], "joint_pos": qpos[:, 7:end], "objects": objects}


def is_rotation_first(values: Mapping[str, Any]) -> bool:
    """Return whether a table's first four columns are the root's rotation, and not those after its position."""
    qpos = values.get("qpos")
    if not isinstance(qpos, np.ndarray) or qpos.dtype.kind not in "biuf" or qpos.ndim != 2 or qpos.shape[1] < _LEAST:
        return False
    return _is_unit(qpos[:, :4]) and not _is_unit(qpos[:, 3:7])


def _is_unit(quat: np.ndarray) -> bool:
    """Return whether four columns are a unit quaternion in every frame."""
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(quat.astype(float), axis=1)
        return bool(np.abs(lengths - 1.0).max(initial=0.0) < UNIT_TOLERANCE)


def _is_pose(table: np.ndarray) -> bool:
    return _is_unit(table[:, :4]) or _is_unit(table[:, 3:])
