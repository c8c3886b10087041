"""Pickles of ASAP and PHC's motion libraries: a dictionary of motions, each with root and joint angles (xyzw)."""

from collections.abc import Mapping
from typing import Any

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats.containers import PICKLE, ArraysByName, has
from hoi_retarget.motion.formats.format import Format
from hoi_retarget.motion.formats.motion_file import WITHOUT_WRISTS, Convention

_is_motion = has("root_trans_offset", "root_rot", "dof")


def holds(values: Mapping[str, Any]) -> bool:
    """Return whether a dictionary is a library of motions."""
    return bool(values) and all(isinstance(motion, Mapping) and _is_motion(motion) for motion in values.values())


def read(library: ArraysByName) -> dict[str, Any]:
    """Return the one motion of a library; raises `ReadError`, also when there are several."""
    motions = library.values
    if len(motions) != 1:
        shown = ", ".join(list(map(str, motions))[:5])
        raise ReadError(
            f"{library.path}: {len(motions)} motions ({shown}); expected one. Save each to a file of its own."
        )
    arrays = ArraysByName(library.path, next(iter(motions.values())))
    return {
        "root": arrays.pose("root_trans_offset", "root_rot"),
        "joint_pos": arrays.numbers("dof"),
        "fps": arrays.rate(),
        "contents": arrays.contents(),
    }


FORMAT = Format(
    name="asap",
    convention=Convention("asap", quat_order="xyzw", usual_fps=30.0, usual_joints=WITHOUT_WRISTS),
    holds=holds,
    read=read,
    container=PICKLE,
)
