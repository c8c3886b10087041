"""Training files of holosoma's whole-body tracking: joints with the root before them, bodies, names."""

from pathlib import Path

from hoi_retarget.motion.formats.arrays_by_name import (
    Arrays,
    columns,
    contents,
    joined,
    names,
    numbers,
    optional_numbers,
    rate,
)
from hoi_retarget.motion.formats.motion_file import Bodies, Convention, MotionFile, ObjectPoses

FORMAT = "holosoma-wbt"
KEYS = frozenset({"joint_pos", "joint_vel", "body_pos_w", "body_quat_w", "joint_names", "body_names"})


def parse(path: Path, arrays: Arrays) -> MotionFile:
    """Return what the arrays of a training file hold; raises `ReadError`."""
    joint_pos = columns(path, "joint_pos", numbers(path, arrays, "joint_pos"), 8)
    joint_vel = columns(path, "joint_vel", numbers(path, arrays, "joint_vel"), 7)
    body_names = names(path, arrays, "body_names")
    objects = ()
    if "object_pos_w" in arrays:
        pose = joined(path, numbers(path, arrays, "object_pos_w"), numbers(path, arrays, "object_quat_w"))
        velocities = (optional_numbers(path, arrays, f"object_{kind}_vel_w") for kind in ("lin", "ang"))
        # The object's link is the last body.
        name = body_names[-1].removesuffix("_link") if body_names else "object"
        objects = (ObjectPoses(name, pose, *velocities),)
    return MotionFile(
        path=str(path),
        format=FORMAT,
        convention=Convention(order="names"),
        contents=contents(arrays),
        fps=rate(path, arrays),
        root=joint_pos[:, :7],
        joint_pos=joint_pos[:, 7:],
        joint_vel=joint_vel[:, 6:],
        root_vel=joint_vel[:, :6],
        joint_names=names(path, arrays, "joint_names"),
        body_names=body_names,
        bodies=Bodies(
            numbers(path, arrays, "body_pos_w"),
            numbers(path, arrays, "body_quat_w"),
            optional_numbers(path, arrays, "body_lin_vel_w"),
            optional_numbers(path, arrays, "body_ang_vel_w"),
        ),
        objects=objects,
    )
