"""A posable human on the 52-joint skeleton: proportions, forward kinematics, two-bone limbs.

Proportions are fractions of the standing height, typical of adults. The rest pose is that of
SMPL-X: arms out, standing along +y, looking along +z, left is +x.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, LEFT_FINGERS, PARENT, RIGHT_FINGERS
from hoi_retarget.human.t_pose import rest_offsets
from hoi_retarget.numerics import se3

SIDES = ("left", "right")
Vectors = Float[np.ndarray, "T 3"]
Quats = Float[np.ndarray, "T 4"]
Scalars = Float[np.ndarray, "T"]

# Turns the rest pose (x left, y up, z forward) into the world (z up) looking along +x.
REST_TO_WORLD = np.array([0.5, 0.5, 0.5, 0.5])
ANKLE_HEIGHT = 0.0475
STANDING_PELVIS_HEIGHT = 0.546
MAXIMUM_REACH = 0.98
"""The largest distance from the root to the end of a limb, as a fraction of its length."""

# For each limb the rest directions of (first bone, normal of the limb's plane): the plane's
# normal is (root to end) x (root to middle joint), knees point forward and elbows backward.
_LIMB_REST = {
    "left_leg": ((0.0, -1.0, 0.0), (-1.0, 0.0, 0.0)),
    "right_leg": ((0.0, -1.0, 0.0), (-1.0, 0.0, 0.0)),
    "left_arm": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "right_arm": ((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
}
_HAND_REST = {"left": (1.0, 0.0, 0.0), "right": (-1.0, 0.0, 0.0)}
_PALM_REST = (0.0, -1.0, 0.0)


@dataclass(frozen=True, eq=False)
class HandGoal:
    """Where one hand should be: everything is one row a frame, in the world."""

    wrist: Vectors
    """Position of the wrist joint [m]."""
    quat: Quats
    """Rotation of the wrist joint."""
    elbow: Vectors
    """Direction into which the elbow points away from the line shoulder-wrist."""
    curl: Scalars
    """How far each finger joint is bent [rad]."""
    hold: Scalars
    """1 where the hand holds something, 0 where it is free."""


@dataclass(frozen=True, eq=False)
class FootGoal:
    """Where one foot should be: one row a frame, in the world."""

    ankle: Vectors
    """Position of the ankle joint [m]."""
    quat: Quats
    """Rotation of the ankle joint."""
    toe_quat: Quats
    """Rotation of the toe joint."""
    knee: Vectors
    """Direction into which the knee points away from the line hip-ankle."""


@dataclass(frozen=True, eq=False)
class Trunk:
    """Pose of pelvis, spine and head: one row a frame, in the world."""

    pelvis: Vectors
    """Position of the pelvis joint [m]."""
    pelvis_quat: Quats
    chest_quat: Quats
    head_quat: Quats


class Body:
    """The joints of one human over time, filled from the pelvis outwards."""

    def __init__(self, height: float, frames: int) -> None:
        self.offsets = rest_offsets(height)
        self.positions = np.zeros((frames, len(JOINTS), 3))
        self.quats = np.zeros((frames, len(JOINTS), 4))

    def offset(self, joint: str) -> Float[np.ndarray, "3"]:
        """Return a joint's offset from its parent at rest [m]."""
        return self.offsets[JOINT_INDEX[joint]]

    def position(self, joint: str) -> Vectors:
        """Return the world position of a joint that is already placed [m]."""
        return self.positions[:, JOINT_INDEX[joint]]

    def quat(self, joint: str) -> Quats:
        """Return the world rotation of a joint that is already placed."""
        return self.quats[:, JOINT_INDEX[joint]]

    def limb_length(self, middle: str, end: str) -> float:
        """Return the length of a straight two-bone limb [m]."""
        return float(np.linalg.norm(self.offset(middle)) + np.linalg.norm(self.offset(end)))

    def place(self, joint: str, quat: Quats) -> None:
        """Put a joint where its parent carries it, with the given world rotation."""
        parent = PARENT[joint]
        if parent is None:
            raise AssertionError("the pelvis has no parent: it is placed by set_trunk")
        self.positions[:, JOINT_INDEX[joint]] = self.position(parent) + se3.rotate(
            self.quat(parent), self.offset(joint)[None]
        )
        self.quats[:, JOINT_INDEX[joint]] = quat

    def set_trunk(self, trunk: Trunk) -> None:
        """Place pelvis, spine, head, collars, shoulders and hips."""
        self.positions[:, JOINT_INDEX["pelvis"]] = trunk.pelvis
        self.quats[:, JOINT_INDEX["pelvis"]] = trunk.pelvis_quat
        for joint, fraction in (("spine1", 1 / 3), ("spine2", 2 / 3), ("spine3", 1.0)):
            self.place(joint, se3.slerp(trunk.pelvis_quat, trunk.chest_quat, np.full(len(trunk.pelvis), fraction)))
        self.place("neck", se3.slerp(trunk.chest_quat, trunk.head_quat, np.full(len(trunk.pelvis), 0.5)))
        self.place("head", trunk.head_quat)
        for side in SIDES:
            self.place(f"{side}_collar", trunk.chest_quat)
            # The limbs' rotations are set later; positions are all that is needed until then.
            self.place(f"{side}_shoulder", trunk.chest_quat)
            self.place(f"{side}_hip", trunk.pelvis_quat)

    def set_foot(self, side: str, goal: FootGoal) -> None:
        """Place one leg so that the ankle is at its goal."""
        self._set_limb(f"{side}_leg", (f"{side}_hip", f"{side}_knee", f"{side}_ankle"), goal.ankle, goal.knee)
        self.place(f"{side}_ankle", goal.quat)
        self.place(f"{side}_foot", goal.toe_quat)

    def set_hand(self, side: str, goal: HandGoal) -> None:
        """Place one arm and its fingers so that the wrist is at its goal."""
        self._set_limb(f"{side}_arm", (f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist"), goal.wrist, goal.elbow)
        elbow = JOINT_INDEX[f"{side}_elbow"]
        # The forearm takes part of the hand's turn about its own axis, as radius and ulna do.
        axis = np.array(_HAND_REST[side])
        turn = _twist(se3.quat_multiply(se3.quat_conjugate(self.quats[:, elbow]), goal.quat), axis)
        self.quats[:, elbow] = se3.quat_multiply(self.quats[:, elbow], se3.exp(0.5 * turn[:, None] * axis))
        self.place(f"{side}_wrist", goal.quat)
        for joint in LEFT_FINGERS if side == "left" else RIGHT_FINGERS:
            self.place(joint, se3.quat_multiply(goal.quat, finger_quat(joint, goal.curl)))

    def person(self, name: str) -> Person:
        """Return the finished human."""
        return Person(name, self.positions, se3.quat_continuous(se3.quat_normalize(self.quats)))

    def _set_limb(self, limb: str, joints: tuple[str, str, str], goal: Vectors, pole: Vectors) -> None:
        root, middle, end = joints
        first, second = (float(np.linalg.norm(self.offset(joint))) for joint in (middle, end))
        line = goal - self.position(root)
        distance = np.linalg.norm(line, axis=1, keepdims=True)
        if (distance > MAXIMUM_REACH * (first + second) + 1e-9).any():
            worst = float(distance.max() / (first + second))
            raise AssertionError(f"{limb}: a goal lies at {worst:.3f} of the limb's length")
        along = line / distance
        across = _unit(pole - np.sum(pole * along, axis=1, keepdims=True) * along)
        cosine = (first**2 + distance**2 - second**2) / (2 * first * distance)
        sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
        upper = along * cosine + across * sine
        lower = _unit(line - first * upper)
        normal = np.cross(along, across)
        rest = frame_quat(*(np.array([axis]) for axis in _LIMB_REST[limb]))
        self.quats[:, JOINT_INDEX[root]] = se3.quat_multiply(frame_quat(upper, normal), se3.quat_conjugate(rest))
        self.place(middle, se3.quat_multiply(frame_quat(lower, normal), se3.quat_conjugate(rest)))


def finger_quat(joint: str, curl: Scalars) -> Quats:
    """Return a finger joint's rotation relative to the wrist when every joint bends by `curl` [rad]."""
    side, bone = joint.split("_")
    # Fingers bend towards the palm, which faces -y in the rest pose: about -z on the left hand.
    axis = np.array([0.0, 0.0, -1.0 if side == "left" else 1.0])
    bend = curl * int(bone[-1]) * (0.5 if bone.startswith("thumb") else 1.0)
    return se3.exp(bend[:, None] * axis)


def palm_offset(height: float, side: str, curl: Scalars) -> Vectors:
    """Return the hand's contact point in the wrist's frame [m]: midway between wrist and middle3."""
    offsets = rest_offsets(height)
    middle1, middle2, middle3 = (offsets[JOINT_INDEX[f"{side}_middle{bone}"]] for bone in (1, 2, 3))
    first = se3.rotate(finger_quat(f"{side}_middle1", curl), middle2[None])
    second = se3.rotate(finger_quat(f"{side}_middle2", curl), middle3[None])
    return 0.5 * (middle1 + first + second)


def hand_quat(side: str, fingers: Vectors, palm: Vectors) -> Quats:
    """Return the wrist rotation that points the fingers along `fingers` and turns the palm to `palm`."""
    rest = frame_quat(np.array([_HAND_REST[side]]), np.array([_PALM_REST]))
    return se3.quat_multiply(frame_quat(fingers, palm), se3.quat_conjugate(rest))


def heading_quat(yaw: Scalars, pitch: Scalars, roll: Scalars) -> Quats:
    """Return the rotation of an upright body part: yaw about up, forward pitch, roll to the right [rad]."""
    turn = se3.quat_multiply(se3.exp(yaw[:, None] * np.array([0.0, 0.0, 1.0])), REST_TO_WORLD[None])
    bent = se3.quat_multiply(turn, se3.exp(pitch[:, None] * np.array([1.0, 0.0, 0.0])))
    return se3.quat_multiply(bent, se3.exp(roll[:, None] * np.array([0.0, 0.0, 1.0])))


def frame_quat(first: Vectors, second: Vectors) -> Quats:
    """Return the rotation with the x axis along `first` and the y axis as near as possible to `second`."""
    x = _unit(first)
    y = _unit(second - np.sum(second * x, axis=-1, keepdims=True) * x)
    return se3.matrix_to_quat(np.stack([x, y, np.cross(x, y)], axis=-1))


def _unit(vectors: Vectors) -> Vectors:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _twist(quat: Quats, axis: Float[np.ndarray, "3"]) -> Scalars:
    """Return the angle [rad] in (-pi, pi) by which `quat` turns about `axis`."""
    swing = se3.rotate(quat, axis[None])
    # The shortest rotation that carries the axis along; what remains turns about the axis alone.
    shortest = se3.quat_normalize(
        np.concatenate([1.0 + np.sum(swing * axis, axis=1, keepdims=True), np.cross(axis, swing)], axis=1)
    )
    return np.sum(se3.log(se3.quat_multiply(se3.quat_conjugate(shortest), quat)) * axis, axis=1)
