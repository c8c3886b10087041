"""Results of this package (`docs/results.md`): `qpos` with names, objects and contacts."""

from pathlib import Path

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats.arrays_by_name import Arrays, contents
from hoi_retarget.motion.formats.motion_file import ContactFlags, Convention, MotionFile, ObjectPoses
from hoi_retarget.motion.result_file import load

FORMAT = "hoi-retarget"
KEYS = frozenset({"schema", "ik_qpos", "qpos", "joint_names"})


def parse(path: Path, arrays: Arrays) -> MotionFile:
    """Return what a result holds; raises `ReadError`."""
    motion = load(path)
    if motion.qpos.shape[1] < 7:
        raise ReadError(f"{path}: its qpos has {motion.qpos.shape[1]} columns, expected a free joint and hinges.")
    return MotionFile(
        path=str(path),
        format=FORMAT,
        convention=Convention(order="names"),
        contents=contents(arrays),
        fps=motion.fps,
        root=motion.qpos[:, :7],
        joint_pos=motion.qpos[:, 7:],
        joint_names=motion.joint_names,
        objects=tuple(
            ObjectPoses(name, np.concatenate([motion.object_pos[:, index], motion.object_quat[:, index]], axis=1))
            for index, name in enumerate(motion.object_names)
        ),
        contacts=ContactFlags(motion.contact_links, motion.contact_flags),
    )
