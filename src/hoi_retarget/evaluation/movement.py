"""Do links and objects move as on the human side, and smoothly?"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.evaluation.statistics import direction_angles_deg, max_or_none, mean_or_none, norms
from hoi_retarget.evaluation.view import HAND_SITES, Comparison, ObjectPose
from hoi_retarget.robots.model import Kinematics

MINIMUM_SPEED_MPS = 0.02
"""Below this speed [m/s] a direction means nothing (paper's table of metrics)."""

# Robot site and human joint; the palms are added from `HAND_SITES`.
_LINKS = (("left_foot", "left_ankle"), ("right_foot", "right_ankle"), ("head", "head"), ("pelvis", "pelvis"))


def link_velocity_direction_deg(view: Comparison) -> float | None:
    """Return the mean angle [deg] between the two sides' link velocities relative to the object.

    Over palms, ankles, head and pelvis, wherever both sides exceed 2 cm/s. With several objects, relative to
    the one that the person touches longest; without objects, in the world.
    """
    robot_points = [view.robot_point(site) for site in HAND_SITES.values()]
    robot_points += [view.robot_point(site) for site, _ in _LINKS]
    human_points = [view.human_part_point(part) for part in HAND_SITES]
    human_points += [view.human_point(joint) for _, joint in _LINKS]
    robot = _velocities(np.stack(robot_points, axis=1), view.robot_objects, view)
    human = _velocities(np.stack(human_points, axis=1), view.human_objects, view)
    moving = (norms(robot) > MINIMUM_SPEED_MPS) & (norms(human) > MINIMUM_SPEED_MPS)
    return mean_or_none(direction_angles_deg(robot[moving], human[moving]))


def _velocities(
    points: Float[np.ndarray, "F K 3"], objects: Sequence[ObjectPose], view: Comparison
) -> Float[np.ndarray, "F-1 K 3"]:
    """Return `R_o^T (v - v_o)` [m/s], or `v`, backward differences, with the rotation of the later frame."""
    if view.main_object is None:
        return np.diff(points, axis=0) * view.clip.fps
    pose = objects[view.main_object]
    # (v - v_o) is the difference of (p - p_o): the object's rotation is not differentiated.
    relative = np.diff(points - pose.positions[:, None], axis=0) * view.clip.fps
    return ObjectPose(pose.positions[1:], pose.rotations[1:]).vectors_inside(relative)


def body_jerks(kinematics: Kinematics, fps: float) -> Float[np.ndarray, "J B"]:
    """Return the magnitude of the third difference of all links with mass [m/s^3], from every frame over four."""
    positions = kinematics.body_positions
    # Written out: three passes of `numpy.diff` cost twice as much.
    third = positions[3:] - positions[:-3] - 3.0 * (positions[2:-1] - positions[1:-2])
    return norms(third) * fps**3


def body_jerk_mps3(view: Comparison) -> float | None:
    """Return the mean third difference of the positions of all links with mass [m/s^3]."""
    return mean_or_none(view.once(_counted_jerks))


def body_jerk_max_mps3(view: Comparison) -> float | None:
    """Return the largest such third difference [m/s^3]."""
    return max_or_none(view.once(_counted_jerks))


def _counted_jerks(view: Comparison) -> Float[np.ndarray, "J B"]:
    return body_jerks(view.kinematics, view.clip.fps)[view.first :]


def object_path_error_m(view: Comparison) -> float | None:
    """Return the mean distance [m] of the two sides' object translations, each relative to its first counted frame."""
    distances = [
        norms((robot.positions - robot.positions[:1]) - (human.positions - human.positions[:1]))
        for robot, human in zip(view.robot_objects, view.human_objects, strict=True)
    ]
    return mean_or_none(np.array(distances))


LINK_VELOCITY_DIRECTION = Figure(
    "link_velocity_direction_deg",
    "velocity direction",
    "deg",
    1.0,
    1,
    "lower",
    link_velocity_direction_deg,
    in_paper=True,
)
BODY_JERK = Figure("body_jerk_mps3", "jerk", "m/s^3", 1.0, 1, "lower", body_jerk_mps3, in_paper=True)
BODY_JERK_MAX = Figure("body_jerk_max_mps3", "jerk max", "m/s^3", 1.0, 0, "lower", body_jerk_max_mps3)
OBJECT_PATH_ERROR = Figure(
    "object_path_error_m", "object path", "cm", 1e2, 1, "lower", object_path_error_m, in_paper=True
)
