"""Do links and objects move as on the human side, and smoothly?"""

import numpy as np
from jaxtyping import Float

from hoi_retarget.evaluate.statistics import direction_angles_deg, max_or_none, mean_or_none, norms
from hoi_retarget.evaluate.view import HAND_SITES, Comparison, ObjectPose
from hoi_retarget.robots.model import Kinematics

MINIMUM_SPEED_MPS = 0.02
"""Below this speed [m/s] a direction means nothing (paper's table of metrics)."""

# Robot site and human joint; the palms are added from `HAND_SITES`.
_LINKS = (("left_foot", "left_ankle"), ("right_foot", "right_ankle"), ("head", "head"), ("pelvis", "pelvis"))


def link_velocity_direction_deg(view: Comparison) -> float | None:
    """Return the mean angle [deg] between the two sides' link velocities relative to the object.

    Over palms, ankles, head and pelvis, wherever both sides exceed 2 cm/s. With several objects, relative to
    the one that the person touches longest; None without objects.
    """
    index = view.main_object
    if index is None:
        return None
    robot_points = [view.robot_point(site) for site in HAND_SITES.values()]
    robot_points += [view.robot_point(site) for site, _ in _LINKS]
    human_points = [view.human_part_point(part) for part in HAND_SITES]
    human_points += [view.human_point(joint) for _, joint in _LINKS]
    robot = _velocities_inside(view.robot_objects[index], np.stack(robot_points, axis=1), view.clip.fps)
    human = _velocities_inside(view.human_objects[index], np.stack(human_points, axis=1), view.clip.fps)
    moving = (norms(robot) > MINIMUM_SPEED_MPS) & (norms(human) > MINIMUM_SPEED_MPS)
    return mean_or_none(direction_angles_deg(robot[moving], human[moving]))


def _velocities_inside(
    pose: ObjectPose, points: Float[np.ndarray, "F K 3"], fps: float
) -> Float[np.ndarray, "F-1 K 3"]:
    """Return `R_o^T (v - v_o)` [m/s], backward differences, with the rotation of the later frame."""
    # (v - v_o) is the difference of (p - p_o): the object's rotation is not differentiated.
    relative = np.diff(points - pose.positions[:, None], axis=0) * fps
    return ObjectPose(pose.positions[1:], pose.rotations[1:]).vectors_inside(relative)


def body_jerks(kinematics: Kinematics, fps: float) -> Float[np.ndarray, "J B"]:
    """Return the magnitude of the third difference of all links with mass [m/s^3], from every frame over four."""
    positions = kinematics.body_positions
    # Written out: three passes of `numpy.diff` cost twice as much.
    third = positions[3:] - positions[:-3] - 3.0 * (positions[2:-1] - positions[1:-2])
    return norms(third) * fps**3


def jerk_summary(jerks: Float[np.ndarray, "J B"]) -> tuple[float | None, float | None]:
    """Return mean and maximum [m/s^3]; None for fewer than four counted frames."""
    return mean_or_none(jerks), max_or_none(jerks)


def object_path_error_m(view: Comparison) -> float | None:
    """Return the mean distance [m] of the two sides' object translations, each relative to its first counted frame."""
    distances = [
        norms((robot.positions - robot.positions[:1]) - (human.positions - human.positions[:1]))
        for robot, human in zip(view.robot_objects, view.human_objects, strict=True)
    ]
    return mean_or_none(np.array(distances))
