"""holosoma's whole-body tracking file: joints with the root before them, bodies by name, optionally one object."""

from typing import Any

import numpy as np

from hoi_retarget.motion.formats.arrays_by_name import ArraysByName, has
from hoi_retarget.motion.formats.body_arrays import body_arrays, object_arrays, read_bodies, with_object
from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.formats.motion_file import Convention, ObjectPoses
from hoi_retarget.motion.makers_joints import makers_joints
from hoi_retarget.motion.resample import ResampledMotion
from hoi_retarget.numerics import se3

_WORLD = "world"  # MuJoCo's body 0, which holosoma's converter writes too.
# Links of holosoma's converter that hang fixed on others and that our models do not have.
_ABSENT_LINKS = (
    "pelvis_contour_link",
    "waist_support_link",
    *(
        f"{side}_{name}_link"
        for side in ("left", "right")
        for name in ("ankle_intermediate_1", *(f"ankle_roll_sphere_{ball}" for ball in range(1, 6)))
    ),
    *(f"{side}_{name}_link" for side in ("left", "right") for name in ("rubber_hand", "thumb", "pinky")),
)


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return what the arrays of a training file hold; raises `ReadError`."""
    joint_pos, joint_vel = arrays.table("joint_pos", 8), arrays.table("joint_vel", 7)
    body_names = arrays.names("body_names")
    objects = ()
    if "object_pos_w" in arrays:
        pose = arrays.pose("object_pos_w", "object_quat_w")
        # The object's link is the last body.
        name = body_names[-1].removesuffix("_link") if body_names else "object"
        objects = (ObjectPoses(name, pose, arrays.optional("object_lin_vel_w"), arrays.optional("object_ang_vel_w")),)
    return {
        "root": joint_pos[:, :7],
        "joint_pos": joint_pos[:, 7:],
        "joint_vel": joint_vel[:, 6:],
        "root_vel": joint_vel[:, :6],
        "joint_names": arrays.names("joint_names"),
        "body_names": body_names,
        "bodies": read_bodies(arrays),
        "objects": objects,
    }


def write(motion: ResampledMotion) -> Written:
    """Return one motion as holosoma's trainer has it."""
    thing, joints = object_arrays(motion), makers_joints(motion)
    names = (_WORLD, *motion.model.body_names, *([f"{motion.object_name}_link"] if thing else []))
    arrays = {
        "fps": np.array([motion.rate]),
        "joint_pos": np.concatenate([motion.qpos[:, :7], joints.pos], axis=1),
        "joint_vel": np.concatenate([motion.root_lin_vel, motion.root_ang_vel, joints.vel], axis=1),
        **with_object(_with_world(body_arrays(motion, FORMAT.linear_velocity_of)), thing),
        **thing,
        "joint_names": np.array(joints.names, dtype=np.str_),
        "body_names": np.array(names, dtype=np.str_),
    }
    return Written(arrays, joints.names, names, notes=_notes(motion))


def _with_world(bodies: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return arrays of bodies with those of the world, which stands still, before them."""
    still = {4: se3.IDENTITY_QUAT, 3: np.zeros(3)}
    return {
        name: np.concatenate([np.tile(still[array.shape[-1]], (len(array), 1, 1)), array], axis=1)
        for name, array in bodies.items()
    }


def _notes(motion: ResampledMotion) -> tuple[str, ...]:
    if motion.model.spec.name != "unitree_g1":
        return ()
    return (
        "The G1 of holosoma's published files has its waist's roll and pitch axes 9 and 10 mm off those of rev_1_0, by "
        "which these bodies are placed: those above the waist lie up to 10 mm from where holosoma's model has them.",
        f"Fixed links that holosoma's converter adds are not in the file: {', '.join(_ABSENT_LINKS)}.",
    )


FORMAT = Format(
    name="holosoma",
    convention=Convention("holosoma-wbt", order="names"),
    holds=has("joint_pos", "joint_vel", "body_pos_w", "body_quat_w", "joint_names", "body_names"),
    read=read,
    write=write,
    title="holosoma, whole-body tracking",
    fps=50.0,
    place_for_object=True,
    contacts_inside=True,
    linear_velocity_of="centres of mass",
)
