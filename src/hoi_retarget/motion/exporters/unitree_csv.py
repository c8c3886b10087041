"""Unitree's CSV of root and joints without a header, which both csv_to_npz scripts read."""

import io

import numpy as np

from hoi_retarget.motion.exporters.encoding import rate
from hoi_retarget.motion.exporters.format import Format, Take, Written
from hoi_retarget.numerics import se3


def write(take: Take) -> Written:
    """Return the file of one motion."""
    qpos = take.trajectory.qpos
    text = io.StringIO()
    rows = np.concatenate([qpos[:, :3], se3.quat_to_xyzw(qpos[:, 3:7]), qpos[:, 7:]], axis=1)
    np.savetxt(text, rows, fmt="%.9f", delimiter=",")
    return Written(
        files={".csv": text.getvalue().encode()},
        joint_names=take.model.joint_names,
        quaternions="xyzw",
        notes=(f"The file does not tell its rate: pass --input_fps {rate(take.trajectory.fps)} to what reads it.",),
    )


FORMAT = Format(
    name="unitree-csv",
    title="csv_to_npz of BeyondMimic and mjlab, Unitree's LAFAN1 set",
    suffix=".csv",
    fps=30.0,
    place_for_object=False,
    contacts_inside=False,
    # Nothing in the file tells the robot; its readers take 29 joints for the G1's.
    robots=("unitree_g1",),
    write=write,
)
