"""`motion.npz` of mjlab's tracking task: joints and bodies in MuJoCo's order, link frames."""

from hoi_retarget.motion.formats import tracking
from hoi_retarget.motion.formats.body_arrays import body_arrays
from hoi_retarget.motion.formats.format import Format, ResampledMotion, Written
from hoi_retarget.motion.formats.motion_file import Convention


def write(motion: ResampledMotion) -> Written:
    """Return the file of one motion."""
    trajectory, bodies = motion.trajectory, body_arrays(motion, FORMAT.linear_velocity_of)
    return Written(
        files={
            ".npz": tracking.encode(
                float(trajectory.fps), trajectory.qpos[:, 7:], trajectory.joint_vel, bodies, motion.contacts
            )
        },
        joint_names=motion.model.joint_names,
        body_names=motion.links.names,
        notes=("mjlab does not look at the file's rate: it must be that of the environment, 50 in its tasks.",),
    )


FORMAT = Format(
    name="mjlab",
    convention=Convention("mjlab", order="depth_first"),
    holds=tracking.holds,
    read=tracking.read,
    write=write,
    title="mjlab, tracking task (MuJoCo Warp)",
    fps=50.0,
    contacts_inside=True,
    linear_velocity_of="link origins",
)
