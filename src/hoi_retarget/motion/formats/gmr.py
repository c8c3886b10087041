"""GMR's pickle of root and joints, scalar-last quaternions."""

from typing import Any

import numpy as np

from hoi_retarget.motion.formats.arrays_by_name import ArraysByName, has
from hoi_retarget.motion.formats.containers import PICKLE
from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.formats.motion_file import WITHOUT_WRISTS, Convention
from hoi_retarget.motion.makers_joints import makers_joints
from hoi_retarget.motion.resample import ResampledMotion
from hoi_retarget.numerics import se3


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return what a GMR dictionary holds; raises `ReadError`."""
    return {
        "root": arrays.pose("root_pos", "root_rot"),
        "joint_pos": arrays.numbers("dof_pos"),
        "joint_names": arrays.joint_names(),
    }


def write(motion: ResampledMotion) -> Written:
    """Return one motion as GMR has it."""
    qpos, joints = motion.qpos, makers_joints(motion)
    values = {
        "fps": motion.rate,
        "root_pos": np.ascontiguousarray(qpos[:, :3]),
        "root_rot": se3.quat_to_xyzw(qpos[:, 3:7]),
        "dof_pos": joints.pos,
        "local_body_pos": None,
        "link_body_list": None,
    }
    return Written(values, joints.names)


FORMAT = Format(
    name="gmr",
    convention=Convention("gmr", quat_order="xyzw", usual_fps=30.0, usual_joints=WITHOUT_WRISTS),
    holds=has("root_pos", "root_rot", "dof_pos"),
    read=read,
    container=PICKLE,
    write=write,
    title="GMR, TWIST and what reads their files",
)
