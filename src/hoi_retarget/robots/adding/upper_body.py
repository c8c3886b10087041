"""Robots of which only the upper body follows a person, on a base that stays or follows: no leg is looked for.

What carries the trunk, wheels, lifts or legs, is held. The sites of legs are put where a person's would be, on the
root link: nothing follows with them.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.adding.anatomy import Anatomy, PlacedSite, arm_findings, arm_sites, spare_joints, trunk_sites
from hoi_retarget.robots.adding.description import Description
from hoi_retarget.robots.adding.facing import Facing, find_facing
from hoi_retarget.robots.adding.findings import Finding
from hoi_retarget.robots.adding.hands import Arm, find_arm
from hoi_retarget.robots.adding.hints import Hints
from hoi_retarget.robots.adding.home_pose import home_goals
from hoi_retarget.robots.adding.limbs import find_arms
from hoi_retarget.robots.adding.zero_pose import ZeroPose, zero_pose
from hoi_retarget.robots.spec import SIDES

_SHOULDERS, _ARM = 0.82, 0.30
"""Of a person's stature: how high the shoulders are, and how long arms are without hands."""
_NO_STAND = 0.35
"""Shoulders lower than this share of where arms of that length have them: the file lacks what they stand on."""
_LEG = {
    "hip": (0.0, 0.036, 0.494),
    "knee": (0.0, 0.036, 0.273),
    "foot": (0.0, 0.044, 0.0475),
    "toe": (0.077, 0.044, 0.0145),
    "sole_heel_inner": (-0.04, 0.02, 0.0),
    "sole_heel_outer": (-0.04, 0.068, 0.0),
    "sole_toe_inner": (0.11, 0.02, 0.0),
    "sole_toe_outer": (0.11, 0.068, 0.0),
}
"""A person's left leg: ahead, left and above the floor under the shoulders, as shares of the stature."""


def find_upper_body(description: Description, hints: Hints) -> Anatomy:
    """Return what a description's joints and links above its base are.

    Raises:
        Refused: It has no two arms that can follow a person's, or which way it looks is not told.
    """
    pose = zero_pose(description, hints.lock)
    limbs = find_arms(pose)
    if spare := spare_joints(pose, limbs):
        pose = zero_pose(description, (*hints.lock, *spare))
        limbs = find_arms(pose)
    facing = find_facing(pose, limbs, (), (), hints.ahead)
    if not facing.first_is_left:
        limbs = replace(limbs, arms=limbs.arms[::-1])
    first, second = (
        find_arm(pose, chain, facing.axes[:, 0], inward, named=limb.elbow, roll=np.radians(hints.hand_roll))
        for chain, inward, limb in zip(limbs.arms, (-1, 1), (hints.left, hints.right), strict=True)
    )
    arms = (first, second)
    stature, height, by = _stature(pose, facing, arms, hints.stature)
    shoulders = 0.5 * (first.bend.top + second.bend.top)
    floor = shoulders - height * facing.axes[:, 2]
    sites = dict(_leg_sites(pose, facing, floor, stature))
    hips = 0.5 * (sites["left_hip"].position + sites["right_hip"].position)
    sites |= dict(trunk_sites(pose, limbs, facing, hips, shoulders, stature=stature))
    for side, chain, arm in zip(SIDES, limbs.arms, arms, strict=True):
        sites |= {f"{side}_{name}": site for name, site in arm_sites(pose, chain, arm)}
    held = ", ".join(one.joint for one in pose.held[:4]) + (", ..." if len(pose.held) > 4 else "")
    findings = (
        *description.findings,
        Finding(
            "ok", "base", f"{hints.base}; {len(pose.held)} joints are held ({held})", 'base = "stays"  # or follows'
        ),
        *(
            finding
            for side, chain, arm in zip(SIDES, limbs.arms, arms, strict=True)
            for finding in arm_findings(pose, side, chain, arm)
        ),
        facing.finding,
        Finding("ok", "stature", f"{stature:.2f} m {by}; the shoulders are {height:.2f} m high", "stature = NUMBER"),
    )
    return Anatomy(pose, facing, sites, arms, stature, findings)


def _stature(pose: ZeroPose, facing: Facing, arms: tuple[Arm, Arm], named: float | None) -> tuple[float, float, str]:
    """Return the stature and the shoulders' height above the floor [m], and what tells them."""
    up = facing.axes[:, 2]
    shoulders = float(np.mean([arm.bend.top @ up for arm in arms]))
    points = pose.points(*pose.parts)
    lowest = float((points @ up).min()) if len(points) else float((pose.anchors @ up).min())
    height, by_arm = shoulders - lowest, float(np.mean([_length(arm) for arm in arms])) / _ARM
    if height < _NO_STAND * _SHOULDERS * by_arm:
        stature = named or by_arm
        return stature, _SHOULDERS * stature, "by its arms, on a stand that the file has not"
    return named or height / _SHOULDERS, height, "by its shoulders"


def _length(arm: Arm) -> float:
    return float(np.linalg.norm(arm.bend.top - arm.bend.middle) + np.linalg.norm(arm.wrist - arm.bend.middle))


def _leg_sites(
    pose: ZeroPose, facing: Facing, floor: Float[np.ndarray, "3"], stature: float
) -> Iterator[tuple[str, PlacedSite]]:
    goals = home_goals()
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        for name, (ahead, left, above) in _LEG.items():
            turn = goals.get(f"{side}_{name}", np.eye(3))
            place = floor + facing.axes @ (stature * np.array([ahead, sign * left, above]))
            yield f"{side}_{name}", PlacedSite(pose.root, place, facing.axes @ turn)
