"""Fingers of a description's hands: chains beyond the wrist, the thumb by opposition, pads, and whom each follows."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.adding.arms import Arm
from hoi_retarget.robots.adding.description import finite_range
from hoi_retarget.robots.adding.findings import RobotFinding, UnsuitableRobotError
from hoi_retarget.robots.adding.kinematic_chains import KinematicChain, Limbs
from hoi_retarget.robots.adding.zero_pose import LimbPart, ZeroPose
from hoi_retarget.robots.spec import SIDES

_FOLLOWED: Mapping[int, tuple[str, ...]] = {
    1: ("index",),
    2: ("index", "ring"),
    3: ("index", "middle", "ring"),
    4: ("index", "middle", "ring", "pinky"),
}
"""The human fingers that fingers beside the thumb follow, by their number."""
_PAD = 0.75  # Share of the last link's length at which its pad is.
_PAD_WIDTH = 0.2  # Of points about there.


@dataclass(frozen=True, eq=False)
class Finger:
    """One finger in the zero pose, in world axes."""

    joints: tuple[int, ...]
    part: LimbPart  # The part moved by the last joint.
    pad: Float[np.ndarray, "3"]  # [m]
    rotation: Float[np.ndarray, "3 3"]  # Of the pad: x along the last link, y against the way in which it closes.

    def findings(self, pose: ZeroPose, follows: str) -> Iterator[RobotFinding]:
        """Yield its joints and the human finger that it follows."""
        names = f"{pose.name(self.joints[0])} ... {pose.name(self.joints[-1])}, {len(self.joints)} joints"
        yield RobotFinding("ok", follows.replace("_", " "), f"followed by {names}", "fingers = false")


def finger_joints(chain: KinematicChain) -> tuple[int, ...]:
    """Return the joints of all that hangs from a hand."""
    return tuple(joint for part in chain.beyond for joint in part.hinges)


def find_fingers(pose: ZeroPose, limbs: Limbs, arms: Sequence[Arm]) -> dict[str, Finger]:
    """Return the fingers of both hands by the human finger that each follows, such as `left_thumb`.

    Raises `UnsuitableRobotError` where a hand has less than two, or more than a person.
    """
    found: dict[str, Finger] = {}
    for side, chain, arm in zip(SIDES, limbs.arms, arms, strict=True):
        chains = [joined for child in chain.end.children if (joined := tuple(_chain(child)))]
        if not 2 <= len(chains) <= 1 + max(_FOLLOWED):
            raise UnsuitableRobotError(
                f"the {side} hand has {len(chains)} fingers; two to five can move. Leave out: fingers = true."
            )
        ways = [_closing(pose, parts) for parts in chains]
        # The thumb closes against the others.
        alike = [sum(float(way @ other) for other in ways) for way in ways]
        thumb = int(np.argmin(alike))
        bases = [pose.anchors[parts[0].hinges[0]] for parts in chains]
        others = [index for index in range(len(chains)) if index != thumb]
        others.sort(key=lambda index: -float(bases[index] @ arm.hand[:, 2]))  # z is to the side of a person's thumb.
        for name, index in zip(("thumb", *_FOLLOWED[len(others)]), (thumb, *others), strict=True):
            found[f"{side}_{name}"] = _finger(pose, chains[index], ways[index])
    return found


def _chain(part: LimbPart) -> Iterator[LimbPart]:
    """Yield the parts of a finger, from its base on."""
    yield part
    while part.children:
        part = max(part.children, key=lambda child: child.hinge_count)
        yield part


def _closing(pose: ZeroPose, parts: Sequence[LimbPart]) -> Float[np.ndarray, "3"]:
    """Return the direction in which a finger's tip closes: joints bend to the longer side of their ranges."""
    tip, way = _tip(pose, parts[-1]), np.zeros(3)
    for joint in (joint for part in parts for joint in part.hinges):
        lower, upper = finite_range(pose.compiled, joint) or (-np.pi, np.pi)
        above, below = upper - pose.zero_angle(joint), pose.zero_angle(joint) - lower
        way += (above - below) / (above + below) * np.cross(pose.axes[joint], tip - pose.anchors[joint])
    return way / max(float(np.linalg.norm(way)), 1e-9)


def _tip(pose: ZeroPose, part: LimbPart) -> Float[np.ndarray, "3"]:
    points, base = pose.points(part), pose.anchors[part.hinges[-1]]
    return points[np.linalg.norm(points - base, axis=1).argmax()] if len(points) else base


def _finger(pose: ZeroPose, parts: Sequence[LimbPart], way: Float[np.ndarray, "3"]) -> Finger:
    last = parts[-1]
    base, tip, points = pose.anchors[last.hinges[-1]], _tip(pose, last), pose.points(last)
    length = max(float(np.linalg.norm(tip - base)), 1e-6)
    along = (tip - base) / length
    shares = (points - base) @ along / length
    near = points[np.abs(shares - _PAD) < _PAD_WIDTH]
    inward = way - along * (way @ along)
    inward /= max(float(np.linalg.norm(inward)), 1e-9)
    middle = base + _PAD * (tip - base)
    depth = float(((near - middle) @ inward).max(initial=0.0))
    joints = tuple(joint for part in parts for joint in part.hinges)
    rotation = np.stack([along, -inward, np.cross(along, -inward)], axis=1)
    return Finger(joints, last, middle + depth * inward, rotation)
