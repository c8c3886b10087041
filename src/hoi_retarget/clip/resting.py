"""Objects that rest on the floor: all of them is still, nobody touches them, and no other object is below them.

Nobody says what an object stands on. What rests within a hand's breadth of the floor stands on that, unless another
object reaches deeper there. In 45 recordings resting furniture and boxes are within 5 mm of the floor, but for two
desks (22 mm). A hull of sample points may end up to
37 mm above the object's lowest, which no file tells; sample points without any surface are no witnesses.
"""

import numpy as np
from jaxtyping import Bool

from hoi_retarget.clip.clip import Clip
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import speeds
from hoi_retarget.objects.track import ObjectTrack

STILL_SPEED = 0.05
"""[m/s]; the corners of what rests are slower. Recorded ones tremble by a millimetre."""
SHORTEST_SECONDS = 0.15
"""What rests shorter than this turns round."""
FLOOR_REACH = 0.10
"""[m]; what rests higher than this stands on something that is not recorded."""
DEEPER, GAP = 0.005, 0.02
"""[m]; an object below another one reaches this much deeper, and up to this much below it."""


def floor_rests(clip: Clip) -> Bool[np.ndarray, "O T"]:
    """Return when each object of a clip, if its surface is known, rests on the floor, which is near z = 0."""
    rests = np.zeros((len(clip.objects), clip.frames), dtype=bool)
    shortest = max(2, round(SHORTEST_SECONDS * clip.fps))
    for index, track in enumerate(clip.objects):
        if not track.geometry.has_surface:
            continue
        touched = [contact.active for contact in clip.contacts if contact.object == index]
        still = (speeds(track.corners, clip.fps) < STILL_SPEED).all(axis=1) & ~np.any(touched, axis=0)
        for first, stop in runs(still, shortest):
            rests[index, first:stop] = _is_on_floor(clip, index, (first + stop) // 2)
    return rests


def _is_on_floor(clip: Clip, index: int, frame: int) -> bool:
    track = clip.objects[index].at(frame)
    others = [other.at(frame) for place, other in enumerate(clip.objects) if place != index]
    return bool(track.lowest[0] < FLOOR_REACH) and not any(_carries(other, track) for other in others)


def _carries(below: ObjectTrack, above: ObjectTrack) -> bool:
    """Return whether one object may lie on or in another, which reaches deeper and is under its middle."""
    (own,), (box,) = above.corners, below.corners
    bottom, middle = float(above.lowest[0]), own.mean(axis=0)[:2]
    under = (box.min(axis=0)[:2] <= middle).all() and (middle <= box.max(axis=0)[:2]).all()
    return bool(under and below.lowest[0] < bottom - DEEPER and box[:, 2].max() > bottom - GAP)
