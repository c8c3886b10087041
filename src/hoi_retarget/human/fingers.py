"""Straight fingers for people whose recording has none."""

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.skeleton import JOINT_INDEX, LEFT_FINGERS, RIGHT_FINGERS
from hoi_retarget.numerics import se3

NOTE = "The clip has no fingers; they are straight, of a length that follows the forearm's."

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
