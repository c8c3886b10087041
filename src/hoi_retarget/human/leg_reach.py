"""Legs of a person that reach for given places of the ankles: two bones, the knee bent towards a pole.

Arrays are of all joints of `skeleton.JOINTS`; legs are named by the index of their ankle.
"""

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT
from hoi_retarget.numerics import se3

PARENTS = [JOINT_INDEX[PARENT[joint] or joint] for joint in JOINTS]  # Of all joints; the pelvis has itself.
ANKLES = tuple(JOINT_INDEX[f"{side}_ankle"] for side in ("left", "right"))


def leg_lengths(ankle: int, offsets: Float[np.ndarray, "52 3"]) -> tuple[float, float]:
    """Return the lengths of thigh and shin [m]."""
    return float(np.linalg.norm(offsets[PARENTS[ankle]])), float(np.linalg.norm(offsets[ankle]))


def lower_to_reach(
    pelvis: Float[np.ndarray, "T 3"],
    quats: Float[np.ndarray, "T 4"],
    ankles: dict[int, tuple[np.ndarray, np.ndarray]],
    offsets: Float[np.ndarray, "52 3"],
) -> None:
    """Lower a pelvis in place where a leg would not reach its ankle."""
    for ankle, (place, _) in ankles.items():
        hip = se3.rotate(quats, offsets[PARENTS[PARENTS[ankle]]])
        across = np.linalg.norm((pelvis + hip - place)[:, :2], axis=1)
        reach = np.sqrt(np.maximum(sum(leg_lengths(ankle, offsets)) ** 2 - across**2, 0.0))
        pelvis[:, 2] = np.minimum(pelvis[:, 2], place[:, 2] - hip[:, 2] + reach)


def knee_side(places: Float[np.ndarray, "52 3"], ankle: int, forward: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Return the way in which a knee is off the line from hip to ankle; forwards where it is straight."""
    knee = PARENTS[ankle]
    hip = PARENTS[knee]
    line = (places[ankle] - places[hip]) / np.linalg.norm(places[ankle] - places[hip])
    off = places[knee] - places[hip]
    off = off - (off @ line) * line
    return off / np.linalg.norm(off) if np.linalg.norm(off) > 0.01 else forward


def bend_leg(  # noqa: PLR0913 - the arrays of one pose, changed in place
    ankle: int,
    positions: Float[np.ndarray, "T 52 3"],
    quats: Float[np.ndarray, "T 52 4"],
    *,
    turned: Float[np.ndarray, "T 52 4"],
    offsets: Float[np.ndarray, "52 3"],
    goal: Float[np.ndarray, "T 3"],
    pole: Float[np.ndarray, "T 3"],
) -> None:
    """Put an ankle at its goal in place, the knee bent towards a pole.

    Args: `ankle`: index of the joint; `positions`: of all joints in the world [m]; those of the leg change; `quats`:
    likewise, rotations; `turned`: rotations in the parents; `offsets`: of the joints in their parents [m]; `goal`: the
    ankle's places; `pole`: directions.
    """
    knee = PARENTS[ankle]
    hip = PARENTS[knee]
    thigh, shin = leg_lengths(ankle, offsets)
    line = goal - positions[:, hip]
    length = np.clip(np.linalg.norm(line, axis=1), abs(thigh - shin) + 1e-9, thigh + shin)[:, None]
    line /= np.linalg.norm(line, axis=1)[:, None]
    along = (thigh**2 - shin**2 + length**2) / (2.0 * length)
    pole = pole - (pole * line).sum(axis=1)[:, None] * line
    pole /= np.maximum(np.linalg.norm(pole, axis=1)[:, None], 1e-9)
    positions[:, knee] = positions[:, hip] + along * line + np.sqrt(np.maximum(thigh**2 - along**2, 0.0)) * pole
    positions[:, ankle] = positions[:, hip] + length * line
    for joint, end in ((hip, knee), (knee, ankle)):
        if joint == knee:
            quats[:, knee] = se3.quat_multiply(quats[:, hip], turned[:, knee])
        quats[:, joint] = _pointing(quats[:, joint], offsets[end], positions[:, end] - positions[:, joint])


def _pointing(
    quats: Float[np.ndarray, "T 4"], offset: Float[np.ndarray, "3"], way: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 4"]:
    """Return rotations turned no more than needed for a bone to go a given way."""
    bone = se3.rotate(quats, offset)
    axis = np.cross(bone, way)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine, (bone * way).sum(axis=1, keepdims=True))
    return se3.quat_multiply(se3.exp(axis / np.maximum(sine, 1e-12) * angle), quats)
