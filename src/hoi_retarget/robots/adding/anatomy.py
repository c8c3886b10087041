"""What a description's joints and links are to a person: the sites of a robot, in its zero pose."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.adding.bends import Bend, find_bend, joint_centre, straight_angle
from hoi_retarget.robots.adding.description import Description
from hoi_retarget.robots.adding.facing import Facing, find_facing
from hoi_retarget.robots.adding.findings import Finding, Refused, hint_of_site
from hoi_retarget.robots.adding.hands import Arm, find_arm
from hoi_retarget.robots.adding.hints import Hints
from hoi_retarget.robots.adding.limbs import Chain, Limbs, find_limbs
from hoi_retarget.robots.adding.mirrored_ranges import range_findings
from hoi_retarget.robots.adding.soles import Sole, find_sole
from hoi_retarget.robots.adding.zero_pose import Part, ZeroPose, zero_pose
from hoi_retarget.robots.spec import SIDES, SOLE_CORNERS

STATURE_BY_LEG = 2.0
"""Stature over hip height. People's is 2.03 to 2.06: with less knees bend, with as much motions jerk more."""
_MOST_NECK_JOINTS = 3
_PELVIS = 0.055
"""A person's pelvis joint lies above the hips by this share of the stature."""
_EYES = 0.06
"""Of the stature, under the top of the head."""
_CHEST = 0.7
"""Share of the way from the hips to the shoulders."""
_LEAST_HEAD, _USUAL_HEAD = 0.05, 0.17
"""Of the stature, above the shoulders: a head without a shape has the usual height."""
_WIDEST, _SHORTEST, _TILTED = 0.18, 0.06, 12.0
"""Soles beyond these are doubtful [m, m, deg]."""
_LOCK = 'lock = ["JOINT", ...]'
_MIRROR = 0.005
"""Left and right are mirror images within this [m]."""


@dataclass(frozen=True, eq=False)
class PlacedSite:
    """A site in the zero pose, in world axes."""

    part: Part
    position: Float[np.ndarray, "3"]
    """[m]"""
    rotation: Float[np.ndarray, "3 3"]


@dataclass(frozen=True, eq=False)
class Leg:
    """One leg in the zero pose."""

    chain: Chain
    knee: Bend
    ankle: Float[np.ndarray, "3"]
    """In world axes [m]."""
    sole: Sole

    @property
    def length(self) -> float:
        """Height of the hip when the leg is straight [m]."""
        thigh, shank = self.knee.top - self.knee.middle, self.knee.middle - self.ankle
        return float(np.linalg.norm(thigh) + np.linalg.norm(shank)) - self.sole.bottom


@dataclass(frozen=True, eq=False)
class Anatomy:
    """A description understood."""

    pose: ZeroPose
    facing: Facing
    sites: Mapping[str, PlacedSite]
    arms: tuple[Arm, Arm]
    """Left and right."""
    stature: float
    """[m]"""
    findings: tuple[Finding, ...]


def find_anatomy(description: Description, hints: Hints) -> Anatomy:
    """Return what a description's joints and links are.

    Raises:
        Refused: It is no humanoid that can be retargeted to; the message says why.
    """
    pose = zero_pose(description, hints.lock)
    limbs = find_limbs(pose)
    spare = spare_joints(pose, limbs)
    if spare:
        pose = zero_pose(description, (*hints.lock, *spare))
        limbs = find_limbs(pose)
    first = _knees(pose, limbs, ("", ""))
    ankles = [_ankle(pose, chain, knee) for chain, knee in zip(limbs.legs, first, strict=True)]
    facing = find_facing(pose, limbs, first, ankles, hints.ahead)
    if not facing.first_is_left:
        limbs = replace(limbs, legs=limbs.legs[::-1], arms=limbs.arms[::-1])
    knees = _knees(pose, limbs, (hints.left.knee, hints.right.knee))
    legs = [_leg(pose, facing, chain, knee) for chain, knee in zip(limbs.legs, knees, strict=True)]
    arms = [
        find_arm(pose, chain, facing.axes[:, 0], inward, named=limb.elbow, roll=np.radians(hints.hand_roll))
        for chain, inward, limb in zip(limbs.arms, (-1, 1), (hints.left, hints.right), strict=True)
    ]
    height = float(np.mean([leg.length for leg in legs]))
    stature = hints.stature or STATURE_BY_LEG * height
    hips, shoulders = (
        0.5 * (first + second)
        for first, second in ((legs[0].knee.top, legs[1].knee.top), (arms[0].bend.top, arms[1].bend.top))
    )
    sites = dict(trunk_sites(pose, limbs, facing, hips, shoulders, stature=stature))
    for index, side in enumerate(SIDES):
        sites |= {f"{side}_{name}": site for name, site in _leg_sites(pose, facing, legs[index], side)}
        sites |= {f"{side}_{name}": site for name, site in arm_sites(pose, limbs.arms[index], arms[index])}
    what = f"{stature:.2f} m; the hips are {height:.2f} m high, of which {STATURE_BY_LEG} is taken"
    findings = (
        *description.findings,
        *(finding for side, leg in zip(SIDES, legs, strict=True) for finding in _leg_findings(pose, side, leg)),
        *(
            finding
            for side, chain, arm in zip(SIDES, limbs.arms, arms, strict=True)
            for finding in arm_findings(pose, side, chain, arm)
        ),
        facing.finding,
        *_mirror_findings(sites, facing),
        *(
            finding
            for left, right in (limbs.legs, limbs.arms)
            for finding in range_findings(pose, left.hinges, right.hinges, facing.axes[:, 1])
        ),
        Finding("ok", "stature", what, "stature = NUMBER"),
        *_held_findings(pose),
    )
    return Anatomy(pose, facing, sites, (arms[0], arms[1]), stature, findings)


def check_names(description: Description, hints: Hints) -> None:
    """Raise `Refused` where hints name joints that a description has not."""
    compiled = description.compiled
    there = {compiled.joint(joint).name for joint in range(compiled.njnt)}
    asked = {*hints.lock, *hints.speed, *hints.range} - {"default"}
    asked |= {name for limb in (hints.left, hints.right) for name in (limb.knee, limb.elbow) if name}
    if unknown := sorted(asked - there):
        raise Refused(
            f"the hints name joints that are not there: {', '.join(unknown)}. There are: {', '.join(sorted(there))}."
        )


def spare_joints(pose: ZeroPose, limbs: Limbs) -> list[str]:
    """Return joints of no limb, waist or neck: fingers, eyes, tails, wheels."""
    kept = {joint for chain in (*limbs.legs, *limbs.arms) for joint in chain.hinges}
    ways = [_way_up(part) for part in (limbs.pelvis, limbs.torso)]
    waist = [part for way, other in (ways, ways[::-1]) for part in way if part not in other]
    kept |= {joint for part in (*waist, *_neck(pose, limbs)) for joint in part.hinges}
    # What carries both pelvis and torso moves them together.
    kept |= {joint for part in ways[0] if part in ways[1] for joint in part.hinges}
    return [pose.name(joint) for part in pose.parts for joint in part.hinges if joint not in kept]


def _way_up(part: Part) -> list[Part]:
    way = [part]
    while part.parent is not None:
        part = part.parent
        way.append(part)
    return way


def _neck(pose: ZeroPose, limbs: Limbs) -> list[Part]:
    """Return the parts of the heaviest chain above the shoulders, at most three joints long."""
    taken = {id(part) for part in (*_way_up(limbs.pelvis), *_way_up(limbs.torso))}
    begins = {joint for chain in (*limbs.arms, *limbs.legs) for joint in chain.hinges[:1]}
    neck: list[Part] = []
    part, joints = limbs.torso, 0
    while True:
        next_ones = [child for child in part.children if id(child) not in taken and not begins & set(child.hinges)]
        next_ones = [child for child in next_ones if joints + len(child.hinges) <= _MOST_NECK_JOINTS]
        if not next_ones:
            return neck
        part = max(next_ones, key=pose.mass)
        joints += len(part.hinges)
        neck.append(part)


def _knees(pose: ZeroPose, limbs: Limbs, named: tuple[str, str]) -> tuple[Bend, Bend]:
    first, second = (
        find_bend(pose, chain.hinges, pose.anchors[chain.hinges[-1]] - 0.02 * limbs.up, "knee", name)
        for chain, name in zip(limbs.legs, named, strict=True)
    )
    return first, second


def _ankle(pose: ZeroPose, chain: Chain, knee: Bend) -> Float[np.ndarray, "3"]:
    """Return the centre of the joints after the knee; of a single one, the point of its axis abreast of the knee."""
    after = list(chain.hinges[knee.place + 1 :])
    if not after:
        raise Refused(f"no ankle: no joint follows the knee {pose.name(knee.joint)!r}.")
    if len(after) > 1:
        return joint_centre(pose, after)
    axis, anchor = pose.axes[after[0]], pose.anchors[after[0]]
    return anchor + axis * (axis @ (knee.middle - anchor))


def _leg(pose: ZeroPose, facing: Facing, chain: Chain, knee: Bend) -> Leg:
    axes, ankle = facing.axes, _ankle(pose, chain, knee)
    points = (pose.points(*chain.tip, meshes_only=True) - ankle) @ axes
    shank = (ankle - knee.middle) @ axes
    length = float(np.linalg.norm(knee.top - knee.middle) + np.linalg.norm(shank))
    sole = find_sole(points, shank / np.linalg.norm(shank), _leftwards(pose, facing, knee.joint) @ axes, length)
    return Leg(chain, knee, ankle, sole)


def _leftwards(pose: ZeroPose, facing: Facing, joint: int) -> np.ndarray:
    axis = pose.axes[joint]
    return axis if axis @ facing.axes[:, 1] > 0 else -axis


def trunk_sites(  # noqa: PLR0913 - all limbs hang on it
    pose: ZeroPose,
    limbs: Limbs,
    facing: Facing,
    hips: Float[np.ndarray, "3"],
    shoulders: Float[np.ndarray, "3"],
    *,
    stature: float,
) -> Iterator[tuple[str, PlacedSite]]:
    """Yield pelvis, torso and head, from the middles of hips and shoulders [m]."""
    axes = facing.axes
    up = axes[:, 2]
    yield "pelvis", PlacedSite(limbs.pelvis, hips + _PELVIS * stature * up, axes)
    yield "torso", PlacedSite(limbs.torso, hips + _CHEST * (shoulders - hips), axes)
    neck = _neck(pose, limbs)
    head = neck[-1] if neck else limbs.torso
    heights = (pose.points(head) - shoulders) @ up
    top = float(heights.max(initial=0.0))
    top = top if top > _LEAST_HEAD * stature else _USUAL_HEAD * stature
    yield "head", PlacedSite(head, hips + up * ((shoulders - hips) @ up + top - _EYES * stature), axes)


def _leg_sites(pose: ZeroPose, facing: Facing, leg: Leg, side: str) -> Iterator[tuple[str, PlacedSite]]:
    left, knee = _leftwards(pose, facing, leg.knee.joint), leg.knee
    yield "hip", PlacedSite(_mover(pose, leg.chain, knee.place - 1), knee.top, _upright(knee.top - knee.middle, left))
    yield "knee", PlacedSite(_mover(pose, leg.chain, knee.place), knee.middle, _upright(knee.middle - leg.ankle, left))
    rotation, end = facing.axes @ leg.sole.rotation, leg.chain.end
    yield "foot", PlacedSite(end, leg.ankle, rotation)
    yield "toe", PlacedSite(end, leg.ankle + facing.axes @ leg.sole.ball, rotation)
    for corner in SOLE_CORNERS:
        yield f"sole_{corner}", PlacedSite(end, leg.ankle + facing.axes @ leg.sole.corner(corner, side), rotation)


def _mover(pose: ZeroPose, chain: Chain, place: int) -> Part:
    """Return the part that a hinge of a chain moves."""
    return pose.part_of(int(pose.compiled.jnt_bodyid[chain.hinges[place]]))


def _upright(z: np.ndarray, left: np.ndarray) -> Float[np.ndarray, "3 3"]:
    z = z - left * (left @ z)
    z = z / np.linalg.norm(z)
    return np.stack([np.cross(left, z), left, z], axis=1)


def arm_sites(pose: ZeroPose, chain: Chain, arm: Arm) -> Iterator[tuple[str, PlacedSite]]:
    """Yield the sites of one arm, without the side in their names."""
    yield "shoulder", PlacedSite(_mover(pose, chain, arm.bend.place - 1), arm.bend.top, arm.upper)
    yield "elbow", PlacedSite(_mover(pose, chain, arm.bend.place), arm.bend.middle, arm.fore)
    yield "wrist", PlacedSite(chain.end, arm.wrist, arm.hand)
    yield "palm", PlacedSite(chain.end, arm.palm, arm.hand)


def _leg_findings(pose: ZeroPose, side: str, leg: Leg) -> Iterator[Finding]:
    sole = leg.sole
    yield Finding("ok", f"{side} leg", _named_chain(pose, leg.chain), _LOCK)
    straight, _, _ = straight_angle(pose, leg.knee, leg.ankle)
    yield _bend_finding(pose, side, "knee", leg.knee, straight)
    length, width = sole.toe - sole.heel, sole.left - sole.right
    odd = not sole.measured or length < _SHORTEST or width > _WIDEST or sole.tilt_deg > _TILTED
    by = f"tilted by {sole.tilt_deg:.0f} deg in the zero pose" if sole.measured else "by proportion: no shape, no size"
    what = f"{1000 * length:.0f} x {1000 * width:.0f} mm, {-1000 * sole.bottom:.0f} mm under the ankle, {by}"
    yield Finding("warn" if odd else "ok", f"{side} sole", what, "" if sole.measured else "--meshes DIR")


def arm_findings(pose: ZeroPose, side: str, chain: Chain, arm: Arm) -> Iterator[Finding]:
    """Yield what one arm was taken for."""
    yield Finding("ok", f"{side} arm", _named_chain(pose, chain), _LOCK)
    yield _bend_finding(pose, side, "elbow", arm.bend, arm.straight)
    turns = {3: "turn the palm freely", 2: "turn the palm about two axes", 1: "turn the palm about one axis"}
    what = f"{len(arm.beyond)} joints after the elbow {turns.get(arm.free_turns, 'turn the palm not at all')}"
    if not arm.measured:
        what += "; its length is by proportion: no shape"
    yield Finding("ok" if arm.measured else "warn", f"{side} hand", what, "hand_roll = DEGREES")


def _named_chain(pose: ZeroPose, chain: Chain) -> str:
    return f"{pose.name(chain.hinges[0])} ... {pose.name(chain.hinges[-1])}, {len(chain.hinges)} joints"


def _bend_finding(pose: ZeroPose, side: str, called: str, bend: Bend, straight: float) -> Finding:
    doubt = "" if bend.is_sure else f", next best {1000 * bend.next_lever:.0f} mm: not sure"
    what = f"{pose.name(bend.joint)}, lever {1000 * bend.lever:.0f} mm{doubt}, straight at {straight:.2f} rad"
    return Finding("ok" if bend.is_sure else "warn", f"{side} {called}", what, f'{side}.{called} = "JOINT"')


def _mirror_findings(sites: Mapping[str, PlacedSite], facing: Facing) -> Iterator[Finding]:
    """Left and right are found independently: where they differ, a mesh or a joint is not what it seems."""
    flip = np.eye(3) - 2 * np.outer(facing.axes[:, 1], facing.axes[:, 1])
    origin = sites["pelvis"].position
    worst = {
        name.removeprefix("left_"): float(
            np.linalg.norm(origin + flip @ (site.position - origin) - sites[name.replace("left_", "right_")].position)
        )
        for name, site in sites.items()
        if name.startswith("left_")
    }
    name = max(worst, key=lambda site: worst[site])
    if worst[name] > _MIRROR:
        yield Finding(
            "warn",
            "mirror",
            f"left and right {name} are {1000 * worst[name]:.0f} mm from being mirror images",
            hint_of_site(f"left_{name}"),
        )


def _held_findings(pose: ZeroPose) -> Iterator[Finding]:
    if pose.held:
        names = [one.joint for one in pose.held]
        shown = ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
        yield Finding("ok", "held joints", f"{len(names)} do not move on their own ({shown})", _LOCK)
