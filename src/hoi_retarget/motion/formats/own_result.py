"""Results of this package (`docs/results.md`): `qpos` with names, objects and contacts."""

from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats.containers import ArraysByName, has
from hoi_retarget.motion.formats.format import Format
from hoi_retarget.motion.formats.motion_file import ContactFlags, Convention, ObjectPoses
from hoi_retarget.motion.result_file import load


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; raises `ReadError`."""
    motion = load(arrays.path)
    if motion.qpos.shape[1] < 7:
        raise ReadError(
            f"{arrays.path}: its qpos has {motion.qpos.shape[1]} columns, expected a free joint and hinges."
        )
    poses = np.concatenate([motion.object_pos, motion.object_quat], axis=-1)
    return {
        "fps": motion.fps,
        "root": motion.qpos[:, :7],
        "joint_pos": motion.qpos[:, 7:],
        "joint_names": motion.joint_names,
        "objects": tuple(ObjectPoses(name, poses[:, index]) for index, name in enumerate(motion.object_names)),
        "contacts": ContactFlags(motion.contact_links, motion.contact_flags),
    }


FORMAT = Format(
    name="hoi-retarget",
    convention=Convention("hoi-retarget", order="names"),
    holds=has("schema", "contact_targets", "qpos", "joint_names"),
    read=read,
)
