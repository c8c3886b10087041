"""Legs and arms of a description, by geometry: mirrored pairs of sub-trees, and the chains of hinges along them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.adding.findings import Refused
from hoi_retarget.robots.adding.zero_pose import Part, ZeroPose

_MIRROR = 0.03
"""Anchors of mirrored joints lie this near to each other's mirror images [m]."""
_FEWEST = 3
_FINGER = re.compile(r"finger|thumb|index|middle|ring_|_ring|pinky|little|gripper|claw|jaw|knuckle", re.IGNORECASE)
_UPS = ((0, 0, 1), (0, 1, 0), (1, 0, 0), (0, -1, 0), (-1, 0, 0), (0, 0, -1))
_HANGING = 0.7
"""Share of a leg's reach from its first joint that is downwards."""
_FEWEST_LEG, _FEWEST_ARM = 4, 4
_NOTHING = "no legs: no mirrored pair"
_UPPER = 'For its upper body alone say base = "follows" or base = "stays" in a hints file.'
_ALIKE = 3.0
"""Fingers differ in mass by less than this factor; a gear beside a forearm is lighter."""


@dataclass(frozen=True, eq=False)
class Chain:
    """The hinges of one limb, from the trunk outwards, and the parts beyond them that are held."""

    hinges: tuple[int, ...]
    end: Part
    """What the last hinge moves."""
    beyond: tuple[Part, ...]
    """Fingers and the like, moved by hinges that are held."""
    aside: tuple[Part, ...]
    """Side branches on the way, held as well."""

    @property
    def tip(self) -> tuple[Part, ...]:
        """The end with all that hangs from it: a hand with its fingers, a foot."""
        return (self.end, *self.beyond)


@dataclass(frozen=True, eq=False)
class Limbs:
    """Where the limbs begin, and which way is up; sides are not told apart yet."""

    up: Float[np.ndarray, "3"]
    lateral: Float[np.ndarray, "3"]
    """From the second leg to the first, of unit length."""
    pelvis: Part
    torso: Part
    legs: tuple[Chain, ...]
    """Two; none of a robot of which the upper body alone is looked for."""
    arms: tuple[Chain, Chain]
    """In the order of the legs: the first arm is on the first leg's side."""


@dataclass(frozen=True, eq=False)
class _Pair:
    trunk: Part
    first: Part
    second: Part
    lateral: np.ndarray

    def holds(self, part: Part) -> bool:
        """Return whether a part is in one of the two."""
        return any(part is below for side in (self.first, self.second) for below in side.below())


def find_arms(pose: ZeroPose) -> Limbs:
    """Return the arms of a description whose base may be anything: the highest mirrored pair of limbs, z being up.

    Raises:
        Refused: It has no two arms; the message says what is there.
    """
    up = np.array(_UPS[0], dtype=float)
    level = [pair for pair in _pairs(pose) if abs(pair.lateral @ up) < 0.1]
    outer = [pair for pair in level if not any(other is not pair and other.holds(pair.trunk) for other in level)]
    pair = max(outer, key=lambda pair: float(_middle(pose, pair) @ up), default=None)
    if pair is None:
        raise Refused("no two arms: no mirrored pair of limbs with three joints or more hangs on one link.")
    found = Limbs(
        up, pair.lateral, pose.root, pair.trunk, (), (_arm_chain(pose, pair.first), _arm_chain(pose, pair.second))
    )
    _check_joints(pose, found)
    return found


def find_limbs(pose: ZeroPose) -> Limbs:
    """Return the limbs of a description in its zero pose.

    Raises:
        Refused: It has no two legs or no two arms; the message says what is there.
    """
    pairs = _pairs(pose)
    reasons: list[str] = []
    for axis in _UPS:
        up = np.array(axis, dtype=float)
        try:
            return _limbs(pose, pairs, up)
        except Refused as refusal:
            reasons.append(str(refusal))
    wheels = [pose.name(joint) for part in pose.parts for joint in part.hinges if "wheel" in pose.name(joint).lower()]
    if wheels:
        raise Refused(
            f"no legs: it stands on wheels ({', '.join(wheels[:3])}) and cannot follow standing feet. {_UPPER}"
        )
    raise Refused(next((reason for reason in reasons if not reason.startswith(_NOTHING)), reasons[0]))


def _limbs(pose: ZeroPose, pairs: Sequence[_Pair], up: np.ndarray) -> Limbs:
    level = [pair for pair in pairs if abs(pair.lateral @ up) < 0.1]
    legs = min(
        (pair for pair in level if _hangs(pose, pair, up)), key=lambda pair: _lowest(pose, pair, up), default=None
    )
    if legs is None:
        raise Refused(_no_legs(pose, level))
    hips = pose.anchors[legs.first.hinges[0]]
    others = [
        pair
        for pair in level
        if pair is not legs
        and not legs.holds(pair.trunk)
        and not pair.holds(legs.trunk)
        and abs(pair.lateral @ legs.lateral) > 0.98
        and abs((_middle(pose, pair) - _middle(pose, legs)) @ legs.lateral) < 2 * _MIRROR
    ]
    outer = [pair for pair in others if not any(other is not pair and other.holds(pair.trunk) for other in others)]
    arms = max(outer, key=lambda pair: pose.mass(pair.first), default=None)
    if arms is None:
        raise Refused(
            f"only one mirrored pair of limbs of three joints ({pose.name(legs.first.hinges[0])} ...): two legs "
            "and two arms are needed. Use the file of the whole robot."
        )
    if (pose.anchors[arms.first.hinges[0]] - hips) @ up <= 0:
        raise Refused("the limbs that reach lowest begin above the others: the zero pose is not upright.")
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
        ("legs", limbs.legs, _FEWEST_LEG, "a foot cannot be placed and turned with so few."),
        ("arms", limbs.arms, _FEWEST_ARM, "a hand cannot follow a person's with so few."),
    ):
        count = min((len(chain.hinges) for chain in chains), default=fewest)
        if count < fewest:
            names = ", ".join(pose.name(joint) for joint in min(chains, key=lambda chain: len(chain.hinges)).hinges)
            raise Refused(f"its {what} have only {count} joints ({names}): {why}")


def _pairs(pose: ZeroPose) -> list[_Pair]:
    """Return all pairs of sub-trees on one part whose first joints mirror each other."""
    pairs = []
    for part in pose.parts:
        children = [child for child in part.children if child.hinge_count >= _FEWEST]
        for index, first in enumerate(children):
            for second in children[index + 1 :]:
                lateral = pose.anchors[first.hinges[0]] - pose.anchors[second.hinges[0]]
                width = float(np.linalg.norm(lateral))
                if width > _MIRROR and _mirrored(pose, first, second, lateral / width):
                    pairs.append(_Pair(part, first, second, lateral / width))
    return pairs


def _mirrored(pose: ZeroPose, first: Part, second: Part, lateral: np.ndarray) -> bool:
    masses = pose.mass(first), pose.mass(second)
    if abs(first.hinge_count - second.hinge_count) > 1 or max(masses) > 1.5 * min(masses) + 0.05:
        return False
    middle = 0.5 * (pose.anchors[first.hinges[0]] + pose.anchors[second.hinges[0]])
    one, other = (_along(pose, side)[:_FEWEST] for side in (first, second))
    for a, b in zip(one, other, strict=False):
        # A joint's anchor may be anywhere along its axis: the mirrored axis passes near the other's anchor.
        away = pose.anchors[a] - middle
        image = middle + away - 2 * lateral * (lateral @ away)
        if pose.lever(image, b) > _MIRROR and np.linalg.norm(image - pose.anchors[b]) > _MIRROR:
            return False
    return True


def _along(pose: ZeroPose, part: Part) -> list[int]:
    """Return the hinges along the heaviest branch."""
    hinges: list[int] = []
    while True:
        hinges += part.hinges
        if not part.children:
            return hinges
        part = max(part.children, key=pose.mass)


def _middle(pose: ZeroPose, pair: _Pair) -> np.ndarray:
    return 0.5 * (pose.anchors[pair.first.hinges[0]] + pose.anchors[pair.second.hinges[0]])


def _reach(pose: ZeroPose, part: Part, up: np.ndarray) -> np.ndarray:
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
    return length > 0.1 and -float(way @ up) > _HANGING * length


def _no_legs(pose: ZeroPose, pairs: Sequence[_Pair]) -> str:
    if not pairs:
        return f"{_NOTHING} of limbs with three joints or more hangs on one link."
    heights = ", ".join(f"{pose.name(pair.first.hinges[0])} ..." for pair in pairs[:3])
    why = f"of the mirrored pairs of limbs ({heights}) none hangs down to the ground from where it begins"
    return f"no legs: {why}. {_UPPER}"


def _leg_chain(pose: ZeroPose, part: Part, up: np.ndarray) -> Chain:
    hinges, aside = list(part.hinges), []
    while part.children:
        lowest = min(part.children, key=lambda child: float(_reach(pose, child, up) @ up))
        aside += [other for child in part.children if child is not lowest for other in child.below()]
        part = lowest
        hinges += part.hinges
    return Chain(tuple(hinges), part, (), tuple(aside))


def _begins_fingers(pose: ZeroPose, heaviest: Part, others: Sequence[Part]) -> bool:
    """Return whether what hangs from a hand are fingers: several of a kind, or so called, or what others follow."""
    several = bool(others) and pose.mass(heaviest) < _ALIKE * pose.mass(others[0])
    followed = {one.other for one in pose.held}
    names = [pose.name(joint) for joint in heaviest.hinges]
    return several or any(_FINGER.search(name) or name in followed for name in names)


def _arm_chain(pose: ZeroPose, part: Part) -> Chain:
    hinges, aside = list(part.hinges), []
    while part.children:
        heaviest, *others = sorted(part.children, key=pose.mass, reverse=True)
        if len(hinges) >= _FEWEST_ARM and _begins_fingers(pose, heaviest, others):
            break
        aside += [other for child in part.children if child is not heaviest for other in child.below()]
        part = heaviest
        hinges += part.hinges
    beyond = tuple(other for child in part.children for other in child.below())
    return Chain(tuple(hinges), part, beyond, tuple(aside))
