"""Whether joint rotations are counted from the T-pose, as `skeleton` says."""

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.skeleton import JOINT_INDEX, PARENT
from hoi_retarget.numerics import se3

LEAST_AGREEMENT = 0.75
"""A cosine; in 36 recordings, limbs are within 22 degrees of the T-pose's axes in their parents' frames (0.93)."""

_LIMBS: dict[str, tuple[float, float, float]] = {
    "left_knee": (0.0, -1.0, 0.0),
    "right_knee": (0.0, -1.0, 0.0),
    "left_elbow": (1.0, 0.0, 0.0),
    "right_elbow": (-1.0, 0.0, 0.0),
}
"""Which way each joint lies from its parent in the T-pose."""


def agreement(positions: Float[np.ndarray, "T 52 3"], quats: Float[np.ndarray, "T 52 4"]) -> float:
    """Return how well thighs and upper arms lie along the T-pose's axes in their own frames: 1 exactly, -1 opposite."""
    cosines = []
    for joint, axis in _LIMBS.items():
        index, parent = JOINT_INDEX[joint], JOINT_INDEX[str(PARENT[joint])]
        bones = se3.rotate_inverse(quats[:, parent], positions[:, index] - positions[:, parent])
        lengths = np.maximum(np.linalg.norm(bones, axis=1), 1e-9)
        cosines.append(float(np.median(bones @ np.array(axis) / lengths)))
    return min(cosines)
