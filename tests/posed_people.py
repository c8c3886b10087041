"""People in other postures than standing, posed by hand, with nothing in their hands."""

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT, world_positions, world_quats
from hoi_retarget.human.t_pose import rest_offsets
from hoi_retarget.numerics import se3

FRAMES, FPS = 60, 30.0
_PARENTS = [-1 if PARENT[joint] is None else JOINT_INDEX[str(PARENT[joint])] for joint in JOINTS]
_UPRIGHT = se3.exp(np.array([np.pi / 2, 0.0, 0.0]))  # y up to z up

_ARMS = {"left_shoulder": (0.0, 0.0, -70.0), "right_shoulder": (0.0, 0.0, 70.0)}
"""Hanging down."""

POSTURES: dict[str, tuple[tuple[float, float, float], dict[str, tuple[float, float, float]]]] = {
    "standing": ((0.0, 0.0, 0.0), {}),
    "cross-legged": (
        (-30.0, 0.0, 0.0),
        {
            "left_hip": (-80.0, 45.0, 50.0),
            "right_hip": (-80.0, -45.0, -50.0),
            "left_knee": (130.0, 0.0, 0.0),
            "right_knee": (130.0, 0.0, 0.0),
            "spine1": (20.0, 0.0, 0.0),
            "spine2": (20.0, 0.0, 0.0),
            "spine3": (10.0, 0.0, 0.0),
        },
    ),
    "legs stretched": ((-10.0, 0.0, 0.0), {"left_hip": (-85.0, 0.0, 0.0), "right_hip": (-85.0, 0.0, 0.0)}),
    "kneeling": ((0.0, 0.0, 0.0), {"left_knee": (100.0, 0.0, 0.0), "right_knee": (100.0, 0.0, 0.0)}),
    "on the back": ((-90.0, 0.0, 0.0), {}),
    "on the front": ((90.0, 0.0, 0.0), {}),
    "on the side": ((0.0, 0.0, 90.0), {}),
}
"""Rotation of the whole body, and of joints in their parents, as rotation vectors [deg]; x left, y up, z ahead."""


def posed(posture: str, *, heading: float = 0.0, height: float = 1.75) -> Clip:
    """A person in one posture whose arms move slowly, resting on the floor, turned about the vertical [rad]."""
    body, joints = POSTURES[posture]
    pose = np.zeros((FRAMES, len(JOINTS), 3))
    for joint, vector in {**_ARMS, **joints, "pelvis": body}.items():
        pose[:, JOINT_INDEX[joint]] = np.radians(vector)
    for elbow, sign in (("left_elbow", -1.0), ("right_elbow", 1.0)):
        pose[:, JOINT_INDEX[elbow], 1] = sign * (0.6 + 0.3 * np.sin(np.linspace(0.0, 2 * np.pi, FRAMES)))
    turn = se3.quat_multiply(se3.exp(np.array([0.0, 0.0, heading])), _UPRIGHT)
    pose[:, 0] = se3.log(se3.quat_multiply(turn, se3.exp(pose[:, 0])))
    quats = world_quats(pose, _PARENTS)
    offsets = rest_offsets(height)
    positions = world_positions(np.zeros((FRAMES, 3)), offsets, quats, _PARENTS)
    positions[..., 2] += 0.06 - positions[..., 2].min()
    return Clip(posture, FPS, (Person("person", positions, quats),), (), ())
