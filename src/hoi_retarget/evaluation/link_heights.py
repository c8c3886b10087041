"""How high every link's skin is above the floor."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin, skin_of


def link_heights(kinematics: Kinematics, first: int = 0) -> Float[np.ndarray, "L F"]:
    """Return the height of the lowest skin point of each link of the skin [m], from one frame on."""
    heights = []
    for skin in skin_of(kinematics.model).links:
        up = kinematics.orientation(skin.frame)[2, :, first:]
        heights.append((_extreme_points(skin) @ up).min(axis=0) + kinematics.point(skin.frame)[2, first:])
    return np.reshape(heights, (-1, len(kinematics.qpos) - first))


@lru_cache(maxsize=256)
def _extreme_points(skin: LinkSkin) -> Float[np.ndarray, "H 3"]:
    """Return the points among which the lowest one is, however the link turns."""
    try:
        return skin.points[ConvexHull(skin.points).vertices]
    except (QhullError, ValueError):  # Few points, or all in one plane.
        return skin.points
