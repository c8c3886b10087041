"""GMR's pickle of root and joints, scalar-last quaternions."""

import numpy as np

from hoi_retarget.motion.formats.arrays_by_name import ArraysByName, has
from hoi_retarget.motion.formats.encoding import rate, to_pickle
from hoi_retarget.motion.formats.format import Format, ResampledMotion, Written
from hoi_retarget.motion.formats.motion_file import Convention, MotionFile
from hoi_retarget.numerics import se3


def read(arrays: ArraysByName) -> MotionFile:
    """Return what a GMR dictionary holds; raises `ReadError`."""
    return arrays.motion(
        FORMAT.convention,
        root=arrays.pose("root_pos", "root_rot"),
        joint_pos=arrays.numbers("dof_pos"),
    )


def write(motion: ResampledMotion) -> Written:
    """Return the file of one motion."""
    qpos = motion.trajectory.qpos
    content = {
        "fps": rate(motion.trajectory.fps),
        "root_pos": np.ascontiguousarray(qpos[:, :3]),
        "root_rot": se3.quat_to_xyzw(qpos[:, 3:7]),
        "dof_pos": np.ascontiguousarray(qpos[:, 7:]),
        "local_body_pos": None,
        "link_body_list": None,
    }
    return Written(files={".pkl": to_pickle(content)}, joint_names=motion.model.joint_names)


FORMAT = Format(
    name="gmr",
    convention=Convention("gmr", quat_order="xyzw", usual_fps=30.0),
    holds=has("root_pos", "root_rot", "dof_pos"),
    read=read,
    suffix=".pkl",
    write=write,
    title="GMR, TWIST and what reads their files",
)
