"""The morphology of a description: its joints and links assigned to a person's, and the sites, in its zero pose."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.adding.arms import Arm, find_arm
from hoi_retarget.robots.adding.description import Description, finite_range
from hoi_retarget.robots.adding.findings import Hints, RobotFinding, UnsuitableRobotError, hint_of_site
from hoi_retarget.robots.adding.forward_axis import TrunkAxes, find_forward_axis
from hoi_retarget.robots.adding.hands import Finger, find_fingers, finger_joints
from hoi_retarget.robots.adding.kinematic_chains import BendJoint, KinematicChain, Limbs, find_limbs, straight_angle
from hoi_retarget.robots.adding.legs import Leg, find_ankle, find_knees, find_leg, leftwards
from hoi_retarget.robots.adding.zero_pose import LimbPart, ZeroPose, zero_pose
from hoi_retarget.robots.spec import SIDES, SOLE_CORNERS, HeldJoint

STATURE_BY_LEG = 2.0
"""Stature over hip height. People's is 2.03 to 2.06: with less knees bend, with as much motions jerk more."""
_MAX_NECK_JOINTS = 3
_PELVIS = 0.055  # A person's pelvis joint lies above the hips by this share of the stature.
_EYES = 0.06  # Of the stature, under the top of the head.
_CHEST = 0.7  # Share of the way from the hips to the shoulders.
_MIN_HEAD, _USUAL_HEAD = 0.05, 0.17  # Of the stature, above the shoulders: a head without a shape has the usual height.
_MAX_WIDTH, _MIN_SOLE_LENGTH, _MAX_TILT = 0.18, 0.06, 12.0  # Soles beyond these are doubtful [m, m, deg].
_LOCK = 'lock = ["JOINT", ...]'
_MIRROR_TOLERANCE = 0.005  # Left and right are mirror images within this [m].
_PARALLEL = 0.95
_RANGE_TOLERANCE = 0.2  # Ends of mirrored ranges may differ by this [rad].


@dataclass(frozen=True, eq=False)
class PlacedSite:
    """A site in the zero pose, in world axes."""

    part: LimbPart
    position: Float[np.ndarray, "3"]  # [m]
    rotation: Float[np.ndarray, "3 3"]


@dataclass(frozen=True, eq=False)
class Morphology:
    """The joints and links of a description, assigned to a person's."""

    pose: ZeroPose
    trunk: TrunkAxes
    sites: Mapping[str, PlacedSite]
    arms: tuple[Arm, Arm]  # Left and right.
    stature: float  # [m]
    findings: tuple[RobotFinding, ...]
    fingers: Mapping[str, Finger] = field(default_factory=dict)  # By the human finger that each follows.
    couplings: tuple[HeldJoint, ...] = ()  # What of the robot's mechanism motions do not carry.


def find_morphology(description: Description, hints: Hints) -> Morphology:
    """Return the morphology of a humanoid with legs; raises `UnsuitableRobotError` where it cannot be retargeted to."""
    pose, limbs = pose_and_limbs(description, hints, find_limbs)
    first = find_knees(pose, limbs, ("", ""))
    ankles = [find_ankle(pose, chain, knee) for chain, knee in zip(limbs.legs, first, strict=True)]
    trunk = find_forward_axis(pose, limbs, first, ankles, hints.ahead)
    if not trunk.first_is_left:
        limbs = replace(limbs, legs=limbs.legs[::-1], arms=limbs.arms[::-1])
    knees = find_knees(pose, limbs, (hints.left.knee, hints.right.knee))
    legs = [find_leg(pose, trunk, chain, knee) for chain, knee in zip(limbs.legs, knees, strict=True)]
    arms = find_both_arms(pose, limbs, trunk, hints)
    height = float(np.mean([leg.length for leg in legs]))
    stature = hints.stature or STATURE_BY_LEG * height
    hips, shoulders = (
        0.5 * (first + second)
        for first, second in ((legs[0].knee.top, legs[1].knee.top), (arms[0].elbow.top, arms[1].elbow.top))
    )
    sites = dict(trunk_sites(pose, limbs, trunk, hips, shoulders, stature=stature))
    for side, leg in zip(SIDES, legs, strict=True):
        sites |= {f"{side}_{name}": site for name, site in _leg_sites(pose, trunk, leg, side)}
    sites |= arm_sites(pose, limbs, arms)
    fingers = find_fingers(pose, limbs, arms) if hints.fingers else {}
    sites |= {name: PlacedSite(finger.part, finger.pad, finger.rotation) for name, finger in fingers.items()}
    driven = {pose.name(joint) for chain in limbs.arms for joint in finger_joints(chain)}
    following = [one for one in pose.loose if one.other in driven]
    couplings = (*pose.loose, *_broken_couplings(pose, limbs), *_passive_joints(pose, driven))
    what = f"{stature:.2f} m; the hips are {height:.2f} m high, of which {STATURE_BY_LEG} is taken"
    findings = (
        *description.findings,
        *(finding for side, leg in zip(SIDES, legs, strict=True) for finding in _leg_findings(pose, side, leg)),
        *arm_findings(pose, limbs, arms),
        trunk.finding,
        *(finding for name, finger in fingers.items() for finding in finger.findings(pose, name)),
        *_mirror_findings(sites, trunk),
        *(
            finding
            for left, right in (limbs.legs, limbs.arms)
            for finding in _range_findings(pose, left.hinges, right.hinges, trunk.axes[:, 1])
        ),
        RobotFinding("ok", "stature", what, "stature = NUMBER"),
        *_held_findings(pose),
        *_endless_findings(pose),
        *_coupling_findings([one for one in couplings if one not in following]),
    )
    return Morphology(pose, trunk, sites, arms, stature, findings, fingers, couplings)


def pose_and_limbs(description: Description, hints: Hints, find: Callable[[ZeroPose], Limbs]) -> tuple[ZeroPose, Limbs]:
    """Return the zero pose in which joints of no limb, waist or neck are held, and the limbs; raises as `find`."""
    pose = zero_pose(description, hints.lock)
    limbs = find(pose)
    kept = [pose.name(joint) for chain in limbs.arms for joint in finger_joints(chain)] if hints.fingers else []
    following = [one.joint for one in pose.held if one.other in kept]
    spare = [name for joint in _spare_joints(pose, limbs) if (name := pose.name(joint)) not in kept]
    if spare or following:
        pose = zero_pose(description, (*hints.lock, *spare), following)
        limbs = find(pose)
    return pose, limbs


def find_both_arms(pose: ZeroPose, limbs: Limbs, trunk: TrunkAxes, hints: Hints) -> tuple[Arm, Arm]:
    """Return the left and the right arm.

    Raises `UnsuitableRobotError` where an arm has no elbow.

    `pose`: the zero pose; `limbs`: its limbs, the left arm first; `trunk`: the trunk's axes; `hints`: they may name the
    elbows, and turn the hands.
    """
    left, right = (
        find_arm(pose, chain, trunk.axes[:, 0], inward, named=limb.elbow, roll=np.radians(hints.hand_roll))
        for chain, inward, limb in zip(limbs.arms, (-1, 1), (hints.left, hints.right), strict=True)
    )
    return left, right


def check_names(description: Description, hints: Hints) -> None:
    """Raise `UnsuitableRobotError` where hints name joints that are not in a description."""
    compiled = description.compiled
    there = {compiled.joint(joint).name for joint in range(compiled.njnt)}
    names = {*hints.lock, *hints.speed, *hints.range, *hints.motor} - {"default"}
    names |= {name for limb in (hints.left, hints.right) for name in (limb.knee, limb.elbow) if name}
    if unknown := sorted(names - there):
        raise UnsuitableRobotError(
            f"the hints name joints that are not there: {', '.join(unknown)}. There are: {', '.join(sorted(there))}."
        )


def _spare_joints(pose: ZeroPose, limbs: Limbs) -> list[int]:
    """Return the joints of no limb, waist or neck: fingers, eyes, tails, wheels."""
    limb_joints = {joint for chain in (*limbs.legs, *limbs.arms) for joint in chain.hinges}
    # The waist, and parts that carry both pelvis and torso and move them together.
    carriers = (*_ancestors(limbs.pelvis), *_ancestors(limbs.torso))
    limb_joints |= {joint for part in (*carriers, *_neck(pose, limbs)) for joint in part.hinges}
    return [joint for part in pose.parts for joint in part.hinges if joint not in limb_joints]


def _ancestors(part: LimbPart | None) -> Iterator[LimbPart]:
    """Yield a part and all that carry it."""
    while part is not None:
        yield part
        part = part.parent


def _neck(pose: ZeroPose, limbs: Limbs) -> list[LimbPart]:
    """Return the parts of the heaviest chain above the shoulders, at most three joints long."""
    taken = {id(part) for part in (*_ancestors(limbs.pelvis), *_ancestors(limbs.torso))}
    begins = {joint for chain in (*limbs.arms, *limbs.legs) for joint in chain.hinges[:1]}
    neck: list[LimbPart] = []
    part, joints = limbs.torso, 0
    while True:
        next_ones = [child for child in part.children if id(child) not in taken and not begins & set(child.hinges)]
        next_ones = [child for child in next_ones if joints + len(child.hinges) <= _MAX_NECK_JOINTS]
        if not next_ones:
            return neck
        part = max(next_ones, key=pose.mass)
        joints += len(part.hinges)
        neck.append(part)


def trunk_sites(  # noqa: PLR0913  # poses, axes and the two middles of one trunk
    pose: ZeroPose,
    limbs: Limbs,
    trunk: TrunkAxes,
    hips: Float[np.ndarray, "3"],
    shoulders: Float[np.ndarray, "3"],
    *,
    stature: float,
) -> Iterator[tuple[str, PlacedSite]]:
    """Yield the sites of pelvis, torso and head.

    Args: `pose`: the zero pose; `limbs`: its limbs; `trunk`: the trunk's axes; `hips`: the middle between the hips [m];
    `shoulders`: that between the shoulders [m]; `stature`: the stature [m].
    """
    axes = trunk.axes
    up = axes[:, 2]
    yield "pelvis", PlacedSite(limbs.pelvis, hips + _PELVIS * stature * up, axes)
    yield "torso", PlacedSite(limbs.torso, hips + _CHEST * (shoulders - hips), axes)
    neck = _neck(pose, limbs)
    head = neck[-1] if neck else limbs.torso
    heights = (pose.points(head) - shoulders) @ up
    top = float(heights.max(initial=0.0))
    top = top if top > _MIN_HEAD * stature else _USUAL_HEAD * stature
    yield "head", PlacedSite(head, hips + up * ((shoulders - hips) @ up + top - _EYES * stature), axes)


def _leg_sites(pose: ZeroPose, trunk: TrunkAxes, leg: Leg, side: str) -> Iterator[tuple[str, PlacedSite]]:
    left, knee = leftwards(pose, trunk, leg.knee.joint), leg.knee
    thigh, shank = (_moved_part(pose, leg.chain, place) for place in (knee.place - 1, knee.place))
    yield "hip", PlacedSite(thigh, knee.top, _upright(knee.top - knee.middle, left))
    yield "knee", PlacedSite(shank, knee.middle, _upright(knee.middle - leg.ankle, left))
    rotation, end = trunk.axes @ leg.sole.rotation, leg.chain.end
    yield "foot", PlacedSite(end, leg.ankle, rotation)
    yield "toe", PlacedSite(end, leg.ankle + trunk.axes @ leg.sole.ball, rotation)
    for corner in SOLE_CORNERS:
        yield f"sole_{corner}", PlacedSite(end, leg.ankle + trunk.axes @ leg.sole.corner(corner, side), rotation)


def _moved_part(pose: ZeroPose, chain: KinematicChain, place: int) -> LimbPart:
    """Return the part moved by a hinge of a chain."""
    return pose.part_of(int(pose.compiled.jnt_bodyid[chain.hinges[place]]))


def _upright(z: np.ndarray, left: np.ndarray) -> Float[np.ndarray, "3 3"]:
    z = z - left * (left @ z)
    z = z / np.linalg.norm(z)
    return np.stack([np.cross(left, z), left, z], axis=1)


def arm_sites(pose: ZeroPose, limbs: Limbs, arms: tuple[Arm, Arm]) -> dict[str, PlacedSite]:
    """Return the sites of both arms by name."""
    sites: dict[str, PlacedSite] = {}
    for side, chain, arm in zip(SIDES, limbs.arms, arms, strict=True):
        elbow = arm.elbow
        sites |= {
            f"{side}_shoulder": PlacedSite(_moved_part(pose, chain, elbow.place - 1), elbow.top, arm.upper),
            f"{side}_elbow": PlacedSite(_moved_part(pose, chain, elbow.place), elbow.middle, arm.fore),
            f"{side}_wrist": PlacedSite(chain.end, arm.wrist, arm.hand),
            f"{side}_palm": PlacedSite(chain.end, arm.palm, arm.hand),
        }
    return sites


def _leg_findings(pose: ZeroPose, side: str, leg: Leg) -> Iterator[RobotFinding]:
    sole = leg.sole
    yield RobotFinding("ok", f"{side} leg", _named_chain(pose, leg.chain), _LOCK)
    straight, _, _ = straight_angle(pose, leg.knee, leg.ankle)
    yield _bend_finding(pose, side, "knee", leg.knee, straight)
    length, width = sole.toe - sole.heel, sole.left - sole.right
    odd = not sole.measured or length < _MIN_SOLE_LENGTH or width > _MAX_WIDTH or sole.tilt_deg > _MAX_TILT
    by = f"tilted by {sole.tilt_deg:.0f} deg in the zero pose" if sole.measured else "by proportion: no shape, no size"
    if not sole.exists:
        odd, by = True, "which is no sole: the foot ends in a point, an edge or a gripper, and cannot stand on it"
    what = f"{1000 * length:.0f} x {1000 * width:.0f} mm, {-1000 * sole.bottom:.0f} mm under the ankle, {by}"
    yield RobotFinding("warn" if odd else "ok", f"{side} sole", what, "" if sole.measured else "--meshes DIR")


def arm_findings(pose: ZeroPose, limbs: Limbs, arms: tuple[Arm, Arm]) -> Iterator[RobotFinding]:
    """Yield the findings about chain, elbow and hand of both arms."""
    turns = {3: "turn the palm freely", 2: "turn the palm about two axes", 1: "turn the palm about one axis"}
    for side, chain, arm in zip(SIDES, limbs.arms, arms, strict=True):
        yield RobotFinding("ok", f"{side} arm", _named_chain(pose, chain), _LOCK)
        yield _bend_finding(pose, side, "elbow", arm.elbow, arm.straight)
        what = f"{len(arm.beyond)} joints after the elbow {turns.get(arm.free_turns, 'turn the palm not at all')}"
        if not arm.measured:
            what += "; its length is by proportion: no shape"
        yield RobotFinding("ok" if arm.measured else "warn", f"{side} hand", what, "hand_roll = DEGREES")
        if arm.elbow.place < 3:
            what = f"{arm.elbow.place} joints before the elbow: it bends in one plane, some places are out of reach"
            yield RobotFinding("warn", f"{side} arm", what, _LOCK)


def _named_chain(pose: ZeroPose, chain: KinematicChain) -> str:
    return f"{pose.name(chain.hinges[0])} ... {pose.name(chain.hinges[-1])}, {len(chain.hinges)} joints"


def _bend_finding(pose: ZeroPose, side: str, called: str, bend: BendJoint, straight: float) -> RobotFinding:
    doubt = "" if bend.is_sure else f", next best {1000 * bend.next_lever:.0f} mm: not sure"
    what = f"{pose.name(bend.joint)}, lever {1000 * bend.lever:.0f} mm{doubt}, straight at {straight:.2f} rad"
    return RobotFinding("ok" if bend.is_sure else "warn", f"{side} {called}", what, f'{side}.{called} = "JOINT"')


def _mirror_findings(sites: Mapping[str, PlacedSite], trunk: TrunkAxes) -> Iterator[RobotFinding]:
    """Yield a warning where left and right, which are found independently, are no mirror images."""
    flip = np.eye(3) - 2 * np.outer(trunk.axes[:, 1], trunk.axes[:, 1])
    origin = sites["pelvis"].position
    worst = {
        name.removeprefix("left_"): float(
            np.linalg.norm(origin + flip @ (site.position - origin) - sites[name.replace("left_", "right_")].position)
        )
        for name, site in sites.items()
        if name.startswith("left_")
    }
    name = max(worst, key=lambda site: worst[site])
    if worst[name] > _MIRROR_TOLERANCE:
        yield RobotFinding(
            "warn",
            "mirror",
            f"left and right {name} are {1000 * worst[name]:.0f} mm from being mirror images",
            hint_of_site(f"left_{name}"),
        )


def _held_findings(pose: ZeroPose) -> Iterator[RobotFinding]:
    if pose.held:
        names = [one.joint for one in pose.held]
        shown = ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
        yield RobotFinding("ok", "held joints", f"{len(names)} do not move on their own ({shown})", _LOCK)


def _endless_findings(pose: ZeroPose) -> Iterator[RobotFinding]:
    """Yield the joints of which no range is known: those that state none, and those that state an empty one."""
    endless = [joint for part in pose.parts for joint in part.hinges if finite_range(pose.compiled, joint) is None]
    states = {
        joint: bool(pose.compiled.jnt_limited[joint] or pose.compiled.jnt_range[joint].any()) for joint in endless
    }
    for stated in (False, True):
        if names := [pose.name(joint) for joint in endless if states[joint] is stated]:
            why = "an empty range" if stated else "no range"
            what = f"{why} in the file, -180 to 180 deg is taken: {', '.join(names)}"
            yield RobotFinding("warn" if stated else "ok", "ranges", what, f"range.{names[0]} = [LOWER, UPPER]")


def _broken_couplings(pose: ZeroPose, limbs: Limbs) -> Iterator[HeldJoint]:
    """Yield moving joints that a held joint of a limb follows on the robot."""
    moving = {pose.name(joint) for part in pose.parts for joint in part.hinges}
    above = pose.compiled.body_parentid
    on_limbs = {0}
    for chain in (*limbs.legs, *limbs.arms):
        body = chain.end.body
        while body not in on_limbs:
            on_limbs.add(body)
            body = int(above[body])
    for one in pose.held:
        if one.other in moving and int(pose.compiled.joint(one.joint).bodyid[0]) in on_limbs:
            yield HeldJoint(one.other, "", 0.0, pose.zero_angle(pose.compiled.joint(one.other).id))


def _passive_joints(pose: ZeroPose, fingers: Collection[str]) -> Iterator[HeldJoint]:
    # A file that gives no finger an effort leaves that of hands open.
    passive = set(pose.description.passive)
    passive -= passive & set(fingers) if passive.issuperset(fingers) else set()
    for part in pose.parts:
        for joint in part.hinges:
            if pose.name(joint) in passive:
                yield HeldJoint(pose.name(joint), "", 0.0, pose.zero_angle(joint))


def _coupling_findings(couplings: Sequence[HeldJoint]) -> Iterator[RobotFinding]:
    for one in couplings:
        why = f"is coupled to {one.other}" if one.other else "has no drive of its own, or moves a held joint along"
        what = f"{one.joint} {why}; here it moves on its own, and motions fail where that shows"
        yield RobotFinding("warn", "coupled joints", what, f'lock = ["{one.joint}"]')


def _range_findings(
    pose: ZeroPose, left: Sequence[int], right: Sequence[int], leftwards: Float[np.ndarray, "3"]
) -> Iterator[RobotFinding]:
    """Yield the joints of two limbs with ranges that are no mirror images: axes were mirrored, and limits were not."""
    for one, other in zip(left, right, strict=False):
        mirrored = 2.0 * (pose.axes[one] @ leftwards) * leftwards - pose.axes[one]
        same = float(mirrored @ pose.axes[other])
        ranges = finite_range(pose.compiled, one), finite_range(pose.compiled, other)
        if abs(same) < _PARALLEL or ranges[0] is None or ranges[1] is None:
            continue
        zeros = pose.zero_angle(one), pose.zero_angle(other)
        here, there = np.array(ranges[0]) - zeros[0], np.array(ranges[1]) - zeros[1]
        as_here, as_there = (np.sort(np.sign(same) * ends) for ends in (here, there))
        if np.abs(as_here - there).max() > _RANGE_TOLERANCE:
            names = pose.name(one), pose.name(other)
            listed = " and ".join(
                f"{name} {lower:.0f} to {upper:.0f} deg"
                for name, (lower, upper) in zip(names, np.degrees([here, there]), strict=True)
            )
            what = f"{listed} are no mirror images: one side cannot do what the other does"
            mirrored_ends = as_there + zeros[0], as_here + zeros[1]
            hint = "  # or ".join(
                f"range.{name} = [{lower:.4g}, {upper:.4g}]"
                for name, (lower, upper) in zip(names, mirrored_ends, strict=True)
            )
            yield RobotFinding("warn", "ranges", what, hint)
