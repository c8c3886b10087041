"""`.npz` files of a root and joints under GMR's names; in which orders components and joints are, few of them state."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats.arrays_by_name import ArraysByName, has
from hoi_retarget.motion.formats.format import Format
from hoi_retarget.motion.formats.motion_file import WITHOUT_WRISTS, Convention

_JOINTS = {"dof_pos": "dof_vel", "joint_pos": "joint_vel"}
_ORDER = "quat_convention"
_has_root = has("root_pos", "root_rot")


def holds(values: Mapping[str, Any]) -> bool:
    """Return whether an archive has a root's path and joints, by one of their names."""
    return _has_root(values) and any(name in values for name in _JOINTS)


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return what an archive holds; raises `ReadError`."""
    joints = next(name for name in _JOINTS if name in arrays)
    return {
        "convention": replace(FORMAT.convention, quat_order=_stated_order(arrays)),
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


FORMAT = Format(
    name="gmr-npz",
    convention=Convention("gmr-npz", quat_order=None, order=None, usual_fps=30.0, usual_joints=WITHOUT_WRISTS),
    holds=holds,
    read=read,
)
