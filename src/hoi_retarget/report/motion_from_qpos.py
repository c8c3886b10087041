"""A result made from a robot's path alone: no clip, no contacts, and the figures that need neither."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.evaluation import ground, limits, movement
from hoi_retarget.evaluation.link_heights import link_heights
from hoi_retarget.evaluation.self_penetration import self_depths
from hoi_retarget.evaluation.statistics import finite_min_or_none, max_or_none, mean_or_none
from hoi_retarget.motion.check import ObjectPath
from hoi_retarget.motion.motion import Motion, Stage
from hoi_retarget.motion.report import Report
from hoi_retarget.robots.model import Kinematics, RobotModel

STANDING_HEIGHT = 0.03
"""A foot whose lowest corner is no further above where feet stand in this motion may stand [m]."""
STANDING_SPEED = 0.3
"""A foot that low and slower than this stands [m/s]; the slower of the low ones always does."""
_STANDING_PERCENTILE = 5.0  # Of the lower foot's height: where feet stand.


def motion_from_qpos(
    qpos: Float[np.ndarray, "T nq"], fps: float, model: RobotModel, objects: Sequence[ObjectPath] = ()
) -> Motion:
    """Return a robot's path as a result, with the figures in its report that need no human and no object's shape.

    Its stance is estimated. Who touches what is not known, and inverse kinematics is the motion itself.

    Args:
        qpos: Root position [m], root rotation wxyz, joints [rad] in the model's order.
        fps: Frames a second.
        model: The robot.
        objects: What it moves.

    Raises:
        ClipError: Numbers are not finite, or rotations are no unit quaternions.
    """
    frames, kinematics = len(qpos), model.forward(qpos)
    motion = Motion(
        robot=model.spec.name,
        fps=fps,
        joint_names=model.joint_names,
        stages=(Stage("motion", qpos),),
        object_names=tuple(item.name for item in objects),
        object_pos=np.stack([item.pos for item in objects], axis=1) if objects else np.zeros((frames, 0, 3)),
        object_quat=np.stack([item.quat for item in objects], axis=1) if objects else np.zeros((frames, 0, 4)),
        object_scale=np.ones(len(objects)),
        contact_links=(),
        contact_flags=np.zeros((frames, 0), dtype=bool),
        contact_object=np.zeros((frames, 0), dtype=int),
        contact_points=np.zeros((frames, 0, 3)),
        stance_flags=estimated_stance(kinematics, fps),
        first_source_frame=0,
        human_height=0.0,
    )
    return replace(motion, report=Report(figures=_figures(motion, kinematics, model)))


def estimated_stance(kinematics: Kinematics, fps: float) -> Bool[np.ndarray, "T 2"]:
    """Return when each foot stands: it is low, and slow or the slower of the two.

    Low is meant over the height at which the lower foot usually is, so that a motion that floats as a whole stands,
    too. The slower of the low feet stands however fast it is, or nothing that skates would be found.
    """
    heights = ground.sole_heights(kinematics)
    floor = np.percentile(heights.min(axis=1), _STANDING_PERCENTILE)
    low = heights < floor + STANDING_HEIGHT
    steps = ground.foot_speeds(kinematics, fps)
    # Of a frame: the slower one of the steps to it and from it.
    around = np.concatenate([steps[:1], steps, steps[-1:]]) if len(steps) else np.zeros((2, 2))
    speeds = np.where(low, np.minimum(around[:-1], around[1:]), np.inf)
    return low & ((speeds < STANDING_SPEED) | (speeds <= speeds.min(axis=1, keepdims=True)))


def _figures(motion: Motion, kinematics: Kinematics, model: RobotModel) -> dict[str, float | None]:
    stance, heights = motion.stance_flags, ground.sole_heights(kinematics)
    jerks = movement.body_jerks(kinematics, motion.fps)
    speeds = ground.foot_speeds(kinematics, motion.fps)
    return {
        "body_jerk_mps3": mean_or_none(jerks),
        "body_jerk_max_mps3": max_or_none(jerks),
        "stance_slide_mps": mean_or_none(speeds[stance[1:] & stance[:-1]]),
        "stance_float_m": mean_or_none(np.maximum(heights[stance], 0.0)),
        "floor_penetration_max_m": ground.deepest(heights),
        "link_below_floor_m": max_or_none(np.maximum(-link_heights(kinematics), 0.0)),
        "self_penetration_max_m": max_or_none(self_depths(kinematics)[0]),
        "joint_range_margin_rad": finite_min_or_none(limits.joint_range_margins(motion, model)),
        "joint_speed_margin_radps": finite_min_or_none(limits.joint_speed_margins(motion, model)),
    }
