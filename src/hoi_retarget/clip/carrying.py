"""Who may move an object: somebody whose body is beside it, or somebody beside another object that it rides on."""

from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.label_contacts import FAR, body_distances
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import speeds
from hoi_retarget.objects.track import MOVING_SPEED, ObjectTrack

RIDING_SHARE = 0.5
"""What rides on something moves against it with less than this share of its own speed."""


def is_moving(track: ObjectTrack, fps: float) -> Bool[np.ndarray, "T"]:
    """Return when the middle of an object's box moves."""
    return speeds(_middle(track), fps) > MOVING_SPEED


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
    path = _middle(rider)
    against = speeds(carrier.to_object(path), fps)
    along = against < np.maximum(MOVING_SPEED, RIDING_SHARE * speeds(path, fps))
    (low, high), (other_low, other_high) = _extent(rider), _extent(carrier)
    return along & ((low <= other_high + FAR) & (other_low <= high + FAR)).all(axis=1)


def _middle(track: ObjectTrack) -> Float[np.ndarray, "T 3"]:
    return track.positions + se3.rotate(track.quats, 0.5 * _box(track).sum(axis=0))


def _extent(track: ObjectTrack) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 3"]]:
    """Return the least and the greatest coordinates of the corners of an object's box in the world."""
    corners = np.array(list(product(*_box(track).T)))
    world = track.positions[:, None] + se3.rotate(track.quats[:, None], corners)
    return world.min(axis=1), world.max(axis=1)


def _box(track: ObjectTrack) -> Float[np.ndarray, "2 3"]:
    """Return the least and the greatest coordinates of an object in its own frame."""
    return np.stack([track.geometry.points.min(axis=0), track.geometry.points.max(axis=0)])
