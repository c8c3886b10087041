"""The forward axis of a humanoid, by a vote of several cues, each of which is wrong on some robot."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.adding.findings import RobotFinding, UnsuitableRobotError
from hoi_retarget.robots.adding.kinematic_chains import BendJoint, Limbs, straight_angle
from hoi_retarget.robots.adding.zero_pose import ZeroPose

_ROOT_WEIGHT = 0.3
_MIN_VOTES = 0.15
_SIDE_NAMES = (("l", "left"), ("r", "right"))
_AXES = {"x": (1, 0, 0), "-x": (-1, 0, 0), "y": (0, 1, 0), "-y": (0, -1, 0), "z": (0, 0, 1), "-z": (0, 0, -1)}


@dataclass(frozen=True)
class TrunkAxes:
    """Axes of the trunk in the zero pose."""

    axes: Float[np.ndarray, "3 3"]  # Columns: ahead, left, up; in world axes.
    first_is_left: bool  # Whether the limbs that were found first are the left ones.
    finding: RobotFinding


def side_of(name: str) -> int:
    """Return 1 for the name of a left joint, -1 for a right one, 0 for a name without a side."""
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", name)]
    left, right = ({f"{side}{limb}" for side in sides for limb in ("", "leg", "arm")} for sides in _SIDE_NAMES)
    return bool(left & set(words)) - bool(right & set(words))


def find_forward_axis(
    pose: ZeroPose, limbs: Limbs, knees: Sequence[BendJoint], ankles: Sequence[np.ndarray], hint: str
) -> TrunkAxes:
    """Return the trunk's axes.

    The direction of the knees' flexion, the longer end of the feet, left and right in the joints' names, and the root's
    x axis vote for the forward axis.
    Raises `UnsuitableRobotError` where the votes do not decide, or `hint` is none of the axes across the legs.

    Args: `pose`: the zero pose; `limbs`: its limbs, left and right not yet distinguished; `knees`: in the order of the
    legs; none of a robot without legs; `ankles`: their centres [m], in the same order; `hint`: the forward axis, such
    as `-x`, where the user states it; otherwise empty.
    """
    ahead = np.cross(limbs.lateral, limbs.up)  # If the first limbs are the left ones.
    ahead /= np.linalg.norm(ahead)
    if hint:
        if hint not in _AXES or abs(np.dot(_AXES[hint], ahead)) < 0.7:
            raise UnsuitableRobotError(
                f"ahead = {hint!r}: it has to be an axis across the line of the hips, of {', '.join(_AXES)}."
            )
        votes = {"the hint": float(np.sign(np.dot(_AXES[hint], ahead)))}
    else:
        votes = {
            "knees": _mean([_knee_vote(pose, knee, ankle, ahead) for knee, ankle in zip(knees, ankles, strict=True)]),
            "feet": _mean(
                [_foot_vote(pose, limb.tip, ankle, ahead) for limb, ankle in zip(limbs.legs, ankles, strict=True)]
            ),
            "names": _name_vote(pose, limbs),
            "the root's x": _ROOT_WEIGHT * float(np.clip(pose.body_rotation[pose.root.body][:, 0] @ ahead, -1, 1)),
        }
    total = sum(votes.values())
    if abs(total) < _MIN_VOTES:
        raise UnsuitableRobotError(
            f"which way it looks cannot be decided: {_listed(votes, 1.0)}. "
            'Say it in a hints file: ahead = "x" (or -x, y, -y).'
        )
    first_is_left, sign = total > 0, float(np.sign(total))
    left = sign * limbs.lateral
    left = left - limbs.up * (left @ limbs.up)
    left /= np.linalg.norm(left)
    ahead = np.cross(left, limbs.up)
    against = [name for name, vote in votes.items() if vote * sign < -0.1]
    place = " ".join(f"{number + 0.0:g}" for number in np.round(ahead, 2))
    what = f"({place}) in the root's frame by {_listed(votes, sign)}"
    finding = RobotFinding("warn" if against else "ok", "ahead", what, 'ahead = "x"  # or -x, y, -y')
    return TrunkAxes(np.stack([ahead, left, limbs.up], axis=1), first_is_left, finding)


def _mean(votes: Sequence[float]) -> float:
    return float(np.mean(votes)) if votes else 0.0


def _listed(votes: dict[str, float], sign: float) -> str:
    return ", ".join(f"{name} {sign * vote:+.1f}" for name, vote in votes.items())


def _knee_vote(pose: ZeroPose, knee: BendJoint, ankle: np.ndarray, ahead: np.ndarray) -> float:
    """Return a vote for `ahead`, -1 to 1: knees bend backwards, the more one-sided their range the surer."""
    _, above, below = straight_angle(pose, knee, ankle)
    one_sided = (above - below) / max(above + below, 1e-9)
    swing = np.cross(pose.axes[knee.joint], knee.middle - knee.top)
    return float(np.clip(-2 * one_sided, -1, 1) * np.sign(swing @ ahead))


def _foot_vote(pose: ZeroPose, foot: Sequence, ankle: np.ndarray, ahead: np.ndarray) -> float:
    points = pose.points(*foot, meshes_only=True)
    if len(points) < 4:
        return 0.0
    along = (points - ankle) @ ahead
    return float(np.clip(2 * (along.max() + along.min()) / max(np.ptp(along), 1e-9), -1, 1))


def _name_vote(pose: ZeroPose, limbs: Limbs) -> float:
    first = [side_of(pose.name(joint)) for chain in (*limbs.legs[:1], limbs.arms[0]) for joint in chain.hinges]
    second = [side_of(pose.name(joint)) for chain in (*limbs.legs[1:], limbs.arms[1]) for joint in chain.hinges]
    return float(np.clip(np.mean(first) - np.mean(second), -1, 1))
