"""Motion files of BeyondMimic (whole_body_tracking) and mjlab: the same arrays, in different orders.

The joints and bodies of the first are in Isaac Lab's breadth-first order, those of the second in MuJoCo's
depth-first one. Neither stores names, so only the numbers tell which of the two a file is.
"""

from pathlib import Path

from hoi_retarget.motion.formats.arrays_by_name import Arrays, contents, numbers, optional_numbers, rate
from hoi_retarget.motion.formats.motion_file import Bodies, Convention, MotionFile

FORMAT = "tracking"
BREADTH_FIRST, DEPTH_FIRST = "beyondmimic", "mjlab"
"""What a tracking file is, once its order is known."""
KEYS = frozenset({"fps", "joint_pos", "joint_vel", "body_pos_w", "body_quat_w"})


def parse(path: Path, arrays: Arrays) -> MotionFile:
    """Return what the arrays of a tracking file hold; raises `ReadError`."""
    return MotionFile(
        path=str(path),
        format=FORMAT,
        convention=Convention(order=None),
        contents=contents(arrays),
        fps=rate(path, arrays),
        joint_pos=numbers(path, arrays, "joint_pos"),
        joint_vel=numbers(path, arrays, "joint_vel"),
        bodies=Bodies(
            numbers(path, arrays, "body_pos_w"),
            numbers(path, arrays, "body_quat_w"),
            optional_numbers(path, arrays, "body_lin_vel_w"),
            optional_numbers(path, arrays, "body_ang_vel_w"),
        ),
    )
