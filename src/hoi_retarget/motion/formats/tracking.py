"""Motion files of BeyondMimic (whole_body_tracking) and mjlab: the same arrays, in different orders.

Neither stores names, so only the numbers tell which of the two a file is.
"""

from typing import Any

import numpy as np

from hoi_retarget.motion.formats.arrays_by_name import ArraysByName, has
from hoi_retarget.motion.formats.body_arrays import body_arrays, read_bodies
from hoi_retarget.motion.formats.format import VelocityPoint, Written
from hoi_retarget.motion.formats.motion_file import Convention
from hoi_retarget.motion.makers_joints import makers_joints
from hoi_retarget.motion.resample import ResampledMotion

Columns = np.ndarray | slice

OPEN = Convention("tracking", order=None)
"""What both demand, as long as the order is not known."""

holds = has("fps", "joint_pos", "joint_vel", "body_pos_w", "body_quat_w")


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return what the arrays of a tracking file hold; raises `ReadError`."""
    return {
        "convention": OPEN,
        "joint_pos": arrays.numbers("joint_pos"),
        "joint_vel": arrays.numbers("joint_vel"),
        "bodies": read_bodies(arrays),
    }


def write(
    motion: ResampledMotion, velocity_of: VelocityPoint, fps: int | float, *, bodies: Columns, joints: Columns
) -> Written:
    """Return one motion, its bodies and joints in this order, in single precision."""
    model, makers = motion.model, makers_joints(motion)
    arrays = {"joint_pos": makers.pos[:, joints], "joint_vel": makers.vel[:, joints]}
    arrays |= {name: array[:, bodies] for name, array in body_arrays(motion, velocity_of).items()}
    single = {name: array.astype(np.float32) for name, array in arrays.items()}
    return Written(
        {"fps": np.array([fps]), **single},
        joint_names=tuple(np.array(makers.names)[joints].tolist()),
        body_names=tuple(np.array(model.body_names)[bodies].tolist()),
    )
