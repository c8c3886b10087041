"""Rotations from the T-pose, for skeletons with a rest pose and bone axes of their own, and a check of such rotations.

`skeleton` counts a joint's rotation from the T-pose that stands along +y and looks along +z. A rig counts it from its
rest pose, in any frame. Where the limbs of the rest pose are near those of a T-pose, even with hanging arms, the
shortest rotations between them are the difference.
"""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ClipError
from hoi_retarget.human.skeleton import HEIGHT_OVER_CHAIN, JOINT_INDEX, JOINTS, LEFT_FINGERS, RIGHT_FINGERS
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen

LIMBS: Mapping[str, tuple[str, tuple[float, float, float]]] = MappingProxyType(
    {
        f"{side}_{joint}": (f"{side}_{end}", axis)
        for side, outward in (("left", (1.0, 0.0, 0.0)), ("right", (-1.0, 0.0, 0.0)))
        for joint, end, axis in (
            ("hip", "knee", (0.0, -1.0, 0.0)),
            ("knee", "ankle", (0.0, -1.0, 0.0)),
            ("shoulder", "elbow", outward),
            ("elbow", "wrist", outward),
        )
    }
)
"""Joint -> the end of its bone, and the direction of that in the T-pose."""


def body_axes(positions: Float[np.ndarray, "J 3"]) -> Float[np.ndarray, "4"]:
    """Return the rotation (quaternion, wxyz) from a body that stands along +y and looks along +z to a rest pose.

    Frames of exporters differ by quarter turns, so it is the nearest of these. `positions` are those of
    `skeleton.JOINTS`, perhaps without fingers; raises `ClipError` unless someone stands there upright.
    """
    place = {joint: positions[JOINT_INDEX[joint]] for joint in JOINTS[: len(positions)]}
    up = place["head"] - 0.5 * (place["left_hip"] + place["right_hip"])
    left = place["left_hip"] - place["right_hip"] + place["left_shoulder"] - place["right_shoulder"]
    axes = np.zeros((3, 3))
    for column, direction in ((1, up), (0, left)):
        largest = int(np.abs(direction).argmax())
        axes[largest, column] = np.sign(direction[largest])
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    if np.abs(np.linalg.det(axes)) < 0.5:
        raise ClipError("in the skeleton's rest pose nobody stands upright with the left side beside the right")
    return se3.matrix_to_quat(axes)


def turns_from_t_pose(
    positions: Float[np.ndarray, "J 3"], quats: Float[np.ndarray, "J 4"], body: Float[np.ndarray, "4"], farthest: float
) -> tuple[Float[np.ndarray, "J 4"], float]:
    """Return the turn of each bone, in its own frame, that gives its joint's rotation from the T-pose, wxyz.

    Beside it, the largest angle between the rest pose's limbs and those of the T-pose [deg]; raises `ClipError` where
    that is larger than `farthest`.

    `positions`: of the joints in the rest pose, in the order of `skeleton.JOINTS`, perhaps without fingers; `quats`: of
    the same, wxyz; `body`: their `body_axes`; `farthest`: the largest angle allowed between the limbs and those of a
    T-pose [deg].
    """
    standing = se3.rotate_inverse(body, positions)
    swings = np.tile(se3.IDENTITY_QUAT, (len(positions), 1))
    for joint, (end, axis) in LIMBS.items():
        bone = standing[JOINT_INDEX[end]] - standing[JOINT_INDEX[joint]]
        swings[JOINT_INDEX[joint]] = se3.shortest_rotation(np.array(axis), bone)
    angles = np.rad2deg(se3.angle_between(swings, se3.IDENTITY_QUAT))
    largest = float(angles.max())
    if largest > farthest:
        raise ClipError(
            f"the skeleton's rest pose is no T-pose: its {JOINTS[int(angles.argmax())]} is {largest:.0f} deg away from "
            "one"
        )
    for side, fingers in (("left", LEFT_FINGERS), ("right", RIGHT_FINGERS)):
        # In a rest pose hands are straight: they go with the forearms.
        for joint in (f"{side}_wrist", *fingers):
            if JOINT_INDEX[joint] < len(positions):
                swings[JOINT_INDEX[joint]] = swings[JOINT_INDEX[f"{side}_elbow"]]
    return se3.quat_multiply(se3.quat_conjugate(quats), se3.quat_multiply(body, swings)), largest


MIN_T_POSE_AGREEMENT = 0.75
"""A cosine; in 36 recordings, limbs are within 22 degrees of the T-pose's axes in their parents' frames (0.93)."""


def agreement(positions: Float[np.ndarray, "T 52 3"], quats: Float[np.ndarray, "T 52 4"]) -> float:
    """Return the least cosine [unitless] between thighs or upper arms and the T-pose's axes, in their own frames."""
    cosines = []
    for joint, (end, axis) in LIMBS.items():
        if not joint.endswith(("hip", "shoulder")):
            continue
        index, parent = JOINT_INDEX[end], JOINT_INDEX[joint]
        bones = se3.rotate_inverse(quats[:, parent], positions[:, index] - positions[:, parent])
        lengths = np.maximum(np.linalg.norm(bones, axis=1), 1e-9)
        cosines.append(float(np.median(bones @ np.array(axis) / lengths)))
    return min(cosines)


# Offsets from the parent joint as fractions of the standing height; the right side mirrors x.
_LEFT_AND_MIDDLE: dict[str, tuple[float, float, float]] = {
    "left_hip": (0.036, -0.052, -0.009),
    "left_knee": (0.0, -0.221, 0.0),
    "left_ankle": (0.0, -0.234, 0.0),
    "left_foot": (0.008, -0.033, 0.077),
    "spine1": (0.0, 0.066, -0.012),
    "spine2": (0.0, 0.088, 0.0),
    "spine3": (0.0, 0.033, 0.008),
    "neck": (0.0, 0.102, -0.004),
    "head": (0.0, 0.086, 0.008),
    "left_collar": (0.026, 0.052, -0.006),
    "left_shoulder": (0.071, 0.034, -0.008),
    "left_elbow": (0.152, 0.0, 0.0),
    "left_wrist": (0.148, 0.0, 0.0),
    "left_index1": (0.066, 0.001, 0.0125),
    "left_index2": (0.0190, 0.0, 0.0),
    "left_index3": (0.0135, 0.0, 0.0),
    "left_middle1": (0.067, 0.001, 0.0),
    "left_middle2": (0.0190, 0.0, 0.0),
    "left_middle3": (0.0150, 0.0, 0.0),
    "left_ring1": (0.062, 0.0, -0.011),
    "left_ring2": (0.0175, 0.0, 0.0),
    "left_ring3": (0.0140, 0.0, 0.0),
    "left_pinky1": (0.056, -0.001, -0.021),
    "left_pinky2": (0.0130, 0.0, -0.001),
    "left_pinky3": (0.0105, 0.0, -0.001),
    "left_thumb1": (0.024, -0.008, 0.014),
    "left_thumb2": (0.0140, -0.005, 0.012),
    "left_thumb3": (0.0130, -0.002, 0.007),
}
_MIRROR = np.array([-1.0, 1.0, 1.0])


@cache
def rest_offsets(height: float) -> Float[np.ndarray, "52 3"]:
    """Return each joint's offset from its parent in the rest pose [m] for a standing height [m]."""
    offsets = np.zeros((len(JOINTS), 3))
    for name, offset in _LEFT_AND_MIDDLE.items():
        offsets[JOINT_INDEX[name]] = offset
        if name.startswith("left_"):
            offsets[JOINT_INDEX[name.replace("left_", "right_")]] = _MIRROR * offset
    spine = sum(offsets[JOINT_INDEX[name]] for name in ("spine1", "spine2", "spine3", "neck", "head"))
    leg = sum(np.linalg.norm(offsets[JOINT_INDEX[name]]) for name in ("left_knee", "left_ankle"))
    # Fractions are rounded; this makes the height estimated from the skeleton the one asked for.
    exact = 1.0 / (HEIGHT_OVER_CHAIN * (leg + np.linalg.norm(spine)))
    return frozen(offsets * (height * exact))
