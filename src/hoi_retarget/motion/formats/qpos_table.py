"""Files that hold one table `qpos`: holosoma's retargets and the OmniRetarget data set.

Both have the robot's free joint, its hinges, then the objects' free joints. holosoma writes positions before
rotations, the data set rotations before positions. Which columns are unit quaternions in every frame tells the
objects from the hinges, and where the file does not say which of the two it is, that as well.
"""

from pathlib import Path

import numpy as np

from hoi_retarget.motion.formats.arrays_by_name import Arrays, columns, contents, numbers, rate
from hoi_retarget.motion.formats.motion_file import Convention, MotionFile, ObjectPoses

HOLOSOMA, OMNIRETARGET = "holosoma-retarget", "omniretarget"
KEYS = frozenset({"qpos"})
UNIT_TOLERANCE = 1e-3
_LEAST = 8  # Columns: a free joint and a hinge.


def parse(path: Path, arrays: Arrays) -> MotionFile:
    """Return what the table of a file holds; raises `ReadError`."""
    qpos = columns(path, "qpos", numbers(path, arrays, "qpos"), _LEAST)
    end = qpos.shape[1]
    poses: list[np.ndarray] = []
    while end - 7 >= _LEAST and _is_pose(qpos[:, end - 7 : end]):
        end -= 7
        poses.insert(0, qpos[:, end : end + 7])
    rotation_first = is_unit(qpos[:, :4]) and not is_unit(qpos[:, 3:7])
    # holosoma's retargeter stores its cost; the data set does not.
    name = OMNIRETARGET if rotation_first and "cost" not in arrays else HOLOSOMA
    return MotionFile(
        path=str(path),
        format=name,
        convention=Convention(root_order="quat_pos" if name == OMNIRETARGET else "pos_quat", usual_fps=30.0),
        contents=contents(arrays),
        fps=rate(path, arrays),
        root=qpos[:, :7],
        joint_pos=qpos[:, 7:end],
        objects=tuple(ObjectPoses(_name(index, len(poses)), pose) for index, pose in enumerate(poses)),
    )


def is_unit(quat: np.ndarray) -> bool:
    """Return whether four columns are a unit quaternion in every frame."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.abs(np.linalg.norm(quat, axis=1) - 1.0).max(initial=0.0) < UNIT_TOLERANCE)


def _is_pose(table: np.ndarray) -> bool:
    return is_unit(table[:, :4]) or is_unit(table[:, 3:])


def _name(index: int, count: int) -> str:
    return "object" if count == 1 else f"object{index}"
