"""`.motion` files of ProtoMotions: joints, and all bodies in the order of its MJCF, scalar-last quaternions."""

from typing import Any

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats.containers import TORCH, ArraysByName, has
from hoi_retarget.motion.formats.format import Format
from hoi_retarget.motion.formats.motion_file import Bodies, Convention

_COMMON = "common"
_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw", "hand")
_G1_BODIES = (
    "pelvis",
    "head_link",
    *(f"{side}_{name}_link" for side in ("left", "right") for name in _LEG),
    *("waist_yaw_link", "waist_roll_link", "torso_link"),
    *(f"{side}_{name}_link" for side in ("left", "right") for name in _ARM),
)
"""Of its G1, which has a head and hands that hang fixed on others; the files hold no names."""


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; raises `ReadError`, also for a simulator's own order."""
    layout = arrays.values.get("state_conversion", _COMMON)
    if layout != _COMMON:
        raise ReadError(
            f"{arrays.path}: its state_conversion is {layout!r}: joints, bodies and quaternions are in the order of a "
            f"simulator that the file does not name. Write it with state_conversion '{_COMMON}'."
        )
    bodies = Bodies(
        arrays.numbers("rigid_body_pos"),
        arrays.numbers("rigid_body_rot"),
        arrays.optional("rigid_body_vel"),
        arrays.optional("rigid_body_ang_vel"),
    )
    if bodies.pos.ndim != 3 or bodies.quat.ndim != 3 or min(bodies.pos.shape[1], bodies.quat.shape[1]) == 0:
        raise ReadError(f"{arrays.path}: it has no bodies, the first of which would be the root.")
    joint_pos = arrays.numbers("dof_pos")
    is_g1 = (joint_pos.shape[1:], bodies.pos.shape[1]) == ((29,), len(_G1_BODIES))
    return {
        "root": arrays.joined(bodies.pos[:, 0], bodies.quat[:, 0]),
        "joint_pos": joint_pos,
        "joint_vel": arrays.optional("dof_vel"),
        "bodies": bodies,
        "body_names": _G1_BODIES if is_g1 else None,
    }


FORMAT = Format(
    name="protomotions",
    convention=Convention("protomotions", quat_order="xyzw", usual_fps=30.0),
    holds=has("dof_pos", "rigid_body_pos", "rigid_body_rot"),
    read=read,
    container=TORCH,
)
