"""Who may move an object: somebody whose body is beside it, or somebody beside another object that it rides on."""

from itertools import product

import numpy as np
from jaxtyping import Bool

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.label_contacts import FAR, body_distances
from hoi_retarget.numerics.filters import speeds
from hoi_retarget.objects.track import MOVING_SPEED, ObjectTrack

RIDING_SHARE = 0.5
"""What rides on something moves against it with less than this share of its own speed."""


def is_moving(track: ObjectTrack, fps: float) -> Bool[np.ndarray, "T"]:
    """Return when the middle of an object's box moves."""
    return speeds(track.corners.mean(axis=1), fps) > MOVING_SPEED


def carried(clip: Clip) -> Bool[np.ndarray, "O T"]:
    """Return when any part of anybody's body is within `FAR` of each object, or of another that it rides on.

    Raises:
        GeometryError: an object's mesh cannot be read.
    """
    found = np.stack([body_distances(clip, index) <= FAR for index in range(len(clip.objects))])
    pairs = [(i, j) for i, j in product(range(len(found)), repeat=2) if i != j]
    rides = {(i, j): _rides(clip.objects[i], clip.objects[j], clip.fps) for i, j in pairs}
    for _ in clip.objects:  # What rides on what rides.
        for (rider, carrier), flags in rides.items():
            found[rider] |= flags & found[carrier]
    return found


def _rides(rider: ObjectTrack, carrier: ObjectTrack, fps: float) -> Bool[np.ndarray, "T"]:
    """Return when an object is at another one and moves as this does."""
    corners, others = rider.corners, carrier.corners
    path = corners.mean(axis=1)
    along = speeds(carrier.to_object(path), fps) < np.maximum(MOVING_SPEED, RIDING_SHARE * speeds(path, fps))
    above, below = corners.min(axis=1) <= others.max(axis=1) + FAR, others.min(axis=1) <= corners.max(axis=1) + FAR
    return along & (above & below).all(axis=1)
