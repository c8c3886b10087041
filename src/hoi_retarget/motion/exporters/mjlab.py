"""`motion.npz` of mjlab's tracking task: joints and bodies in MuJoCo's order, link frames."""

import numpy as np

from hoi_retarget.motion.exporters.encoding import to_npz
from hoi_retarget.motion.exporters.format import Format, Take, Written


def write(take: Take) -> Written:
    """Return the file of one motion."""
    trajectory, links = take.trajectory, take.links
    arrays = {
        "joint_pos": trajectory.qpos[:, 7:],
        "joint_vel": trajectory.joint_vel,
        "body_pos_w": links.pos,
        "body_quat_w": links.quat,
        "body_lin_vel_w": links.lin_vel,
        "body_ang_vel_w": links.ang_vel,
    }
    single = {name: array.astype(np.float32) for name, array in arrays.items()}
    return Written(
        files={".npz": to_npz({"fps": np.array([float(trajectory.fps)]), **single, **take.contacts})},
        joint_names=take.model.joint_names,
        body_names=links.names,
        quaternions="wxyz",
        linear_velocity_of="link origins",
        notes=("mjlab does not look at the file's rate: it must be that of the environment, 50 in its tasks.",),
    )


FORMAT = Format(
    name="mjlab",
    title="mjlab, tracking task (MuJoCo Warp)",
    suffix=".npz",
    fps=50.0,
    place_for_object=False,
    contacts_inside=True,
    robots=(),
    write=write,
)
