"""The most plausible reading of a root's path and joint angles, and its contradictions of the claim."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.finding import ROOT, Check, FormatFinding, contradiction
from hoi_retarget.motion.check.interpretation import (
    Deviation,
    Interpretation,
    angle_deviations,
    changes,
    isaac_lab_columns,
    joint_deviations,
    rotation_deviations,
    sign_deviations,
    world_deviations,
)
from hoi_retarget.motion.check.plausibility import Plausibility, plausibility, sampled
from hoi_retarget.motion.formats import Convention
from hoi_retarget.robots.model import RobotModel

# A reading is preferred to the claimed one when it takes away this much of the penalty, and this part of it:
# correct files never gained more than 0.16 by a wrong reading.
_GAIN, _SIGN_GAIN, _PART = 0.25, 0.35, 0.75
_UNDECIDED = 0.1
_ROUNDS = 3  # Of faults found one after the other.
_MAX_STANDING_PENALTY = 1.8  # Between the best readings of shuffled columns, from 2.06 on, and right ones, to 1.52.
_MAX_SHARE_OUTSIDE = 0.02  # Part of the angles out of range from which on the columns are not the robot's.
_MIN_MOVEMENT_RAD = 1e-3


@dataclass(frozen=True, eq=False)
class CandidatePoses:
    """A root's path and columns of angles as in a file."""

    model: RobotModel
    pos: Float[np.ndarray, "T 3"]
    quat: Float[np.ndarray, "T 4"]
    joint_pos: Float[np.ndarray, "T c"]
    fps: float
    of: str = ROOT  # Whose columns the root's pose is.

    def judged(self, reading: Interpretation) -> Plausibility:
        """Return the figures against one reading."""
        frames = sampled(len(self.pos))
        qpos = reading.qpos(self.pos[frames], self.quat[frames], self.joint_pos[frames])
        return plausibility(self.model, qpos, self.fps)


def find_reading(poses: CandidatePoses, claim: Interpretation, *, known: bool) -> Check[Interpretation | None]:
    """Return the most plausible reading; where the poses are known already, of z up and y up alone.

    None where the angles fit the robot in no order that is tried.
    """
    reading, judged = claim, poses.judged(claim)
    findings: list[FormatFinding] = []
    for _ in range(_ROUNDS):
        deviations = list(_up_axes(reading) if known else _all(poses, reading))
        steps: list[tuple[Deviation, ...]] = [(item,) for item in deviations]
        if not known:  # With inverted quaternions and y up, the robot lies in either reading alone: neither gains.
            steps += [(item, up) for item in rotation_deviations(reading) for up in _up_axes(item.reading)]
        candidates = [(items, poses.judged(items[-1].reading)) for items in steps]
        better = [
            (items, other)
            for items, other in candidates
            if judged.penalty - other.penalty > _cost(items) and other.penalty < _PART * judged.penalty
        ]
        if not better:
            break
        items, other = min(better, key=lambda pair: pair[1].penalty + _cost(pair[0]))
        are = " and ".join(item.is_ for item in items)
        numbers = f"the numbers are {are}: {describe(other)}; as claimed {describe(judged)}"
        for item in items:
            fix = changes(reading, item.reading, poses.of, poses.joint_pos.shape[1])
            findings.append(contradiction(item.subject, "read as the format demands", numbers, item.advice, fix=fix))
            reading = item.reading
        judged = other
    if not known and judged.penalty > _MAX_STANDING_PENALTY and poses.judged(claim).outside > _MAX_SHARE_OUTSIDE:
        numbers = f"the columns are in no order that is known, or of another robot: {describe(poses.judged(claim))}"
        advice = "Write the joints' names beside the columns, in the order of the columns, or name another --robot."
        yield contradiction("joint order", "read as the format demands", numbers, advice)
        return None
    yield from findings
    if reading is claim:
        subject, demand = ("up axis", "z up") if known else ("poses", "read as the format demands")
        yield FormatFinding("ok", subject, demand, f"the robot stands: {describe(judged)}")
    return reading


def read_open(poses: CandidatePoses, claim: Interpretation, convention: Convention) -> Check[Interpretation]:
    """Return the most plausible of the orders of quaternions and joints that a format allows."""
    readings = _open_readings(poses.model, claim, convention)
    if len(readings) == 1:
        return claim
    judged = {words: poses.judged(reading) for words, reading in readings.items()}
    penalty = {words: _penalty_in_any_units(poses, reading) for words, reading in readings.items()}
    usual, *_ = readings
    by_penalty = sorted(penalty, key=penalty.__getitem__)
    best = by_penalty[0]
    found = usual if penalty[usual] - penalty[best] < _UNDECIDED else best
    others = [words for words in by_penalty if words != found]
    alike = [words for words in others if penalty[words] - penalty[found] < _UNDECIDED]
    demand = "left open by the format"
    if alike:
        yield FormatFinding("unknown", "orders", demand, f"taken for {found}; as plausible as {', or '.join(alike)}")
    else:
        numbers = f"{found}: {describe(judged[found])}; next best {others[0]}: {describe(judged[others[0]])}"
        yield FormatFinding("ok", "orders", demand, numbers)
    return readings[found]


def _open_readings(model: RobotModel, claim: Interpretation, convention: Convention) -> dict[str, Interpretation]:
    """Return the readings that a format allows by their descriptions, the usual one first."""
    turned = [item.reading for item in rotation_deviations(claim) if item.subject == "quaternion order"]
    rotations = [claim, *turned] if convention.quat_order is None else [claim]
    orders = {"MuJoCo's depth-first order": claim.columns}
    there = [column for column in claim.columns if column >= 0]
    if convention.order is None and there == list(range(len(there))):
        orders["Isaac Lab's breadth-first order"] = isaac_lab_columns(model, claim.columns)
    return {
        f"quaternions {reading.quat_order}, joints in {words}": replace(reading, columns=columns)
        for reading in rotations
        for words, columns in orders.items()
    }


def _penalty_in_any_units(poses: CandidatePoses, reading: Interpretation) -> float:
    """Return a reading's penalty, or if less, that with another up axis or unit and the cost of such a fault."""
    others = [*world_deviations(reading), *angle_deviations(reading, poses.model, poses.joint_pos)]
    return min(poses.judged(reading).penalty, *(poses.judged(item.reading).penalty + _GAIN for item in others))


def undecided(poses: CandidatePoses, reading: Interpretation) -> Iterator[FormatFinding]:
    """Yield the other readings that are as plausible."""
    base = poses.judged(reading).penalty
    same = [item for item in _all(poses, reading) if poses.judged(item.reading).penalty - base < _UNDECIDED]
    whole = [item.is_ for item in same if item.subject != "joint sign"]
    signs = [item.is_.removeprefix("negated for ") for item in same if item.subject == "joint sign"]
    if whole:
        numbers = f"as plausible if they were {', or '.join(whole)}"
        yield FormatFinding("unknown", "poses", "cannot be told from this motion", numbers)
    if signs:
        numbers = f"as plausible with the opposite sign of {', '.join(signs)}"
        yield FormatFinding("unknown", "joint sign", "cannot be told from this motion", numbers)


def _up_axes(reading: Interpretation) -> Iterator[Deviation]:
    return (item for item in world_deviations(reading) if item.subject == "up axis")


def _all(poses: CandidatePoses, reading: Interpretation) -> Iterator[Deviation]:
    height = abs(poses.judged(reading).height)
    for item in world_deviations(reading):
        # Soles far above the floor are not brought to it by a unit in which they are far below it.
        if item.subject != "length unit" or abs(poses.judged(item.reading).height) < height:
            yield item
    yield from rotation_deviations(reading)
    yield from joint_deviations(reading, poses.model, poses.joint_pos)
    # A joint that never moves has no side to turn to: it may have been set so.
    moving = np.ptp(poses.joint_pos, axis=0) > _MIN_MOVEMENT_RAD
    yield from sign_deviations(reading, poses.model, moving)


def _cost(items: tuple[Deviation, ...]) -> float:
    """Return the decrease of the penalty that faults must bring."""
    return sum(_SIGN_GAIN if item.subject == "joint sign" else _GAIN for item in items)


def describe(judged: Plausibility) -> str:
    """Return the most informative figures in words."""
    parts = [
        f"standing foot tilted {judged.tilt:.1f} deg",
        f"sliding at {judged.slide:.2f} of the pelvis' speed",
        f"soles at {1000 * judged.height:.0f} mm (spread {1000 * judged.unevenness:.0f})",
    ]
    if judged.outside:
        parts.append(f"{100 * judged.outside:.0f} % of joint angles out of range")
    if judged.elbows_inside:
        parts.append(f"elbows inside the trunk in {100 * judged.elbows_inside:.0f} %")
    if judged.upside_down:
        parts.append(f"pelvis on its side or head in {100 * judged.upside_down:.0f} % of frames")
    return ", ".join(parts)
