"""What holosoma's retargeter writes: one table of configurations, positions first, the object's pose at its end."""

import numpy as np

from hoi_retarget.motion.formats import qpos_table
from hoi_retarget.motion.formats.arrays_by_name import has
from hoi_retarget.motion.formats.body_arrays import object_arrays
from hoi_retarget.motion.formats.format import Format, Written
from hoi_retarget.motion.formats.motion_file import Convention
from hoi_retarget.motion.makers_joints import makers_joints
from hoi_retarget.motion.resample import ResampledMotion


def write(motion: ResampledMotion) -> Written:
    """Return one motion as a table."""
    thing, joints = list(object_arrays(motion).values()), makers_joints(motion)
    return Written(
        {"qpos": np.concatenate([motion.qpos[:, :7], joints.pos, *thing[:2]], axis=1), "fps": np.array(motion.rate)},
        joints.names,
        notes=(
            f"holosoma's converter takes the rate from its command line: pass --input_fps {motion.rate}.",
            "The human's joints and the solver's cost, which holosoma's retargeter adds, are not in the file.",
        ),
    )


FORMAT = Format(
    name="holosoma-qpos",
    convention=Convention("holosoma-retarget", usual_fps=30.0),
    holds=has("qpos"),
    read=qpos_table.read,
    write=write,
    title="holosoma, converter and viewers of retargeted motions",
    fps=30.0,
    place_for_object=True,
    contacts_inside=True,
)
