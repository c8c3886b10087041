"""Pickles of GMR: root position, root rotation (xyzw) and joint angles."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hoi_retarget.motion.formats.arrays_by_name import contents, joined, numbers, rate
from hoi_retarget.motion.formats.motion_file import Convention, MotionFile

FORMAT = "gmr"
KEYS = frozenset({"root_pos", "root_rot", "dof_pos"})


def parse(path: Path, values: Mapping[str, Any]) -> MotionFile:
    """Return what a GMR dictionary holds; raises `ReadError`."""
    return MotionFile(
        path=str(path),
        format=FORMAT,
        convention=Convention(quat_order="xyzw", usual_fps=30.0),
        contents=contents(values),
        fps=rate(path, values),
        root=joined(path, numbers(path, values, "root_pos"), numbers(path, values, "root_rot")),
        joint_pos=numbers(path, values, "dof_pos"),
    )
