"""Kinematic chains of legs and arms, by geometry, and the joint in the middle of each: knee or elbow."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.adding.description import finite_range
from hoi_retarget.robots.adding.findings import UnsuitableRobotError
from hoi_retarget.robots.adding.zero_pose import LimbPart, ZeroPose

_MIRROR_TOLERANCE = 0.03  # Between anchors of mirrored joints and each other's mirror images [m].
_MIN_JOINTS = 3
_FINGER = re.compile(r"finger|thumb|index|middle|ring_|_ring|pinky|little|gripper|claw|jaw|knuckle", re.IGNORECASE)
_UPS = ((0, 0, 1), (0, 1, 0), (1, 0, 0), (0, -1, 0), (-1, 0, 0), (0, 0, -1))
_MIN_DOWNWARDS = 0.7  # Share of a leg's reach from its first joint that is downwards.
_MIN_LEG_JOINTS, _MIN_ARM_JOINTS = 4, 3
_NOTHING = "no legs: no mirrored pair"
_UPPER = 'For its upper body alone say base = "follows" or base = "stays" in a hints file.'
_MAX_FINGER_MASS_RATIO = 3.0  # Fingers differ in mass by less than this factor; a gear beside a forearm is lighter.
_RIDGE = 1e-3
_MIN_NAMED_LEVER = 0.4  # A joint called a knee or an elbow is one from this share of the longest lever on.
_SURE_LEVER_RATIO = 1.5  # From this ratio of the longest lever to the next one, the choice is beyond doubt.


@dataclass(frozen=True, eq=False)
class KinematicChain:
    """The hinges of one limb, from the trunk outwards, and the parts beyond them that are held."""

    hinges: tuple[int, ...]
    end: LimbPart  # The part moved by the last hinge.
    beyond: tuple[LimbPart, ...]  # Fingers and the like, moved by hinges that are held.

    @property
    def tip(self) -> tuple[LimbPart, ...]:
        """The end with all parts that hang from it: a hand with its fingers, a foot."""
        return (self.end, *self.beyond)


@dataclass(frozen=True, eq=False)
class Limbs:
    """The limbs with the upward axis; left and right are not distinguished yet."""

    up: Float[np.ndarray, "3"]
    lateral: Float[np.ndarray, "3"]  # From the second leg to the first, of unit length.
    pelvis: LimbPart
    torso: LimbPart
    legs: tuple[KinematicChain, ...]  # Two; none of a robot of which the upper body alone is looked for.
    arms: tuple[KinematicChain, KinematicChain]  # In the order of the legs: the first arm is on the first leg's side.


@dataclass(frozen=True, eq=False)
class _Pair:
    trunk: LimbPart
    first: LimbPart
    second: LimbPart
    lateral: np.ndarray

    def holds(self, part: LimbPart) -> bool:
        """Return whether a part is in one of the two."""
        return any(part is below for side in (self.first, self.second) for below in side.below())


def find_arms(pose: ZeroPose) -> Limbs:
    """Return the arms of a description without legs: the highest mirrored pair of limbs, z being up.

    Raises `UnsuitableRobotError` without two arms.
    """
    up = np.array(_UPS[0], dtype=float)
    level = [pair for pair in _pairs(pose) if abs(pair.lateral @ up) < 0.1]
    outer = [pair for pair in level if not any(other is not pair and other.holds(pair.trunk) for other in level)]
    pair = max(outer, key=lambda pair: float(_middle(pose, pair) @ up), default=None)
    if pair is None:
        raise UnsuitableRobotError(
            "no two arms: no mirrored pair of limbs with three joints or more hangs on one link."
        )
    arms = (_arm_chain(pose, pair.first), _arm_chain(pose, pair.second))
    found = Limbs(up, pair.lateral, pose.root, pair.trunk, (), arms)
    _check_joints(pose, found)
    return found


def find_limbs(pose: ZeroPose) -> Limbs:
    """Return the limbs of a description in its zero pose; raises `UnsuitableRobotError` without two legs and arms."""
    pairs = _pairs(pose)
    reasons: list[str] = []
    for axis in _UPS:
        up = np.array(axis, dtype=float)
        try:
            return _limbs(pose, pairs, up)
        except UnsuitableRobotError as refusal:
            reasons.append(str(refusal))
    wheels = [pose.name(joint) for part in pose.parts for joint in part.hinges if "wheel" in pose.name(joint).lower()]
    if wheels:
        raise UnsuitableRobotError(
            f"no legs: it stands on wheels ({', '.join(wheels[:3])}) and cannot follow standing feet. {_UPPER}"
        )
    raise UnsuitableRobotError(next((reason for reason in reasons if not reason.startswith(_NOTHING)), reasons[0]))


def _limbs(pose: ZeroPose, pairs: Sequence[_Pair], up: np.ndarray) -> Limbs:
    level = [pair for pair in pairs if abs(pair.lateral @ up) < 0.1]
    legs = min(
        (pair for pair in level if _hangs(pose, pair, up)), key=lambda pair: _lowest(pose, pair, up), default=None
    )
    if legs is None:
        raise UnsuitableRobotError(_no_legs(pose, level))
    hips = pose.anchors[legs.first.hinges[0]]
    others = [
        pair
        for pair in level
        if pair is not legs
        and not legs.holds(pair.trunk)
        and not pair.holds(legs.trunk)
        and abs(pair.lateral @ legs.lateral) > 0.98
        and abs((_middle(pose, pair) - _middle(pose, legs)) @ legs.lateral) < 2 * _MIRROR_TOLERANCE
    ]
    outer = [pair for pair in others if not any(other is not pair and other.holds(pair.trunk) for other in others)]
    arms = max(outer, key=lambda pair: pose.mass(pair.first), default=None)
    if arms is None:
        raise UnsuitableRobotError(
            f"only one mirrored pair of limbs of three joints ({pose.name(legs.first.hinges[0])} ...): two legs "
            "and two arms are needed. Use the file of the whole robot."
        )
    if (pose.anchors[arms.first.hinges[0]] - hips) @ up <= 0:
        raise UnsuitableRobotError("the limbs that reach lowest begin above the others: the zero pose is not upright.")
    if arms.lateral @ legs.lateral < 0:
        arms = _Pair(arms.trunk, arms.second, arms.first, -arms.lateral)
    found = Limbs(
        up=up,
        lateral=legs.lateral,
        pelvis=legs.trunk,
        torso=arms.trunk,
        legs=(_leg_chain(pose, legs.first, up), _leg_chain(pose, legs.second, up)),
        arms=(_arm_chain(pose, arms.first), _arm_chain(pose, arms.second)),
    )
    _check_joints(pose, found)
    return found


def _check_joints(pose: ZeroPose, limbs: Limbs) -> None:
    for what, chains, fewest, why in (
        ("legs", limbs.legs, _MIN_LEG_JOINTS, "a foot cannot be placed and turned with so few."),
        ("arms", limbs.arms, _MIN_ARM_JOINTS, "a hand cannot follow a person's with so few."),
    ):
        count = min((len(chain.hinges) for chain in chains), default=fewest)
        if count < fewest:
            names = ", ".join(pose.name(joint) for joint in min(chains, key=lambda chain: len(chain.hinges)).hinges)
            raise UnsuitableRobotError(f"its {what} have only {count} joints ({names}): {why}")


def _pairs(pose: ZeroPose) -> list[_Pair]:
    """Return all pairs of sub-trees on one part with mirrored first joints."""
    pairs = []
    for part in pose.parts:
        children = [child for child in part.children if child.hinge_count >= _MIN_JOINTS]
        for index, first in enumerate(children):
            for second in children[index + 1 :]:
                # First axes may cross: those after them are apart.
                hinges = zip(_along(pose, first)[:_MIN_JOINTS], _along(pose, second)[:_MIN_JOINTS], strict=True)
                ways = [pose.anchors[a] - pose.anchors[b] for a, b in hinges]
                lateral = next((way for way in ways if np.linalg.norm(way) > _MIRROR_TOLERANCE), ways[0])
                width = float(np.linalg.norm(lateral))
                if width > _MIRROR_TOLERANCE and _mirrored(pose, first, second, lateral / width):
                    pairs.append(_Pair(part, first, second, lateral / width))
    return pairs


def _mirrored(pose: ZeroPose, first: LimbPart, second: LimbPart, lateral: np.ndarray) -> bool:
    masses = pose.mass(first), pose.mass(second)
    if abs(first.hinge_count - second.hinge_count) > 1 or max(masses) > 1.5 * min(masses) + 0.05:
        return False
    middle = 0.5 * (pose.anchors[first.hinges[0]] + pose.anchors[second.hinges[0]])
    one, other = (_along(pose, side)[:_MIN_JOINTS] for side in (first, second))
    for a, b in zip(one, other, strict=False):
        # A joint's anchor may be anywhere along its axis: the mirrored axis passes near the other's anchor.
        away = pose.anchors[a] - middle
        image = middle + away - 2 * lateral * (lateral @ away)
        if pose.lever(image, b) > _MIRROR_TOLERANCE and np.linalg.norm(image - pose.anchors[b]) > _MIRROR_TOLERANCE:
            return False
    return True


def _along(pose: ZeroPose, part: LimbPart) -> list[int]:
    """Return the hinges along the heaviest branch."""
    hinges: list[int] = []
    while True:
        hinges += part.hinges
        if not part.children:
            return hinges
        part = max(part.children, key=pose.mass)


def _middle(pose: ZeroPose, pair: _Pair) -> np.ndarray:
    return 0.5 * (pose.anchors[pair.first.hinges[0]] + pose.anchors[pair.second.hinges[0]])


def _reach(pose: ZeroPose, part: LimbPart, up: np.ndarray) -> np.ndarray:
    """Return the lowest point of a limb: of its joints, and of its surfaces."""
    hinges = [joint for below in part.below() for joint in below.hinges]
    places = np.concatenate([pose.anchors[hinges], pose.points(*part.below())])
    return places[(places @ up).argmin()]


def _lowest(pose: ZeroPose, pair: _Pair, up: np.ndarray) -> float:
    return min(float(_reach(pose, side, up) @ up) for side in (pair.first, pair.second))


def _hangs(pose: ZeroPose, pair: _Pair, up: np.ndarray) -> bool:
    hinges = _along(pose, pair.first)
    way = pose.anchors[hinges[-1]] - pose.anchors[hinges[0]]
    length = float(np.linalg.norm(way))
    return length > 0.1 and -float(way @ up) > _MIN_DOWNWARDS * length


def _no_legs(pose: ZeroPose, pairs: Sequence[_Pair]) -> str:
    if not pairs:
        return f"{_NOTHING} of limbs with three joints or more hangs on one link."
    heights = ", ".join(f"{pose.name(pair.first.hinges[0])} ..." for pair in pairs[:3])
    why = f"of the mirrored pairs of limbs ({heights}) none hangs down to the ground from where it begins"
    return f"no legs: {why}. {_UPPER}"


def _leg_chain(pose: ZeroPose, part: LimbPart, up: np.ndarray) -> KinematicChain:
    hinges = list(part.hinges)
    while part.children:
        part = min(part.children, key=lambda child: float(_reach(pose, child, up) @ up))
        hinges += part.hinges
    return KinematicChain(tuple(hinges), part, ())


def _begins_fingers(pose: ZeroPose, count: int, heaviest: LimbPart, others: Sequence[LimbPart]) -> bool:
    """Return whether fingers hang from a hand: several parts of a kind, called so, or followed by other joints.

    `count` joints come before; after so few that an arm may have more, parts of a kind may be gears.
    """
    several = bool(others) and pose.mass(heaviest) < _MAX_FINGER_MASS_RATIO * pose.mass(others[0])
    followed = {one.other for one in pose.held}
    names = [pose.name(joint) for joint in heaviest.hinges]
    return (several and count > _MIN_ARM_JOINTS) or any(_FINGER.search(name) or name in followed for name in names)


def _arm_chain(pose: ZeroPose, part: LimbPart) -> KinematicChain:
    hinges = list(part.hinges)
    while part.children:
        heaviest, *others = sorted(part.children, key=pose.mass, reverse=True)
        if len(hinges) >= _MIN_ARM_JOINTS and _begins_fingers(pose, len(hinges), heaviest, others):
            break
        part = heaviest
        hinges += part.hinges
    beyond = tuple(other for child in part.children for other in child.below())
    return KinematicChain(tuple(hinges), part, beyond)


@dataclass(frozen=True, eq=False)
class BendJoint:
    """The joint in the middle of a limb."""

    place: int  # In the limb's chain.
    joint: int
    lever: float  # The smaller one of its distances to the limb's two ends [m].
    next_lever: float  # That of the next best joint [m].
    top: Float[np.ndarray, "3"]  # Centre of the joints before it: hip or shoulder [m].
    middle: Float[np.ndarray, "3"]  # On its axis, abreast of the limb's ends [m].

    def abreast_of(self, pose: ZeroPose, point: Float[np.ndarray, "3"]) -> "BendJoint":
        """Return the bend with its middle where its axis is nearest to a point."""
        axis = pose.axes[self.joint]
        return replace(self, middle=self.middle + axis * (axis @ (point - self.middle)))

    @property
    def is_sure(self) -> bool:
        """Whether no other joint comes near."""
        return self.lever > _SURE_LEVER_RATIO * self.next_lever


def joint_centre(pose: ZeroPose, hinges: Sequence[int]) -> Float[np.ndarray, "3"]:
    """Return the point nearest to the axes of hinges [m]; along parallel axes, near the last anchor."""
    total, moment = _RIDGE * np.eye(3), _RIDGE * pose.anchors[hinges[-1]]
    for joint in hinges:
        across = np.eye(3) - np.outer(pose.axes[joint], pose.axes[joint])
        total, moment = total + across, moment + across @ pose.anchors[joint]
    return np.linalg.solve(total, moment)


def find_bend_joint(
    pose: ZeroPose, hinges: Sequence[int], end: Float[np.ndarray, "3"], called: str, named: str = ""
) -> BendJoint:
    """Return the knee or the elbow: the joint far from both ends of the limb, with axes before it that nearly meet.

    Raises `UnsuitableRobotError` where the limb does not bend, or has no joint of the name.

    Args: `pose`: the zero pose; `hinges`: the limb's chain; `end`: the limb's end [m]; `called`: `knee` or `elbow`: a
    name decides between joints that are about as likely; `named`: the joint's name, where the user states it.
    """
    scores: dict[int, tuple[float, float, np.ndarray]] = {}
    driven = [place for place in range(2, len(hinges)) if pose.name(hinges[place]) not in pose.description.passive]
    for place in range(2, len(hinges)) if named else driven:
        top = joint_centre(pose, hinges[:place])
        joint = hinges[place]
        lever = min(pose.lever(top, joint), pose.lever(end, joint))
        scores[place] = lever - max(pose.lever(top, before) for before in hinges[:place]), lever, top
    if not scores:
        raise UnsuitableRobotError(f"no {called}: no joint of the limb that could be one has a drive.")
    best = max(scores, key=lambda place: scores[place][0])
    longest = scores[best][0]
    so_called = [p for p in scores if re.search(called, pose.name(hinges[p]), re.IGNORECASE)]
    likely = [p for p in so_called if scores[p][0] >= _MIN_NAMED_LEVER * longest]
    if named:
        if named not in [pose.name(joint) for joint in hinges[2:]]:
            there = ", ".join(pose.name(joint) for joint in hinges[2:])
            raise UnsuitableRobotError(f"{called} = {named!r}: the joints of that limb that can be one are {there}.")
        best = next(place for place in scores if pose.name(hinges[place]) == named)
    elif likely:
        best = max(likely, key=lambda place: scores[place][0])
    _, lever, top = scores[best]
    if lever < 0.02:
        raise UnsuitableRobotError(
            f"no {called}: no joint of {', '.join(pose.name(joint) for joint in hinges)} bends the limb."
        )
    others = [scores[p][1] for p in scores if p != best and scores[p][0] > 0.0 and not likely]
    joint = hinges[best]
    anchor, axis = pose.anchors[joint], pose.axes[joint]
    middle = anchor + axis * (axis @ (0.5 * (top + end) - anchor))
    return BendJoint(best, joint, lever, max(others, default=0.0), top, middle)


def straight_angle(pose: ZeroPose, bend: BendJoint, end: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    """Return the angle at which a limb is straight, and the extent of the joint's range above and below it [rad].

    The zero pose of a file may have bent limbs.
    """
    axis = pose.axes[bend.joint]
    lower_part, upper_part = perpendicular(end - bend.middle, axis), perpendicular(bend.middle - bend.top, axis)
    turn = float(np.arctan2(axis @ np.cross(lower_part, upper_part), lower_part @ upper_part))
    straight = pose.zero_angle(bend.joint) + turn
    lower, upper = finite_range(pose.compiled, bend.joint) or (straight - np.pi, straight + np.pi)
    return straight, upper - straight, straight - lower


def perpendicular(vector: Float[np.ndarray, "3"], axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Return the part, in its unit, of a vector perpendicular to a unit axis."""
    return vector - axis * (axis @ vector)
