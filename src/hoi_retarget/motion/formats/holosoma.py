"""holosoma's files: of its whole-body tracking, and the table of configurations of its retargeter.

- `holosoma`: joints with the root before them, bodies by name, optionally one object.
- `holosoma-qpos`: one table `qpos` of the robot's free joint, its hinges, and the objects' free joints, positions
  first. Columns that are a unit quaternion in every frame are an object's, not hinges'.
- `omniretarget`: the same of the OmniRetarget data set, rotations before positions.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hoi_retarget.motion.formats.containers import ArraysByName, has
from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.formats.isaac_lab import body_arrays, object_arrays, read_bodies, with_object
from hoi_retarget.motion.formats.motion_file import MIN_COLUMNS, Convention, ObjectPoses
from hoi_retarget.motion.links import source_joints
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


def _read_holosoma(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; raises `ReadError`."""
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


def _write_holosoma(motion: ResampledMotion) -> Written:
    """Return one motion as holosoma's trainer has it."""
    object_paths, joints = object_arrays(motion), source_joints(motion)
    names = (_WORLD, *motion.model.body_names, *([f"{motion.object_name}_link"] if object_paths else []))
    arrays = {
        "fps": np.array([motion.rate]),
        "joint_pos": np.concatenate([motion.qpos[:, :7], joints.pos], axis=1),
        "joint_vel": np.concatenate([motion.root_lin_vel, motion.root_ang_vel, joints.vel], axis=1),
        **with_object(_with_world(body_arrays(motion, HOLOSOMA.linear_velocity_of)), object_paths),
        **object_paths,
        "joint_names": np.array(joints.names, dtype=np.str_),
        "body_names": np.array(names, dtype=np.str_),
    }
    return Written(arrays, joints.names, names, notes=_notes(motion))


def _with_world(bodies: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return arrays of bodies behind those of the world, which stands still."""
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


HOLOSOMA = Format(
    name="holosoma",
    convention=Convention("holosoma-wbt", order="names"),
    holds=has("joint_pos", "joint_vel", "body_pos_w", "body_quat_w", "joint_names", "body_names"),
    read=_read_holosoma,
    write=_write_holosoma,
    title="holosoma, whole-body tracking",
    fps=50.0,
    place_for_object=True,
    contacts_inside=True,
    linear_velocity_of="centres of mass",
)


_UNIT_TOLERANCE = 1e-3


def _read_qpos(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; raises `ReadError`."""
    qpos = arrays.table("qpos", MIN_COLUMNS)
    end = qpos.shape[1]
    poses: list[np.ndarray] = []
    while end - 7 >= MIN_COLUMNS and (_is_unit(qpos[:, end - 7 : end - 3]) or _is_unit(qpos[:, end - 4 : end])):
        end -= 7
        poses.insert(0, qpos[:, end : end + 7])
    names = ["object"] if len(poses) == 1 else [f"object{index}" for index in range(len(poses))]
    objects = tuple(ObjectPoses(name, pose) for name, pose in zip(names, poses, strict=True))
    return {"root": qpos[:, :7], "joint_pos": qpos[:, 7:end], "objects": objects}


def _is_unit(quat: np.ndarray) -> bool:
    """Return whether four columns are a unit quaternion in every frame."""
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(quat.astype(float), axis=1)
        return bool(np.abs(lengths - 1.0).max(initial=0.0) < _UNIT_TOLERANCE)


def _write_qpos(motion: ResampledMotion) -> Written:
    """Return one motion as a table."""
    position_and_rotation, joints = list(object_arrays(motion).values())[:2], source_joints(motion)
    qpos = np.concatenate([motion.qpos[:, :7], joints.pos, *position_and_rotation], axis=1)
    return Written(
        {"qpos": qpos, "fps": np.array(motion.rate)},
        joints.names,
        notes=(
            f"holosoma's converter takes the rate from its command line: pass --input_fps {motion.rate}.",
            "The human's joints and the solver's cost, which holosoma's retargeter adds, are not in the file.",
        ),
    )


HOLOSOMA_QPOS = Format(
    name="holosoma-qpos",
    convention=Convention("holosoma-retarget", usual_fps=30.0),
    holds=has("qpos"),
    read=_read_qpos,
    write=_write_qpos,
    title="holosoma, converter and viewers of retargeted motions",
    fps=30.0,
    place_for_object=True,
    contacts_inside=True,
)


def _is_rotation_first(values: Mapping[str, Any]) -> bool:
    """Return whether the root's rotation is in the first four columns; holosoma's retargeter stores a cost, too."""
    qpos = values.get("qpos")
    is_table = isinstance(qpos, np.ndarray) and qpos.dtype.kind in "biuf" and qpos.ndim == 2
    if "cost" in values or qpos is None or not is_table or qpos.shape[1] < MIN_COLUMNS:
        return False
    return _is_unit(qpos[:, :4]) and not _is_unit(qpos[:, 3:7])


OMNIRETARGET = Format(
    name="omniretarget",
    convention=Convention("omniretarget", root_order="quat_pos", usual_fps=30.0),
    holds=_is_rotation_first,
    read=_read_qpos,
)
