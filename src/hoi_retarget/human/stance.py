"""Stance from geometry."""

import numpy as np
from jaxtyping import Bool

from hoi_retarget.human.person import Person
from hoi_retarget.numerics.filters import speeds

STANCE_HEIGHT = 0.10  # [m] of the toe joint
STANCE_HEIGHT_OVER_LOWEST = 0.04  # [m] over that toe's own lowest height
STANCE_SPEED = 0.30  # [m/s]
LARGEST_DIFFERENCE = 0.05  # [m] between the lowest heights of two feet that both stand in a clip


def stance(person: Person, fps: float) -> Bool[np.ndarray, "T 2"]:
    """Return when the left and the right foot stand: toe joint low and slow.

    The thresholds are those of the authors' public release.
    """
    flags = []
    toes = [person.position(joint) for joint in ("left_foot", "right_foot")]
    floor = min(float(toe[:, 2].min()) for toe in toes)
    for toe in toes:
        speed = speeds(toe, fps)
        # A foot that is held up all the time has a lowest height, too, but does not stand there.
        lowest = min(float(toe[:, 2].min()), floor + LARGEST_DIFFERENCE)
        limit = max(STANCE_HEIGHT, lowest + STANCE_HEIGHT_OVER_LOWEST)
        flags.append((toe[:, 2] < limit) & (speed < STANCE_SPEED))
    return np.stack(flags, axis=1)
