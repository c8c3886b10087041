"""A folder of CSV that GEAR-SONIC plays, in Isaac Lab's order, and the motion library that it and GRAIL train on.

Cites: NVlabs/GR00T-WholeBodyControl 1983e88, `gear_sonic/utils/motion_lib/motion_lib_base.py`, `new_embodiments.md`.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.human.skeleton import HANDS
from hoi_retarget.motion.contact_arrays import contact_arrays
from hoi_retarget.motion.formats.containers import CSV_FOLDER, JOINTS, ArraysByName, has, to_pickle
from hoi_retarget.motion.formats.csv import named_columns
from hoi_retarget.motion.formats.format import Format
from hoi_retarget.motion.formats.motion_file import Convention
from hoi_retarget.motion.resample import ResampledMotion, resample
from hoi_retarget.motion.result import Result
from hoi_retarget.numerics import se3
from hoi_retarget.robots.spec import FINGER_SITES, PALMS

_POSITIONS, _ROTATIONS, _VELOCITIES = "body_pos", "body_quat", ("body_lin_vel", "body_ang_vel")


def read(arrays: ArraysByName) -> dict[str, Any]:
    """Return the fields of a `MotionFile`; bodies but the first are left out. Raises `ReadError`."""
    joints = named_columns(arrays.names(f"{JOINTS} columns"))
    root = arrays.joined(_first_body(arrays, _POSITIONS, 3), _first_body(arrays, _ROTATIONS, 4))
    velocities = [_first_body(arrays, name, 3) for name in _VELOCITIES if name in arrays]
    joint_vel = None
    if joints.joint_names is None and "joint_vel" in arrays:
        joint_vel = arrays.numbers("joint_vel")[:, named_columns(arrays.names("joint_vel columns")).joints]
    return {
        "root": root,
        "joint_pos": arrays.numbers(JOINTS)[:, joints.joints],
        "joint_names": joints.joint_names,
        "joint_vel": joint_vel,
        "root_vel": arrays.joined(*velocities) if len(velocities) == len(_VELOCITIES) else None,
    }


def _first_body(arrays: ArraysByName, name: str, width: int) -> np.ndarray:
    if name not in arrays:
        raise ReadError(f"{arrays.path.with_name(name)}.csv: there is no such file. The root's path is in it.")
    return arrays.table(name, width)[:, :width]


FORMAT = Format(
    name="sonic",
    convention=Convention("sonic", order="breadth_first", usual_fps=50.0),
    holds=has(JOINTS),
    read=read,
    container=CSV_FOLDER,
)

LIBRARY = "sonic-motion-lib"
_SMPL_JOINTS = 24  # Of people beside robots; zeros where there are none.


def write_library(results: Sequence[Result], fps: float | None) -> dict[str, bytes]:
    """Return a motion library: for each motion `robot/NAME.pkl`, and where it has objects `objects/NAME.pkl`.

    Fingers stand behind the body's joints, and a hand's action is 1 around its contacts and -1 elsewhere.
    Raises `ArgumentError` for motions of several robots.
    """
    if len(robots := sorted({result.motion.robot for result in results})) > 1:
        raise ArgumentError(f"A motion library is of one robot; these are of {', '.join(robots)}. Write one for each.")
    files: dict[str, bytes] = {}
    for result in results:
        motion, name = resample(result.motion, result.model, fps), f"{result.stem}.pkl"
        files[f"robot/{name}"] = to_pickle({result.stem: _robot(motion)})
        if motion.motion.object_names:
            files[f"objects/{name}"] = to_pickle({result.stem: _objects(motion)})
    return files


def _robot(motion: ResampledMotion) -> dict[str, Any]:
    model, angles = motion.model, motion.qpos[:, 7:]
    frames = model.sites.frames
    pads, palms = ([frames[site].node for site in sites] for sites in (model.spec.fingers.values(), PALMS))
    fingers = model.supports[1:, pads].any(axis=1) & ~model.supports[1:, palms].any(axis=1)
    turns = np.concatenate([se3.log(motion.qpos[:, None, 3:7]), angles[:, ~fingers, None] * model.axes.T[~fingers]], 1)
    closed = 2.0 * contact_arrays(motion, {})["contact_hand_closed"] - 1.0
    values = {
        "root_trans_offset": motion.qpos[:, :3],
        "root_rot": se3.quat_to_xyzw(motion.qpos[:, 3:7]),
        "pose_aa": turns,
        "dof": np.concatenate([angles[:, ~fingers], angles[:, fingers]], axis=1),
        "smpl_joints": np.zeros((motion.frames, _SMPL_JOINTS, 3)),
        **{f"hand_action_{hand.removesuffix('_hand')}": closed[:, side] for side, hand in enumerate(HANDS)},
    }
    return {"fps": motion.rate, **{name: array.astype(np.float32) for name, array in values.items()}}


def _objects(motion: ResampledMotion) -> dict[str, Any]:
    """Return poses (wxyz) of objects, and points of each hand in the first object's frame by frame [m]."""
    found: dict[str, Any] = {"fps": motion.rate, "names": list(motion.motion.object_names)}
    found |= {"scale": motion.motion.object_scale, "root_pos": motion.object_pos, "root_quat": motion.object_quat}
    for hand, palm in zip(HANDS, PALMS, strict=True):
        sites = {palm, *(site for site in FINGER_SITES if site.startswith(palm.removesuffix("palm")))}
        links = [link in sites for link in motion.motion.contact_links]
        touching = (motion.contact_flags & (motion.contact_object == 0))[:, links]
        points = {frame: motion.contact_points[frame, links][own] for frame, own in enumerate(touching) if own.any()}
        found[f"contact_points_{hand}"] = points
    return found
