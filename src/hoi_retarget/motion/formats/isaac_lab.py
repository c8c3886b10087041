"""`motion.npz` of BeyondMimic's whole_body_tracking (Isaac Lab's order) and mjlab's tracking task (MuJoCo's order).

Their arrays have the same names, and neither stores those of joints and bodies: only the numbers distinguish them.
Other trackers' files share the arrays of bodies and of one object. Many results are one file of Isaac Lab's data sets.
"""

import io
import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hoi_retarget.errors import HoiRetargetError, install_hint
from hoi_retarget.motion.contact_arrays import END_EFFECTORS
from hoi_retarget.motion.formats.containers import ArraysByName, has
from hoi_retarget.motion.formats.format import Format, VelocityPoint, Written
from hoi_retarget.motion.formats.motion_file import Bodies, ContactFlags, Convention, ObjectPoses
from hoi_retarget.motion.links import breadth_first, link_states, source_joint_names, source_joints
from hoi_retarget.motion.resample import ResampledMotion, resample
from hoi_retarget.motion.result import Result
from hoi_retarget.robots.model import RobotModel

DATA, DATA_FILE = "isaaclab", "motions.hdf5"  # The format of many results, and its file.


def read_bodies(arrays: ArraysByName) -> Bodies:
    """Return the bodies of a file; raises `ReadError`."""
    return Bodies(
        arrays.numbers("body_pos_w"),
        arrays.numbers("body_quat_w"),
        arrays.optional("body_lin_vel_w"),
        arrays.optional("body_ang_vel_w"),
    )


def body_arrays(motion: ResampledMotion, velocity_of: VelocityPoint) -> dict[str, np.ndarray]:
    """Return the arrays of all bodies in MuJoCo's order, (T, B, 3 or 4)."""
    links = link_states(motion)
    return {
        "body_pos_w": links.pos,
        "body_quat_w": links.quat,
        # Isaac Lab's body_lin_vel_w, with which its trackers compare, is that of the centre of mass.
        "body_lin_vel_w": links.com_lin_vel if velocity_of == "centres of mass" else links.lin_vel,
        "body_ang_vel_w": links.ang_vel,
    }


def object_arrays(motion: ResampledMotion) -> dict[str, np.ndarray]:
    """Return the arrays of the object in the format's one place for it, (T, 3 or 4); none where there is none."""
    if motion.object is None:
        return {}
    names = ("object_pos", "object_quat", "object_lin_vel", "object_ang_vel")
    return {f"{name}_w": getattr(motion, name)[:, motion.object] for name in names}


def with_object(bodies: dict[str, np.ndarray], object_paths: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return arrays of bodies with the object's at their ends, as one more body."""
    if not object_paths:
        return bodies
    return {
        name: np.concatenate([array, object_paths[name.replace("body", "object")][:, None]], axis=1)
        for name, array in bodies.items()
    }


Columns = np.ndarray | slice

OPEN = Convention("tracking", order=None)  # What both demand, as long as the order is not known.

holds = has("fps", "joint_pos", "joint_vel", "body_pos_w", "body_quat_w")


def _read_tracking(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; raises `ReadError`."""
    return {
        "convention": OPEN,
        "joint_pos": arrays.numbers("joint_pos"),
        "joint_vel": arrays.numbers("joint_vel"),
        "bodies": read_bodies(arrays),
        "objects": _objects(arrays),
        "contacts": _contacts(arrays.optional("contact_info")),
    }


def _objects(arrays: ArraysByName) -> tuple[ObjectPoses, ...]:
    if arrays.optional("object_pos_w") is None:
        return ()
    pose = arrays.pose("object_pos_w", "object_quat_w")
    velocities = (arrays.optional(f"object_{kind}_vel_w") for kind in ("lin", "ang"))
    return (ObjectPoses("object", pose, *velocities),)


def _contacts(shares: np.ndarray | None) -> ContactFlags | None:
    """Return the flags of OmniContact's four end effectors, from shares of contact with ramps from 0 to 1."""
    if shares is None or shares.ndim != 3 or shares.shape[1:] != (len(END_EFFECTORS), 1):
        return None
    return ContactFlags(END_EFFECTORS, shares[..., 0] > 0.5)


def _write_tracking(
    motion: ResampledMotion, velocity_of: VelocityPoint, fps: int | float, *, bodies: Columns, joints: Columns
) -> Written:
    """Return one motion, its bodies and joints in this order, in single precision."""
    model, source = motion.model, source_joints(motion)
    arrays = {"joint_pos": source.pos[:, joints], "joint_vel": source.vel[:, joints]}
    arrays |= {name: array[:, bodies] for name, array in body_arrays(motion, velocity_of).items()}
    single = {name: array.astype(np.float32) for name, array in arrays.items()}
    return Written(
        {"fps": np.array([fps]), **single},
        joint_names=tuple(np.array(source.names)[joints].tolist()),
        body_names=tuple(np.array(model.body_names)[bodies].tolist()),
    )


def _write_beyondmimic(motion: ResampledMotion) -> Written:
    """Return one motion in Isaac Lab's order."""
    model = motion.model
    bodies, _ = breadth_first(model)
    # Isaac Lab merges links without a joint into those that carry them.
    _, own = np.unique(model.bodies.nodes, return_index=True)
    bodies, joints = bodies[np.isin(bodies, own)], _isaac_joints(model)
    written = _write_tracking(motion, BEYONDMIMIC.linear_velocity_of, motion.rate, bodies=bodies, joints=joints)
    if not model.spec.description_file:
        return written
    held = f" Held joints ({len(model.spec.held)}) are left out: make them fixed." if model.spec.held else ""
    note = "Joints and links are in order down the tree; compare with robot.joint_names and body_names in Isaac Lab."
    return replace(written, notes=(note + held,))


BEYONDMIMIC = Format(
    name="beyondmimic",
    convention=Convention("beyondmimic", order="breadth_first"),
    holds=holds,
    read=_read_tracking,
    write=_write_beyondmimic,
    title="BeyondMimic, whole_body_tracking (Isaac Lab)",
    fps=50.0,
    contacts_inside=True,
    linear_velocity_of="centres of mass",
)


def _write_mjlab(motion: ResampledMotion) -> Written:
    """Return one motion in MuJoCo's order."""
    fps, as_they_are = float(motion.fps), slice(None)
    written = _write_tracking(motion, MJLAB.linear_velocity_of, fps, bodies=as_they_are, joints=as_they_are)
    note = "mjlab does not look at the file's rate: it must be that of the environment, 50 in its tasks."
    return replace(written, notes=(note,))


MJLAB = replace(
    BEYONDMIMIC,
    name="mjlab",
    convention=Convention("mjlab", order="depth_first"),
    write=_write_mjlab,
    title="mjlab, tracking task (MuJoCo Warp)",
    linear_velocity_of="link origins",
)


def _isaac_joints(model: RobotModel) -> np.ndarray:
    """Return which of the description's joints each one in Isaac Lab's order is."""
    names, (_, joints) = source_joint_names(model), breadth_first(model)
    return np.array([names.index(model.joint_names[joint]) for joint in joints])


def write_demonstrations(results: Sequence[Result], fps: float | None) -> dict[str, bytes]:
    """Return a file of Isaac Lab's data sets, a demonstration a motion; `HoiRetargetError` where h5py is missing.

    Joints are in Isaac Lab's order; poses are positions [m], then rotations wxyz, as in its version 2; actions are the
    joints' next angles [rad]. Source: isaac-sim/IsaacLab, `isaaclab/utils/datasets/hdf5_dataset_file_handler.py`.
    """
    if hint := install_hint("h5py"):
        raise HoiRetargetError(f"A data set of Isaac Lab is written with h5py, which is not installed. {hint}")
    import h5py  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - optional

    motions, buffer = [resample(item.motion, item.model, fps or BEYONDMIMIC.fps) for item in results], io.BytesIO()
    with h5py.File(buffer, "w") as file:
        data = file.create_group("data")
        data.attrs["total"] = sum(motion.frames for motion in motions)
        data.attrs["env_args"] = json.dumps({"env_name": "", "type": 2})
        for index, (result, motion) in enumerate(zip(results, motions, strict=True)):
            demo, joints = data.create_group(f"demo_{index}"), _isaac_joints(motion.model)
            demo.attrs.update(num_samples=motion.frames, clip=result.stem, fps=motion.fps)
            demo.attrs["joint_names"] = [source_joint_names(motion.model)[joint] for joint in joints]
            demo.attrs["contact_links"] = list(motion.motion.contact_links)
            states = _states(motion, joints)
            angles = states["articulation/robot/joint_position"]
            arrays = {f"states/{name}": values for name, values in states.items()}
            arrays |= {f"initial_state/{name}": values[:1] for name, values in states.items()}
            arrays |= {"actions": np.concatenate([angles[1:], angles[-1:]]), "obs/contacts": motion.contact_flags}
            for name, values in arrays.items():
                demo.create_dataset(name, data=values.astype(np.float32), compression="gzip")
    return {DATA_FILE: buffer.getvalue()}


def _states(motion: ResampledMotion, joints: np.ndarray) -> dict[str, np.ndarray]:
    """Return the arrays of robot and objects by their place in a scene's state."""
    source, objects = source_joints(motion), motion.motion.object_names
    poses = np.concatenate([motion.object_pos, motion.object_quat], axis=2)
    speeds = np.concatenate([motion.object_lin_vel, motion.object_ang_vel], axis=2)
    found = {
        "root_pose": motion.qpos[:, :7],
        "root_velocity": np.concatenate([motion.root_lin_vel, motion.root_ang_vel], axis=1),
        "joint_position": source.pos[:, joints],
        "joint_velocity": source.vel[:, joints],
    }
    return {f"articulation/robot/{name}": values for name, values in found.items()} | {
        f"rigid_object/{name}/root_{kind}": values[:, index]
        for index, name in enumerate(objects)
        for kind, values in (("pose", poses), ("velocity", speeds))
    }
