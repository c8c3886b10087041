"""Pickles of SBTO: as GMR's, with the pose of an object (rotations xyzw)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hoi_retarget.motion.formats.arrays_by_name import contents, joined, numbers, rate
from hoi_retarget.motion.formats.motion_file import Convention, MotionFile, ObjectPoses

FORMAT = "sbto"
KEYS = frozenset({"root_pos", "root_rot", "dof_pos", "object_root_pos", "object_rot"})


def parse(path: Path, values: Mapping[str, Any]) -> MotionFile:
    """Return what an SBTO dictionary holds; raises `ReadError`."""
    pose = joined(path, numbers(path, values, "object_root_pos"), numbers(path, values, "object_rot"))
    return MotionFile(
        path=str(path),
        format=FORMAT,
        convention=Convention(quat_order="xyzw", usual_fps=30.0),
        contents=contents(values),
        fps=rate(path, values),
        root=joined(path, numbers(path, values, "root_pos"), numbers(path, values, "root_rot")),
        joint_pos=numbers(path, values, "dof_pos"),
        objects=(ObjectPoses("object", pose),),
    )
