"""HDMI's folder of `motion.npz` and `meta.json`: joints and bodies by name, objects are bodies."""

import numpy as np

from hoi_retarget.motion.exporters.encoding import to_json, to_npz
from hoi_retarget.motion.exporters.format import Format, Take, Written

# Every motion of a training set must have the same meta.json; HDMI's own have no waist links.
_LEFT_OUT = ("waist_yaw_link", "waist_roll_link")
_LOADED_AT = 50.0


def write(take: Take) -> Written:
    """Return the folder of one motion."""
    trajectory, links = take.trajectory, take.links
    kept = [index for index, name in enumerate(links.names) if name not in _LEFT_OUT]
    names = [links.names[index] for index in kept]
    bodies = {
        "body_pos_w": links.pos[:, kept],
        "body_quat_w": links.quat[:, kept],
        "body_lin_vel_w": links.com_lin_vel[:, kept],
        "body_ang_vel_w": links.ang_vel[:, kept],
    }
    touched: dict[str, np.ndarray] = {}
    if take.object is not None:
        paths = (
            trajectory.object_pos,
            trajectory.object_quat,
            trajectory.object_lin_vel,
            trajectory.object_ang_vel,
        )
        one = slice(take.object, take.object + 1)
        bodies = {
            name: np.concatenate([array, path[:, one]], axis=1)
            for (name, array), path in zip(bodies.items(), paths, strict=True)
        }
        names.append(take.object_name)
        touching = trajectory.contact_flags & (trajectory.contact_object == take.object)
        touched = {"object_contact": touching.any(axis=1, keepdims=True)}
    arrays = {"joint_pos": trajectory.qpos[:, 7:], "joint_vel": trajectory.joint_vel}
    meta = {"body_names": names, "joint_names": list(take.model.joint_names), "fps": float(trajectory.fps)}
    return Written(
        files={"/motion.npz": to_npz({**bodies, **arrays, **touched}), "/meta.json": to_json(meta)},
        joint_names=take.model.joint_names,
        body_names=tuple(names),
        quaternions="wxyz",
        linear_velocity_of="centres of mass",
        notes=_notes(trajectory.fps) if touched else (),
    )


def _notes(fps: float) -> tuple[str, ...]:
    if fps == _LOADED_AT:
        return ()
    return (f"HDMI refuses files with contacts at {fps:g} frames a second: its loader interpolates none of them.",)


FORMAT = Format(
    name="hdmi",
    title="HDMI (Isaac Lab, mjlab)",
    suffix="",
    fps=_LOADED_AT,
    place_for_object=True,
    contacts_inside=False,
    robots=(),
    write=write,
)
