"""What holosoma's retargeter writes: one table of configurations, positions first, the object's pose at its end."""

import numpy as np

from hoi_retarget.motion.formats import qpos_table
from hoi_retarget.motion.formats.arrays_by_name import ArraysByName, has
from hoi_retarget.motion.formats.body_arrays import object_arrays
from hoi_retarget.motion.formats.encoding import rate, to_npz
from hoi_retarget.motion.formats.format import Format, ResampledMotion, Written
from hoi_retarget.motion.formats.motion_file import Convention, MotionFile


def read(arrays: ArraysByName) -> MotionFile:
    """Return what the table of a file holds; raises `ReadError`."""
    return qpos_table.read(arrays, FORMAT.convention)


def write(motion: ResampledMotion) -> Written:
    """Return the file of one motion."""
    fps, thing = rate(motion.trajectory.fps), list(object_arrays(motion).values())
    arrays = {"qpos": np.concatenate([motion.trajectory.qpos, *thing[:2]], axis=1), "fps": np.array(fps)}
    return Written(
        files={".npz": to_npz({**arrays, **motion.contacts})},
        joint_names=motion.model.joint_names,
        notes=(
            f"holosoma's converter takes the rate from its command line: pass --input_fps {fps}.",
            "The human's joints and the solver's cost, which holosoma's retargeter adds, are not in the file.",
        ),
    )


FORMAT = Format(
    name="holosoma-qpos",
    convention=Convention("holosoma-retarget", usual_fps=30.0),
    holds=has("qpos"),
    read=read,
    write=write,
    title="holosoma, converter and viewers of retargeted motions",
    fps=30.0,
    place_for_object=True,
    contacts_inside=True,
)
