"""World poses and velocities of bodies and of one object, as trackers' files name their arrays."""

import numpy as np

from hoi_retarget.motion.formats.arrays_by_name import ArraysByName
from hoi_retarget.motion.formats.format import VelocityPoint
from hoi_retarget.motion.formats.motion_file import Bodies
from hoi_retarget.motion.links import link_states
from hoi_retarget.motion.resample import ResampledMotion


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
    paths = {
        "object_pos_w": motion.object_pos,
        "object_quat_w": motion.object_quat,
        "object_lin_vel_w": motion.object_lin_vel,
        "object_ang_vel_w": motion.object_ang_vel,
    }
    return {name: path[:, motion.object] for name, path in paths.items()}


def with_object(bodies: dict[str, np.ndarray], thing: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return arrays of bodies with those of an object behind them, as one more body."""
    if not thing:
        return bodies
    return {
        name: np.concatenate([array, thing[name.replace("body", "object")][:, None]], axis=1)
        for name, array in bodies.items()
    }
