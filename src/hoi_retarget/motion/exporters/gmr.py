"""GMR's pickle of root and joints, scalar-last quaternions."""

import numpy as np

from hoi_retarget.motion.exporters.encoding import rate, to_pickle
from hoi_retarget.motion.exporters.format import Format, Take, Written
from hoi_retarget.numerics import se3


def write(take: Take) -> Written:
    """Return the file of one motion."""
    qpos = take.trajectory.qpos
    content = {
        "fps": rate(take.trajectory.fps),
        "root_pos": np.ascontiguousarray(qpos[:, :3]),
        "root_rot": se3.quat_to_xyzw(qpos[:, 3:7]),
        "dof_pos": np.ascontiguousarray(qpos[:, 7:]),
        "local_body_pos": None,
        "link_body_list": None,
    }
    return Written(files={".pkl": to_pickle(content)}, joint_names=take.model.joint_names, quaternions="xyzw")


FORMAT = Format(
    name="gmr",
    title="GMR, TWIST and what reads their files",
    suffix=".pkl",
    fps=None,
    place_for_object=False,
    contacts_inside=False,
    robots=(),
    write=write,
)
