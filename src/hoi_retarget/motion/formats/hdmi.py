"""HDMI's folder of `motion.npz` and `meta.json`: joints and bodies by name, objects are bodies."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.motion.formats.containers import META, NPZ_AND_JSON, ArraysByName, has
from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.formats.isaac_lab import body_arrays, object_arrays, read_bodies, with_object
from hoi_retarget.motion.formats.motion_file import ContactFlags, Convention
from hoi_retarget.motion.links import source_joints
from hoi_retarget.motion.resample import ResampledMotion

# Every motion of a training set must have the same meta.json; HDMI's own have no waist links.
_LEFT_OUT = ("waist_yaw_link", "waist_roll_link")
_LOADED_AT = 50.0


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`, names and rate from the meta file beside; raises `ReadError`."""
    meta = ArraysByName(arrays.path, _meta(arrays.path))
    return {
        "fps": meta.rate(),
        "joint_pos": arrays.numbers("joint_pos"),
        "joint_vel": arrays.optional("joint_vel"),
        "bodies": read_bodies(arrays),
        "joint_names": meta.names("joint_names"),
        "body_names": meta.names("body_names"),
        "contacts": _contacts(arrays.optional("object_contact")),
    }


def _contacts(flags: np.ndarray | None) -> ContactFlags | None:
    if flags is not None and flags.ndim == 1:
        flags = flags[:, None]
    if flags is None or flags.ndim != 2:
        return None
    return ContactFlags(tuple(f"object_contact{index}" for index in range(flags.shape[1])), flags > 0.5)


def _meta(path: Path) -> dict:
    # motion.npz has meta.json beside it, walk_motion.npz has walk_meta.json.
    place = path.with_name(path.name.replace("motion", "meta")).with_suffix(".json")
    if not place.is_file():
        raise ReadError(
            f"{path}: it has bodies and joints but neither names nor a rate, and there is no {place.name} beside it. "
            "An HDMI motion needs its meta.json; other tracking files have 'fps' in them."
        )
    try:
        meta = json.loads(read_bytes(place).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise ReadError(f"{place}: not readable JSON ({error}). Make the file again.") from error
    if not isinstance(meta, dict):
        raise ReadError(f"{place}: expected an object with body_names, joint_names and fps.")
    return meta


def write(motion: ResampledMotion) -> Written:
    """Return one motion as HDMI has it."""
    object_paths, body_names = object_arrays(motion), motion.model.body_names
    joints = source_joints(motion)
    kept = [index for index, name in enumerate(body_names) if name not in _LEFT_OUT]
    names = [*(body_names[index] for index in kept), *([motion.object_name] if object_paths else [])]
    bodies = {name: array[:, kept] for name, array in body_arrays(motion, FORMAT.linear_velocity_of).items()}
    arrays = {"joint_pos": joints.pos, "joint_vel": joints.vel}
    if object_paths:
        touching = motion.contact_flags & (motion.contact_object == motion.object)
        arrays["object_contact"] = touching.any(axis=1, keepdims=True)
    note = f"HDMI refuses files with contacts at {motion.fps:g} frames a second: its loader interpolates none of them."
    meta = {"body_names": names, "joint_names": list(joints.names), "fps": float(motion.fps)}
    return Written(
        {**with_object(bodies, object_paths), **arrays, META: meta},
        joints.names,
        tuple(names),
        notes=() if motion.fps == _LOADED_AT or not object_paths else (note,),
    )


FORMAT = Format(
    name="hdmi",
    convention=Convention("hdmi", order="names"),
    holds=has("joint_pos", "body_pos_w", "body_quat_w"),
    read=read,
    container=NPZ_AND_JSON,
    write=write,
    title="HDMI (Isaac Lab, mjlab)",
    fps=_LOADED_AT,
    place_for_object=True,
    linear_velocity_of="centres of mass",
)
