"""`motion.npz` of BeyondMimic's whole_body_tracking: joints and bodies in Isaac Lab's order."""

import numpy as np

from hoi_retarget.motion.exporters.encoding import rate, to_npz
from hoi_retarget.motion.exporters.format import Format, Take, Written
from hoi_retarget.motion.exporters.links import breadth_first


def write(take: Take) -> Written:
    """Return the file of one motion."""
    bodies, joints = breadth_first(take.model)
    trajectory, links = take.trajectory, take.links
    arrays = {
        "joint_pos": trajectory.qpos[:, 7:][:, joints],
        "joint_vel": trajectory.joint_vel[:, joints],
        "body_pos_w": links.pos[:, bodies],
        "body_quat_w": links.quat[:, bodies],
        # Isaac Lab's body_lin_vel_w, with which the tracker compares, is that of the centre of mass.
        "body_lin_vel_w": links.com_lin_vel[:, bodies],
        "body_ang_vel_w": links.ang_vel[:, bodies],
    }
    single = {name: array.astype(np.float32) for name, array in arrays.items()}
    return Written(
        files={".npz": to_npz({"fps": np.array([rate(trajectory.fps)]), **single, **take.contacts})},
        joint_names=tuple(take.model.joint_names[joint] for joint in joints),
        body_names=tuple(links.names[body] for body in bodies),
        quaternions="wxyz",
        linear_velocity_of="centres of mass",
    )


FORMAT = Format(
    name="beyondmimic",
    title="BeyondMimic, whole_body_tracking (Isaac Lab)",
    suffix=".npz",
    fps=50.0,
    place_for_object=False,
    contacts_inside=True,
    # The file has no names, and how Isaac Lab orders the joints is known for the G1 alone.
    robots=("unitree_g1",),
    write=write,
)
