"""The small file beside an export that says what is in it."""

from collections.abc import Sequence
from typing import Any

from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.makers_joints import held_joints
from hoi_retarget.motion.resample import ResampledMotion
from hoi_retarget.motion.result import Result

UNITS = {"length": "m", "angle": "rad", "time": "s"}


def describe(
    result: Result, resampled: ResampledMotion, format: Format, written: Written, files: Sequence[str]
) -> dict[str, Any]:
    """Return the sidecar's content as plain values, without folders of the machine it was made on."""
    motion, model = result.motion, result.model
    joint_names = written.joint_names or model.joint_names
    return {
        "format": format.name,
        "read_by": format.title,
        "files": list(files),
        "robot": motion.robot,
        "fps": resampled.fps,
        "frames": resampled.frames,
        "seconds": (resampled.frames - 1) / resampled.fps,
        "joint_names": list(joint_names),
        **({"held_joints": held_joints(model, joint_names)} if model.spec.held else {}),
        "body_names": list(written.body_names),
        "quaternions": format.convention.quat_order,
        "linear_velocity_of": format.linear_velocity_of,
        "axes": "world, z up",
        "units": UNITS,
        "objects": [
            {**result.object_facts(index), "in_the_format": index == resampled.object}
            for index in range(len(motion.object_names))
        ],
        "contacts": {
            "in": "the file" if format.contacts_inside else "beside it",
            "links": list(motion.contact_links),
            "normals_of": sorted(result.surfaces),
        },
        **result.origin(),
        "notes": list(written.notes),
    }
