"""What holosoma's retargeter writes: one array of configurations, the object's pose at its end."""

import numpy as np

from hoi_retarget.motion.exporters.encoding import rate, to_npz
from hoi_retarget.motion.exporters.format import Format, Take, Written


def write(take: Take) -> Written:
    """Return the file of one motion."""
    trajectory = take.trajectory
    columns = [trajectory.qpos]
    if take.object is not None:
        columns += [trajectory.object_pos[:, take.object], trajectory.object_quat[:, take.object]]
    arrays = {"qpos": np.concatenate(columns, axis=1), "fps": np.array(rate(trajectory.fps))}
    return Written(
        files={".npz": to_npz({**arrays, **take.contacts})},
        joint_names=take.model.joint_names,
        quaternions="wxyz",
        notes=(
            f"holosoma's converter takes the rate from its command line: pass --input_fps {rate(trajectory.fps)}.",
            "The human's joints and the solver's cost, which holosoma's retargeter adds, are not in the file.",
        ),
    )


FORMAT = Format(
    name="holosoma-qpos",
    title="holosoma, converter and viewers of retargeted motions",
    suffix=".npz",
    fps=30.0,
    place_for_object=True,
    contacts_inside=True,
    robots=(),
    write=write,
)
