"""Moments of a motion that a picture shows: when hands touch, and when the object leaves the floor and returns."""

from dataclasses import dataclass

import numpy as np

from hoi_retarget.motion.motion import Motion

_LIFTED = 0.02  # Above where it was touched first [m].


@dataclass(frozen=True)
class Moment:
    """A frame with what happens in it."""

    frame: int
    title: str


def contact_moments(motion: Motion) -> tuple[Moment, ...]:
    """Return first touch, lift, peak, set-down and release of the object that is touched longest.

    What is never lifted has its farthest frame from where it was; where nothing is touched, there are no moments.
    """
    touched = motion.contact_flags & (motion.contact_object >= 0)
    if not touched.any():
        return ()
    chosen = int(np.bincount(motion.contact_object[touched]).argmax())
    frames = np.flatnonzero((touched & (motion.contact_object == chosen)).any(axis=1))
    first, last = int(frames[0]), int(frames[-1])
    path = motion.object_pos[first : last + 1, chosen]
    lifted = np.flatnonzero(path[:, 2] - path[0, 2] > _LIFTED)
    moments = [Moment(first, "first touch")]
    if len(lifted):
        moments += [
            Moment(first + int(lifted[0]), "lift"),
            Moment(first + int(path[:, 2].argmax()), "peak"),
            Moment(first + int(lifted[-1]), "set down"),
        ]
    else:
        moments.append(Moment(first + int(np.linalg.norm(path - path[0], axis=1).argmax()), "farthest"))
    moments.append(Moment(last, "release"))
    by_frame = {moment.frame: moment for moment in reversed(moments)}  # Of two in one frame, the first.
    return tuple(by_frame[frame] for frame in sorted(by_frame))
