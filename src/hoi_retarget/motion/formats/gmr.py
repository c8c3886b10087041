"""GMR's pickle of root and joints, scalar-last quaternions, SBTO's with an object, and `.npz` files under GMR's names.

Few `.npz` files state the order of their quaternions' components and of their joints.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats.containers import PICKLE, ArraysByName, has
from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.formats.motion_file import WITHOUT_WRISTS, Convention, ObjectPoses
from hoi_retarget.motion.links import source_joints
from hoi_retarget.motion.resample import ResampledMotion
from hoi_retarget.numerics import se3


def read_pickle(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; raises `ReadError`."""
    return {
        "root": arrays.pose("root_pos", "root_rot"),
        "joint_pos": arrays.numbers("dof_pos"),
        "joint_names": arrays.joint_names(),
    }


def write(motion: ResampledMotion) -> Written:
    """Return one motion as GMR has it."""
    qpos, joints = motion.qpos, source_joints(motion)
    values = {
        "fps": motion.rate,
        "root_pos": np.ascontiguousarray(qpos[:, :3]),
        "root_rot": se3.quat_to_xyzw(qpos[:, 3:7]),
        "dof_pos": joints.pos,
        "local_body_pos": None,
        "link_body_list": None,
    }
    return Written(values, joints.names)


GMR = Format(
    name="gmr",
    convention=Convention("gmr", quat_order="xyzw", usual_fps=30.0, usual_joints=WITHOUT_WRISTS),
    holds=has("root_pos", "root_rot", "dof_pos"),
    read=read_pickle,
    container=PICKLE,
    write=write,
    title="GMR, TWIST and what reads their files",
)


_JOINTS = {"dof_pos": "dof_vel", "joint_pos": "joint_vel"}
_ORDER = "quat_convention"


def _read_npz(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; raises `ReadError`."""
    joints = next(name for name in _JOINTS if name in arrays)
    return {
        "convention": replace(GMR_NPZ.convention, quat_order=_stated_order(arrays)),
        "root": arrays.pose("root_pos", "root_rot"),
        "joint_pos": arrays.numbers(joints),
        "joint_vel": arrays.optional(_JOINTS[joints]),
        "joint_names": arrays.joint_names(),
    }


def _stated_order(arrays: ArraysByName) -> Any:
    if _ORDER not in arrays:
        return None
    stated = arrays.text(_ORDER)
    if stated not in ("wxyz", "xyzw"):
        raise ReadError(f"{arrays.path}: '{_ORDER}' is {stated!r}, expected 'wxyz' or 'xyzw'.")
    return stated


GMR_NPZ = Format(
    name="gmr-npz",
    convention=Convention("gmr-npz", quat_order=None, order=None, usual_fps=30.0, usual_joints=WITHOUT_WRISTS),
    holds=lambda values: {"root_pos", "root_rot"} <= set(values) and not _JOINTS.keys().isdisjoint(values),
    read=_read_npz,
)


def _read_sbto(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; raises `ReadError`."""
    poses = ObjectPoses("object", arrays.pose("object_root_pos", "object_rot"))
    return {**read_pickle(arrays), "objects": (poses,)}


SBTO = replace(
    GMR,
    name="sbto",
    convention=replace(GMR.convention, name="sbto"),
    holds=has("root_pos", "root_rot", "dof_pos", "object_root_pos", "object_rot"),
    read=_read_sbto,
    write=None,
)
