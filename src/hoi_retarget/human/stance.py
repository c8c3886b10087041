"""Stance from geometry."""

import numpy as np
from jaxtyping import Bool

from hoi_retarget.human.person import Person
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import speeds

STANCE_HEIGHT = 0.10  # [m] of the toe joint
STANCE_HEIGHT_OVER_LOWEST = 0.04  # [m] over that toe's own lowest height
STANCE_SPEED = 0.30  # [m/s]
LARGEST_TILT = np.radians(60.0)  # Standing feet have 35 degrees at most; those of people who sit or kneel lie over.
LARGEST_DIFFERENCE = 0.05  # [m] between the lowest heights of two feet that both stand in a clip


def stance(person: Person, fps: float) -> Bool[np.ndarray, "T 2"]:
    """Return when the left and the right foot stand: toe joint low and slow, the sole underneath.

    The thresholds of height and speed are those of the authors' public release.
    """
    flags = []
    joints = ("left_foot", "right_foot")
    toes = [person.position(joint) for joint in joints]
    floor = min(float(toe[:, 2].min()) for toe in toes)
    for joint, toe in zip(joints, toes, strict=True):
        speed = speeds(toe, fps)
        # A foot that is held up all the time has a lowest height, too, but does not stand there.
        lowest = min(float(toe[:, 2].min()), floor + LARGEST_DIFFERENCE)
        limit = max(STANCE_HEIGHT, lowest + STANCE_HEIGHT_OVER_LOWEST)
        upright = se3.quat_to_matrix(person.quat(joint))[:, 2, 1] > np.cos(LARGEST_TILT)
        flags.append((toe[:, 2] < limit) & (speed < STANCE_SPEED) & upright)
    return np.stack(flags, axis=1)
