"""A person in a robot's pose, by the robot's table of inverse kinematics read backwards."""

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.kinematics import PARENTS, world_positions
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.synthetic.human import rest_offsets

_TOE_HEIGHT = 0.0145
"""Of a standing person's toe joint, as a share of the stature."""


def person_in_pose(kinematics: Kinematics, aside: Float[np.ndarray, "3"]) -> Person:
    """Return a person of the robot's stature whose limbs are turned as the robot's are, on the floor.

    Args:
        kinematics: The robot's pose, or several.
        aside: From the robot's pelvis to the person's, of which the height does not count [m].
    """
    spec = kinematics.model.spec
    bones = rest_offsets(spec.stature)
    followed = {
        row.human_joint: se3.quat_multiply(
            se3.matrix_to_quat(kinematics.site_rotation(row.site)), se3.quat_conjugate(np.array(row.rotation_offset))
        )
        for row in spec.ik
    }
    quats = np.empty((len(kinematics.qpos), len(JOINTS), 4))
    for joint, index in JOINT_INDEX.items():
        # The pelvis comes first and is in every table; joints that are not go with their parents, the trunk as one.
        known = "spine3" if joint in {"spine1", "spine2"} else joint
        quats[:, index] = followed[known] if known in followed else quats[:, JOINT_INDEX[str(PARENT[joint])]]
    positions = world_positions(kinematics.site_position("pelvis") + aside, bones, quats, PARENTS)
    toes = positions[:, [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]], 2].min(axis=1)
    positions[..., 2] += (_TOE_HEIGHT * spec.stature - toes)[:, None]
    return Person("person", positions, quats)
