"""Pickles of ASAP and PHC's motion libraries: a dictionary of motions, each with root and joint angles (xyzw)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats.arrays_by_name import contents, joined, numbers, rate
from hoi_retarget.motion.formats.motion_file import Convention, MotionFile

FORMAT = "asap"
KEYS = frozenset({"root_trans_offset", "root_rot", "dof"})


def holds(values: Mapping[Any, Any]) -> bool:
    """Return whether a dictionary is a library of motions."""
    return bool(values) and all(isinstance(motion, Mapping) and set(motion) >= KEYS for motion in values.values())


def parse(path: Path, values: Mapping[str, Any]) -> MotionFile:
    """Return the one motion of a library; raises `ReadError`, also when there are several."""
    if len(values) != 1:
        shown = ", ".join(list(map(str, values))[:5])
        raise ReadError(f"{path}: {len(values)} motions ({shown}); expected one. Save each to a file of its own.")
    motion = next(iter(values.values()))
    return MotionFile(
        path=str(path),
        format=FORMAT,
        convention=Convention(quat_order="xyzw", usual_fps=30.0),
        contents=contents(motion),
        fps=rate(path, motion),
        root=joined(path, numbers(path, motion, "root_trans_offset"), numbers(path, motion, "root_rot")),
        joint_pos=numbers(path, motion, "dof"),
    )
