"""How high every link's skin is above the floor."""

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import skin_of


def link_heights(kinematics: Kinematics, first: int = 0) -> Float[np.ndarray, "L F"]:
    """Return the height of the lowest skin point of each link of the skin [m], from one frame on."""
    heights = []
    for skin in skin_of(kinematics.model).links:
        up = kinematics.orientation(skin.frame)[2, :, first:]
        heights.append((skin.extreme_points @ up).min(axis=0) + kinematics.point(skin.frame)[2, first:])
    return np.reshape(heights, (-1, len(kinematics.qpos) - first))
