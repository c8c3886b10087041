"""Knees and elbows of a limb's chain of hinges, and the angle at which they are straight."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.adding.description import finite_range
from hoi_retarget.robots.adding.findings import Refused
from hoi_retarget.robots.adding.zero_pose import ZeroPose

_RIDGE = 1e-3
_BY_NAME = 0.4
"""A joint that is called a knee or an elbow is one if its lever is at least this share of the longest."""
SURE = 1.5
"""The longest lever is so many times the next one where the choice is beyond doubt."""


@dataclass(frozen=True, eq=False)
class Bend:
    """The joint in the middle of a limb."""

    place: int
    """In the limb's chain."""
    joint: int
    lever: float
    """The smaller one of its distances to the limb's two ends [m]."""
    next_lever: float
    """That of the next best joint [m]."""
    top: Float[np.ndarray, "3"]
    """Centre of the joints before it: hip or shoulder [m]."""
    middle: Float[np.ndarray, "3"]
    """On its axis, abreast of the limb's ends [m]."""

    def abreast_of(self, pose: ZeroPose, point: Float[np.ndarray, "3"]) -> "Bend":
        """Return the bend with its middle where its axis is nearest to a point."""
        axis = pose.axes[self.joint]
        return replace(self, middle=self.middle + axis * (axis @ (point - self.middle)))

    @property
    def is_sure(self) -> bool:
        """Whether no other joint comes near."""
        return self.lever > SURE * self.next_lever


def joint_centre(pose: ZeroPose, hinges: Sequence[int]) -> Float[np.ndarray, "3"]:
    """Return the point nearest to the axes of hinges [m]; along parallel axes, near the last anchor."""
    total, moment = _RIDGE * np.eye(3), _RIDGE * pose.anchors[hinges[-1]]
    for joint in hinges:
        across = np.eye(3) - np.outer(pose.axes[joint], pose.axes[joint])
        total, moment = total + across, moment + across @ pose.anchors[joint]
    return np.linalg.solve(total, moment)


def find_bend(pose: ZeroPose, hinges: Sequence[int], end: Float[np.ndarray, "3"], called: str, named: str = "") -> Bend:
    """Return the knee or the elbow: the joint far from the hip and from the foot, whatever it is called.

    Args:
        pose: The zero pose.
        hinges: The limb's chain.
        end: The limb's end [m].
        called: `knee` or `elbow`: a name decides between joints that are about as likely.
        named: The joint's name, where the user says it.

    Raises `Refused` where the limb does not bend, or has no joint of the name.
    """
    scores: dict[int, tuple[float, np.ndarray]] = {}
    for place in range(2, len(hinges)):
        top = joint_centre(pose, hinges[:place])
        joint = hinges[place]
        scores[place] = min(pose.lever(top, joint), pose.lever(end, joint)), top
    best = max(scores, key=lambda place: scores[place][0])
    longest = scores[best][0]
    so_called = [p for p in scores if re.search(called, pose.name(hinges[p]), re.IGNORECASE)]
    likely = [p for p in so_called if scores[p][0] >= _BY_NAME * longest]
    if named:
        if named not in [pose.name(joint) for joint in hinges[2:]]:
            there = ", ".join(pose.name(joint) for joint in hinges[2:])
            raise Refused(f"{called} = {named!r}: the joints of that limb that can be one are {there}.")
        best = next(place for place in scores if pose.name(hinges[place]) == named)
    elif likely:
        best = max(likely, key=lambda place: scores[place][0])
    lever, top = scores[best]
    if lever < 0.02:
        raise Refused(f"no {called}: no joint of {', '.join(pose.name(joint) for joint in hinges)} bends the limb.")
    others = [score for place, (score, _) in scores.items() if place != best and not likely]
    joint = hinges[best]
    anchor, axis = pose.anchors[joint], pose.axes[joint]
    middle = anchor + axis * (axis @ (0.5 * (top + end) - anchor))
    return Bend(best, joint, lever, max(others, default=0.0), top, middle)


def straight_angle(pose: ZeroPose, bend: Bend, end: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    """Return at which angle a bend is straight, and how far its range goes on either side of it [rad].

    What a file calls zero may be a bent limb.
    """
    axis = pose.axes[bend.joint]
    lower_part, upper_part = _across(end - bend.middle, axis), _across(bend.middle - bend.top, axis)
    turn = float(np.arctan2(axis @ np.cross(lower_part, upper_part), lower_part @ upper_part))
    compiled = pose.compiled
    straight = float(compiled.qpos0[compiled.jnt_qposadr[bend.joint]]) + turn
    lower, upper = finite_range(compiled, bend.joint) or (straight - np.pi, straight + np.pi)
    return straight, upper - straight, straight - lower


def _across(vector: np.ndarray, axis: np.ndarray) -> np.ndarray:
    return vector - axis * (axis @ vector)
