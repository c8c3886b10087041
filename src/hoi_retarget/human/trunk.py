"""The trunk as a whole, of a person or of a robot, by its hips and shoulders."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float


def trunk_rotations(position: Callable[[str], Float[np.ndarray, "T 3"]]) -> Float[np.ndarray, "T 3 3"]:
    """Return the frames whose z axis goes from the hips' middle to the shoulders', and whose y axis goes left.

    Unlike the rotations of pelvis and chest they do not tell how a trunk bends: robots have stiff ones.

    Args:
        position: Returns the places of `left_hip`, `right_shoulder` and so on in the world [m].
    """
    left = position("left_hip") + position("left_shoulder")
    right = position("right_hip") + position("right_shoulder")
    up = position("left_shoulder") + position("right_shoulder") - position("left_hip") - position("right_hip")
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    ahead = np.cross(left - right, up)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    return np.stack([ahead, np.cross(up, ahead), up], axis=2)
