"""Motion files of BeyondMimic (whole_body_tracking) and mjlab: the same arrays, in different orders.

Neither stores names, so only the numbers tell which of the two a file is.
"""

from collections.abc import Mapping

import numpy as np

from hoi_retarget.motion.formats.arrays_by_name import ArraysByName, has
from hoi_retarget.motion.formats.body_arrays import read_bodies
from hoi_retarget.motion.formats.encoding import to_npz
from hoi_retarget.motion.formats.motion_file import Convention, MotionFile

OPEN = Convention("tracking", order=None)
"""What both demand, as long as the order is not known."""

holds = has("fps", "joint_pos", "joint_vel", "body_pos_w", "body_quat_w")


def read(arrays: ArraysByName) -> MotionFile:
    """Return what the arrays of a tracking file hold; raises `ReadError`."""
    return MotionFile(
        path=str(arrays.path),
        convention=OPEN,
        contents=arrays.contents(),
        fps=arrays.rate(),
        joint_pos=arrays.numbers("joint_pos"),
        joint_vel=arrays.numbers("joint_vel"),
        bodies=read_bodies(arrays),
    )


def encode(
    fps: int | float,
    joint_pos: np.ndarray,
    joint_vel: np.ndarray,
    bodies: Mapping[str, np.ndarray],
    contacts: Mapping[str, np.ndarray],
) -> bytes:
    """Return a file's content: motions in single precision, contacts as they are."""
    arrays = {"joint_pos": joint_pos, "joint_vel": joint_vel, **bodies}
    single = {name: array.astype(np.float32) for name, array in arrays.items()}
    return to_npz({"fps": np.array([fps]), **single, **contacts})
