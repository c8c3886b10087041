"""Pickles of SBTO: as GMR's, with the pose of an object (rotations xyzw)."""

from typing import Any

from hoi_retarget.motion.formats import gmr
from hoi_retarget.motion.formats.containers import PICKLE, ArraysByName, has
from hoi_retarget.motion.formats.format import Format
from hoi_retarget.motion.formats.motion_file import WITHOUT_WRISTS, Convention, ObjectPoses


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; raises `ReadError`."""
    poses = ObjectPoses("object", arrays.pose("object_root_pos", "object_rot"))
    return {**gmr.read_pickle(arrays), "objects": (poses,)}


FORMAT = Format(
    name="sbto",
    convention=Convention("sbto", quat_order="xyzw", usual_fps=30.0, usual_joints=WITHOUT_WRISTS),
    holds=has("root_pos", "root_rot", "dof_pos", "object_root_pos", "object_rot"),
    read=read,
    container=PICKLE,
)
