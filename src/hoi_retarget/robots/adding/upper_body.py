"""Robots of which only the upper body follows a person, on a base that stays or follows: no leg is looked for.

What carries the trunk, wheels, lifts or legs, is held. The sites of legs are put where a person's would be, on the
root link: nothing follows with them.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.adding import morphology
from hoi_retarget.robots.adding.arms import Arm
from hoi_retarget.robots.adding.description import Description
from hoi_retarget.robots.adding.findings import Hints, RobotFinding
from hoi_retarget.robots.adding.forward_axis import TrunkAxes, find_forward_axis
from hoi_retarget.robots.adding.home_pose import home_goals
from hoi_retarget.robots.adding.kinematic_chains import find_arms
from hoi_retarget.robots.adding.zero_pose import ZeroPose
from hoi_retarget.robots.spec import SIDES

_SHOULDERS, _ARM = 0.82, 0.30  # Of a person's stature: how high the shoulders are, and how long arms are without hands.
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


def find_upper_body(description: Description, hints: Hints) -> morphology.Morphology:
    """Return the morphology above a robot's base.

    Raises `UnsuitableRobotError` without two arms that can follow a person's, or where its forward axis is undecided.
    """
    pose, limbs = morphology.pose_and_limbs(description, hints, find_arms)
    trunk = find_forward_axis(pose, limbs, (), (), hints.ahead)
    if not trunk.first_is_left:
        limbs = replace(limbs, arms=limbs.arms[::-1])
    arms = morphology.find_both_arms(pose, limbs, trunk, hints)
    stature, height, by = _stature(pose, trunk, arms, hints.stature)
    shoulders = 0.5 * (arms[0].elbow.top + arms[1].elbow.top)
    floor = shoulders - height * trunk.axes[:, 2]
    sites = dict(_leg_sites(pose, trunk, floor, stature))
    hips = 0.5 * (sites["left_hip"].position + sites["right_hip"].position)
    sites |= dict(morphology.trunk_sites(pose, limbs, trunk, hips, shoulders, stature=stature))
    sites |= morphology.arm_sites(pose, limbs, arms)
    held = ", ".join(one.joint for one in pose.held[:4]) + (", ..." if len(pose.held) > 4 else "")
    findings = (
        *description.findings,
        RobotFinding(
            "ok", "base", f"{hints.base}; {len(pose.held)} joints are held ({held})", 'base = "stays"  # or follows'
        ),
        *morphology.arm_findings(pose, limbs, arms),
        trunk.finding,
        RobotFinding(
            "ok", "stature", f"{stature:.2f} m {by}; the shoulders are {height:.2f} m high", "stature = NUMBER"
        ),
    )
    return morphology.Morphology(pose, trunk, sites, arms, stature, findings)


def _stature(pose: ZeroPose, trunk: TrunkAxes, arms: tuple[Arm, Arm], named: float | None) -> tuple[float, float, str]:
    """Return the stature and the shoulders' height above the floor [m], and their source in words."""
    up = trunk.axes[:, 2]
    shoulders = float(np.mean([arm.elbow.top @ up for arm in arms]))
    points = pose.points(*pose.parts)
    lowest = float((points @ up).min()) if len(points) else float((pose.anchors @ up).min())
    height, by_arm = shoulders - lowest, float(np.mean([_length(arm) for arm in arms])) / _ARM
    if height < _NO_STAND * _SHOULDERS * by_arm:
        stature = named or by_arm
        return stature, _SHOULDERS * stature, "by its arms, on a stand that the file has not"
    return named or height / _SHOULDERS, height, "by its shoulders"


def _length(arm: Arm) -> float:
    return float(np.linalg.norm(arm.elbow.top - arm.elbow.middle) + np.linalg.norm(arm.wrist - arm.elbow.middle))


def _leg_sites(
    pose: ZeroPose, trunk: TrunkAxes, floor: Float[np.ndarray, "3"], stature: float
) -> Iterator[tuple[str, morphology.PlacedSite]]:
    goals = home_goals()
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        for name, (ahead, left, above) in _LEG.items():
            turn = goals.get(f"{side}_{name}", np.eye(3))
            place = floor + trunk.axes @ (stature * np.array([ahead, sign * left, above]))
            yield f"{side}_{name}", morphology.PlacedSite(pose.root, place, trunk.axes @ turn)
