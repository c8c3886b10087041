"""Contact and stance from geometry."""

import numpy as np
from jaxtyping import Bool

from hoi_retarget.clip import Person

STANCE_HEIGHT = 0.10  # [m] of the toe joint
STANCE_HEIGHT_OVER_LOWEST = 0.04  # [m] over that toe's own lowest height
STANCE_SPEED = 0.30  # [m/s]


def stance(person: Person, fps: float) -> Bool[np.ndarray, "T 2"]:
    """Return when the left and the right foot stand: toe joint low and slow.

    The thresholds are those of the authors' public release.
    """
    flags = []
    for joint in ("left_foot", "right_foot"):
        toe = person.position(joint)
        speed = np.linalg.norm(np.gradient(toe, axis=0), axis=1) * fps
        limit = max(STANCE_HEIGHT, float(toe[:, 2].min()) + STANCE_HEIGHT_OVER_LOWEST)
        flags.append((toe[:, 2] < limit) & (speed < STANCE_SPEED))
    return np.stack(flags, axis=1)
