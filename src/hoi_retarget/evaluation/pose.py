"""Do the robot's limbs point where the human's do? 16 bones, eight a side."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.evaluation.statistics import direction_angles_deg, mean_or_none
from hoi_retarget.evaluation.view import Comparison
from hoi_retarget.numerics import se3
from hoi_retarget.robots.spec import SIDES

# Turns a human joint's axes (x left, y up, z ahead) into a robot link's (x ahead, y left, z up), on the right.
HUMAN_TO_ROBOT_AXES = se3.quat_to_matrix(np.array([0.5, -0.5, -0.5, -0.5]))

PALM = "palm"
"""Stands for the contact point of a hand, which is no joint."""


@dataclass(frozen=True)
class Chain:
    """Bones between neighbouring points, all seen in the frame of the first point.

    `{side}` in a name is replaced by left and right.
    """

    robot_sites: tuple[str, ...]
    human_joints: tuple[str, ...]


LEG = Chain(
    ("pelvis", "{side}_hip", "{side}_knee", "{side}_foot", "{side}_toe"),
    ("pelvis", "{side}_hip", "{side}_knee", "{side}_ankle", "{side}_foot"),
)
ARM = Chain(
    ("torso", "{side}_shoulder", "{side}_elbow", "{side}_wrist", "{side}_palm"),
    ("spine3", "{side}_shoulder", "{side}_elbow", "{side}_wrist", PALM),
)


def body_pose_deviation_deg(view: Comparison) -> float | None:
    """Return the mean angle [deg] between the two sides' bone directions, over 16 bones and frames.

    Over the 8 of the arms alone where a base carries the robot.
    """
    chains = (LEG, ARM) if view.kinematics.model.spec.base == "legs" else (ARM,)
    angles = [direction_angles_deg(_robot_bones(view, chain), _human_bones(view, chain)) for chain in chains]
    return mean_or_none(np.stack(angles))


def _robot_bones(view: Comparison, chain: Chain) -> Float[np.ndarray, "F 8 3"]:
    points = [[view.robot_point(name.format(side=side)) for name in chain.robot_sites] for side in SIDES]
    return _bones_inside(view.robot_rotation(chain.robot_sites[0]), points)


def _human_bones(view: Comparison, chain: Chain) -> Float[np.ndarray, "F 8 3"]:
    points = [
        [
            view.human_part_point(f"{side}_hand") if name == PALM else view.human_point(name.format(side=side))
            for name in chain.human_joints
        ]
        for side in SIDES
    ]
    return _bones_inside(view.human_rotation(chain.human_joints[0]) @ HUMAN_TO_ROBOT_AXES, points)


def _bones_inside(
    frame: Float[np.ndarray, "F 3 3"], points: list[list[Float[np.ndarray, "F 3"]]]
) -> Float[np.ndarray, "F 8 3"]:
    """Return the bones of two chains of five points each, along the axes of `frame` [m]."""
    bones = np.diff(np.array(points), axis=1)
    return bones.reshape(8, -1, 3).transpose(1, 0, 2) @ frame


BODY_POSE_DEVIATION = Figure(
    "body_pose_deviation_deg", "pose", "deg", 1.0, 1, "lower", body_pose_deviation_deg, in_paper=True
)
