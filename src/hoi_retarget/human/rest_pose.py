"""The T-pose of a person of typical proportions, those of an adult, which scale with the standing height."""

from functools import cache

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.skeleton import HEIGHT_OVER_CHAIN, JOINT_INDEX, JOINTS
from hoi_retarget.numerics.arrays import frozen

# Offsets from the parent joint as fractions of the standing height; the right side mirrors x.
_LEFT_AND_MIDDLE: dict[str, tuple[float, float, float]] = {
    "left_hip": (0.036, -0.052, -0.009),
    "left_knee": (0.0, -0.221, 0.0),
    "left_ankle": (0.0, -0.234, 0.0),
    "left_foot": (0.008, -0.033, 0.077),
    "spine1": (0.0, 0.066, -0.012),
    "spine2": (0.0, 0.088, 0.0),
    "spine3": (0.0, 0.033, 0.008),
    "neck": (0.0, 0.102, -0.004),
    "head": (0.0, 0.086, 0.008),
    "left_collar": (0.026, 0.052, -0.006),
    "left_shoulder": (0.071, 0.034, -0.008),
    "left_elbow": (0.152, 0.0, 0.0),
    "left_wrist": (0.148, 0.0, 0.0),
    "left_index1": (0.066, 0.001, 0.0125),
    "left_index2": (0.0190, 0.0, 0.0),
    "left_index3": (0.0135, 0.0, 0.0),
    "left_middle1": (0.067, 0.001, 0.0),
    "left_middle2": (0.0190, 0.0, 0.0),
    "left_middle3": (0.0150, 0.0, 0.0),
    "left_ring1": (0.062, 0.0, -0.011),
    "left_ring2": (0.0175, 0.0, 0.0),
    "left_ring3": (0.0140, 0.0, 0.0),
    "left_pinky1": (0.056, -0.001, -0.021),
    "left_pinky2": (0.0130, 0.0, -0.001),
    "left_pinky3": (0.0105, 0.0, -0.001),
    "left_thumb1": (0.024, -0.008, 0.014),
    "left_thumb2": (0.0140, -0.005, 0.012),
    "left_thumb3": (0.0130, -0.002, 0.007),
}
_MIRROR = np.array([-1.0, 1.0, 1.0])


@cache
def rest_offsets(height: float) -> Float[np.ndarray, "52 3"]:
    """Return each joint's offset from its parent in the rest pose [m] for a standing height [m]."""
    offsets = np.zeros((len(JOINTS), 3))
    for name, offset in _LEFT_AND_MIDDLE.items():
        offsets[JOINT_INDEX[name]] = offset
        if name.startswith("left_"):
            offsets[JOINT_INDEX[name.replace("left_", "right_")]] = _MIRROR * offset
    spine = sum(offsets[JOINT_INDEX[name]] for name in ("spine1", "spine2", "spine3", "neck", "head"))
    leg = sum(np.linalg.norm(offsets[JOINT_INDEX[name]]) for name in ("left_knee", "left_ankle"))
    # Fractions are rounded; this makes the height estimated from the skeleton the one asked for.
    exact = 1.0 / (HEIGHT_OVER_CHAIN * (leg + np.linalg.norm(spine)))
    return frozen(offsets * (height * exact))
