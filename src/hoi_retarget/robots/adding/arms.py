"""Arms of a description beyond the shoulder: elbow, wrist and palm."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.robots.adding import kinematic_chains
from hoi_retarget.robots.adding.zero_pose import ZeroPose

_AMBIGUOUS = 0.6  # From this share of the shorter side of its range in the longer one, an elbow's flexion is ambiguous.
_MIN_TWIST_ALONG, _MAX_TWIST_OFFSET = 0.8, 0.35
"""A joint turns a forearm about its length when its axis points along it and passes near the hand's tip."""
_COS_BENT_WRIST = np.cos(np.radians(35.0))
_PALM = 0.6  # Share of the hand's length at which the palm touches.
_MAX_PALM_DEPTH, _MAX_PALM_OFFSET = 0.05, 0.03


@dataclass(frozen=True, eq=False)
class Arm:
    """One arm in the zero pose, in world axes."""

    elbow: kinematic_chains.BendJoint
    upper: Float[np.ndarray, "3 3"]  # Upper arm: z from the elbow to the shoulder, y against the elbow's flexion.
    fore: Float[np.ndarray, "3 3"]  # Forearm: x from the elbow to the wrist, the same y.
    hand: Float[np.ndarray, "3 3"]  # Hand: x along the fingers; its y is to the inner side of the left palm's back.
    wrist: Float[np.ndarray, "3"]
    palm: Float[np.ndarray, "3"]
    beyond: tuple[int, ...]  # Joints after the elbow.
    free_turns: int  # Number of independent axes of these: three can turn a palm freely.
    straight: float  # Angle at which the elbow is straight [rad].
    measured: bool  # Whether the hand has geometry.


def find_arm(  # noqa: PLR0913  # facts of one arm
    pose: ZeroPose, chain: kinematic_chains.KinematicChain, ahead: np.ndarray, inward: int, *, named: str, roll: float
) -> Arm:
    """Return an arm.

    Raises `UnsuitableRobotError` where it has no elbow.

    Args: `pose`: the zero pose; `chain`: the arm; `ahead`: the forward axis; `inward`: sign of the hand's y axis that
    points to the other hand: -1 on the left; `named`: the elbow's joint, where the user states it; `roll`: of the hand
    about the forearm, where the user states it [rad].
    """
    points = pose.points(*chain.tip)
    hinges = chain.hinges
    tip = _farthest(points, pose.anchors[hinges[2]], pose.anchors[hinges[-1]])
    bend = kinematic_chains.find_bend_joint(pose, hinges, tip, "elbow", named)
    bend = bend.abreast_of(pose, bend.top)
    tip = _farthest(points, bend.middle, pose.anchors[hinges[-1]])
    beyond = hinges[bend.place + 1 :]
    way = tip - bend.middle
    reach = float(np.linalg.norm(way))
    twists = [
        j
        for j in beyond
        if pose.lever(tip, j) < _MAX_TWIST_OFFSET * reach and abs(pose.axes[j] @ way) > _MIN_TWIST_ALONG * reach
    ]
    bends = [joint for joint in beyond if joint not in twists]
    wrist = bend.middle + _PALM * way
    if bends:
        wrist = pose.anchors[beyond[-1]] if beyond[-1] in bends else kinematic_chains.joint_centre(pose, bends[-2:])
        bend = bend.abreast_of(pose, 0.5 * (bend.top + wrist))
    flexion = pose.axes[bend.joint] * _flexion_sign(pose, bend, wrist, ahead)
    upper_z = kinematic_chains.perpendicular(bend.top - bend.middle, flexion)
    upper = _frame(z=upper_z, y=-flexion)
    fore_x = kinematic_chains.perpendicular(wrist - bend.middle, flexion)
    fore_z = np.cross(fore_x, -flexion)
    fore = _frame(z=fore_z, y=-flexion)
    hand = fore
    along = tip - wrist
    if len(points) and np.linalg.norm(along) > 0.03 and along @ fore[:, 0] < _COS_BENT_WRIST * np.linalg.norm(along):
        # The zero pose bends the wrist: the hand's own length is its axis.
        turn = np.cross(fore[:, 0], along / np.linalg.norm(along))
        angle = np.arctan2(np.linalg.norm(turn), fore[:, 0] @ along / np.linalg.norm(along))
        hand = se3.quat_to_matrix(se3.exp(turn / max(np.linalg.norm(turn), 1e-9) * angle)) @ fore
    hand = hand @ se3.quat_to_matrix(se3.exp(np.array([-inward * roll, 0.0, 0.0])))
    palm = _palm(points, wrist, hand, tip, inward)
    axes = pose.axes[list(beyond)] if beyond else np.zeros((1, 3))
    free_turns = int((np.linalg.svd(axes, compute_uv=False) > 0.3).sum()) if beyond else 0
    straight, _, _ = kinematic_chains.straight_angle(pose, bend, wrist)
    return Arm(bend, upper, fore, hand, wrist, palm, beyond, free_turns, straight, measured=len(points) > 0)


def _flexion_sign(pose: ZeroPose, bend: kinematic_chains.BendJoint, wrist: np.ndarray, ahead: np.ndarray) -> float:
    _, above, below = kinematic_chains.straight_angle(pose, bend, wrist)
    if min(above, below) < _AMBIGUOUS * max(above, below):
        return 1.0 if above > below else -1.0
    swing = np.cross(pose.axes[bend.joint], bend.middle - bend.top)
    return 1.0 if swing @ ahead > 0 else -1.0


def _palm(points: np.ndarray, wrist: np.ndarray, hand: np.ndarray, tip: np.ndarray, inward: int) -> np.ndarray:
    length = max(float((tip - wrist) @ hand[:, 0]), 0.05)
    depth, sideways = 0.02, 0.0
    if len(points):
        local = (points - wrist) @ hand
        near = local[np.abs(local[:, 0] - 0.55 * length) < 0.2 * length]
        if len(near):
            depth = float(np.clip(0.9 * (inward * near[:, 1]).max(), 0.0, _MAX_PALM_DEPTH))
            sideways = float(np.clip(0.5 * (near[:, 2].min() + near[:, 2].max()), -_MAX_PALM_OFFSET, _MAX_PALM_OFFSET))
    return wrist + hand @ np.array([_PALM * length, inward * depth, sideways])


def _farthest(points: np.ndarray, origin: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    """Return the farthest point of a hand, straight through its middle [m]."""
    if not len(points):
        return otherwise
    way = points.mean(axis=0) - origin
    way /= max(float(np.linalg.norm(way)), 1e-9)
    return origin + way * float(((points - origin) @ way).max())


def _frame(*, z: np.ndarray, y: np.ndarray) -> Float[np.ndarray, "3 3"]:
    z = z / np.linalg.norm(z)
    y = y - z * (z @ y)
    y = y / np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], axis=1)
