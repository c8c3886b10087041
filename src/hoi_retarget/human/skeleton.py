"""The human side's vocabulary: joint names, their tree, and the parts that can touch.

The joints are those of SMPL-X in its order, without jaw and eyes (52 of 55), which are
also the 52 of SMPL-H. A joint's world rotation follows SMPL-X: identity for all joints is
the T-pose that stands along +y and looks along +z. Beside the names there are forward
kinematics, straight fingers for recordings without any, and the trunk's frame.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3

_FINGERS = tuple(f"{finger}{bone}" for finger in ("index", "middle", "pinky", "ring", "thumb") for bone in (1, 2, 3))
LEFT_FINGERS = tuple(f"left_{name}" for name in _FINGERS)
RIGHT_FINGERS = tuple(f"right_{name}" for name in _FINGERS)

# (joint, parent) in SMPL-X order.
_BODY = (
    ("pelvis", None),
    ("left_hip", "pelvis"),
    ("right_hip", "pelvis"),
    ("spine1", "pelvis"),
    ("left_knee", "left_hip"),
    ("right_knee", "right_hip"),
    ("spine2", "spine1"),
    ("left_ankle", "left_knee"),
    ("right_ankle", "right_knee"),
    ("spine3", "spine2"),
    ("left_foot", "left_ankle"),
    ("right_foot", "right_ankle"),
    ("neck", "spine3"),
    ("left_collar", "spine3"),
    ("right_collar", "spine3"),
    ("head", "neck"),
    ("left_shoulder", "left_collar"),
    ("right_shoulder", "right_collar"),
    ("left_elbow", "left_shoulder"),
    ("right_elbow", "right_shoulder"),
    ("left_wrist", "left_elbow"),
    ("right_wrist", "right_elbow"),
)

JOINTS: tuple[str, ...] = (*(name for name, _ in _BODY), *LEFT_FINGERS, *RIGHT_FINGERS)
JOINT_INDEX: dict[str, int] = {name: index for index, name in enumerate(JOINTS)}


def _finger_parent(name: str) -> str:
    side, bone = name.split("_")
    return f"{side}_wrist" if bone.endswith("1") else f"{side}_{bone[:-1]}{int(bone[-1]) - 1}"


PARENT: dict[str, str | None] = {
    **dict(_BODY),
    **{name: _finger_parent(name) for name in (*LEFT_FINGERS, *RIGHT_FINGERS)},
}

LIMBS: tuple[tuple[str, str], ...] = (
    ("pelvis", "neck"),
    *(
        (f"{side}_{first}", f"{side}_{second}")
        for side in ("left", "right")
        for first, second in (
            ("hip", "knee"),
            ("knee", "ankle"),
            ("ankle", "foot"),
            ("shoulder", "elbow"),
            ("elbow", "wrist"),
        )
    ),
)
"""The body in eleven straight pieces, each from joint to joint."""

# Standing height over the length of the chain hip-knee + knee-ankle + pelvis-to-head joint:
# reproduces the stated heights of ten OMOMO subjects within 2.2 cm.
HEIGHT_OVER_CHAIN = 1.204


@dataclass(frozen=True)
class BodyPart:
    """A part of the body that can touch an object.

    The contact point is the mean of `point_joints`, its orientation that of `rotation_joint`;
    a source that labels joints labels the part in contact when any of `label_joints` is.
    """

    name: str
    point_joints: tuple[str, ...]
    rotation_joint: str
    label_joints: tuple[str, ...]


PARTS: dict[str, BodyPart] = {
    part.name: part
    for part in (
        BodyPart("left_hand", ("left_wrist", "left_middle3"), "left_wrist", LEFT_FINGERS),
        BodyPart("right_hand", ("right_wrist", "right_middle3"), "right_wrist", RIGHT_FINGERS),
        BodyPart("left_foot", ("left_ankle",), "left_ankle", ("left_ankle", "left_foot")),
        BodyPart("right_foot", ("right_ankle",), "right_ankle", ("right_ankle", "right_foot")),
    )
}
BODY_PARTS: dict[str, BodyPart] = {
    part.name: part
    for part in (
        BodyPart("pelvis", ("pelvis",), "pelvis", ("pelvis",)),
        *(
            BodyPart(f"{side}_{name}", (f"{side}_{joint}",), f"{side}_{joint}", (f"{side}_{joint}",))
            for name, joint in (("thigh", "hip"), ("forearm", "elbow"))
            for side in ("left", "right")
        ),
    )
}
"""The parts that can rest on an object, as of people who sit or lean; no source labels them."""
FINGERS = ("thumb", "index", "middle", "ring", "pinky")
FINGER_PARTS: dict[str, BodyPart] = {
    part.name: part
    for part in (
        BodyPart(f"{side}_{name}", (f"{side}_{name}3",), f"{side}_{name}3", (f"{side}_{name}3", f"{side}_{name}2"))
        for side in ("left", "right")
        for name in FINGERS
    )
}
"""Fingers, which touch with the last two of their three bones."""
ALL_PARTS: dict[str, BodyPart] = {**PARTS, **BODY_PARTS, **FINGER_PARTS}
HANDS = ("left_hand", "right_hand")
FEET = ("left_foot", "right_foot")


PARENTS: tuple[int, ...] = tuple(-1 if PARENT[joint] is None else JOINT_INDEX[str(PARENT[joint])] for joint in JOINTS)
"""Of the joints in the order of `JOINTS`; -1 for the root."""
BODY_PARENTS = PARENTS[:22]  # Of the joints of the body, in an order that is also SMPL-X's.


def world_quats(pose: Float[np.ndarray, "T J 3"], parents: Sequence[int]) -> Float[np.ndarray, "T J 4"]:
    """Return joint rotations in the world, wxyz, from rotation vectors to the parents [rad], root first."""
    local = se3.exp(pose)
    quats = np.empty_like(local)
    for joint, parent in enumerate(parents):
        quats[:, joint] = local[:, joint] if parent < 0 else se3.quat_multiply(quats[:, parent], local[:, joint])
    return quats


def world_positions(
    root: Float[np.ndarray, "T 3"],
    bones: Float[np.ndarray, "J 3"],
    quats: Float[np.ndarray, "T J 4"],
    parents: Sequence[int],
) -> Float[np.ndarray, "T J 3"]:
    """Return joint positions in the world [m] from those of the root, and rotations in the world, wxyz.

    `bones`: places in the parents' frames [m], the root's unused; `parents`: indices, -1 for the root, and smaller ones
    than the joint's own.
    """
    positions = np.empty((*quats.shape[:2], 3))
    for joint, parent in enumerate(parents):
        if parent < 0:
            positions[:, joint] = root
        else:
            positions[:, joint] = positions[:, parent] + se3.rotate(quats[:, parent], bones[joint][None])
    return positions


def bones_in_parents(
    positions: Float[np.ndarray, "T J 3"], quats: Float[np.ndarray, "T J 4"], parents: Sequence[int]
) -> Float[np.ndarray, "T J 3"]:
    """Return each joint's place in its parent's frame [m], the same in all frames of rigid bones; zero for the root."""
    bones = np.zeros_like(positions)
    children = [joint for joint, parent in enumerate(parents) if parent >= 0]
    above = [parents[joint] for joint in children]
    bones[:, children] = se3.rotate_inverse(quats[:, above], positions[:, children] - positions[:, above])
    return bones


def bone_deviations(bones: Float[np.ndarray, "T J 3"]) -> Float[np.ndarray, "T J"]:
    """Return the distance of each joint from its mean place in its parent's frame [m]."""
    return np.linalg.norm(bones - bones.mean(axis=0), axis=-1)


STRAIGHT_FINGERS = "The clip has no fingers; they are straight, of a length that follows the forearm's."

# Where straight fingers are in the left wrist's frame, in lengths of the forearm: x along the hand, z to the thumb.
_KNUCKLES = {"index": 0.10, "middle": 0.02, "ring": -0.05, "pinky": -0.12}
_ALONG = (0.38, 0.50, 0.59)
_THUMB = ((0.14, 0.0, 0.12), (0.24, 0.0, 0.20), (0.33, 0.0, 0.26))


def add_straight_fingers(positions: Float[np.ndarray, "T P 52 3"], quats: Float[np.ndarray, "T P 52 4"]) -> None:
    """Fill in the finger joints of arrays that have the body's: straight, turned as the wrist."""
    for side, sign in (("left", 1.0), ("right", -1.0)):
        wrist, elbow = JOINT_INDEX[f"{side}_wrist"], JOINT_INDEX[f"{side}_elbow"]
        bones = np.linalg.norm(positions[:, :, wrist] - positions[:, :, elbow], axis=-1)
        # The mean over time: a hand does not grow.
        length = bones.mean(axis=0)[:, None]
        for joint in LEFT_FINGERS if side == "left" else RIGHT_FINGERS:
            finger, bone = joint.removeprefix(f"{side}_")[:-1], int(joint[-1]) - 1
            place = _THUMB[bone] if finger == "thumb" else (_ALONG[bone], 0.0, _KNUCKLES[finger])
            offset = length * (np.array(place) * [sign, 1.0, 1.0])
            index = JOINT_INDEX[joint]
            positions[:, :, index] = positions[:, :, wrist] + se3.rotate(quats[:, :, wrist], offset[None])
            quats[:, :, index] = quats[:, :, wrist]


def trunk_rotations(position: Callable[[str], Float[np.ndarray, "T 3"]]) -> Float[np.ndarray, "T 3 3"]:
    """Return the frames with the z axis from the hips' middle to the shoulders', and the y axis to the left.

    `position` returns the place of `left_hip`, `right_shoulder` and so on in the world [m]. Unlike the rotations of
    pelvis and chest the frames do not tell how a trunk bends: robots have stiff ones.
    """
    left = position("left_hip") + position("left_shoulder")
    right = position("right_hip") + position("right_shoulder")
    up = position("left_shoulder") + position("right_shoulder") - position("left_hip") - position("right_hip")
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    ahead = np.cross(left - right, up)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    return np.stack([ahead, np.cross(up, ahead), up], axis=2)
