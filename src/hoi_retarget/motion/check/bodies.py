"""Findings about bodies: in which order and convention they are, and whether joints and root agree with them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.body_poses import BodyReading, body_readings, claimed_places, fit_tree
from hoi_retarget.motion.check.change import BODIES, ROOT, Change
from hoi_retarget.motion.check.finding import Check, Finding
from hoi_retarget.motion.check.interpretation import (
    IN_BREADTH_FIRST,
    IN_DEPTH_FIRST,
    Deviation,
    Interpretation,
    changes,
    isaac_lab_columns,
    joint_deviations,
    reordered,
    rotation_deviations,
)
from hoi_retarget.motion.check.joint_columns import AnglesOfBodies, angles_apart
from hoi_retarget.motion.check.layout import NO_ROTATION, UNIT_TOLERANCE, Layout, off_unit, unnormalized
from hoi_retarget.motion.formats import Bodies, MotionFile, beyondmimic, mjlab
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import RobotModel

BREADTH_FIRST, DEPTH_FIRST = beyondmimic.FORMAT.name, mjlab.FORMAT.name
_ENOUGH = 0.3  # Penalty of a fit that leaves no question: 3 degrees or 3 cm.
_PART = 0.7
_SAME_ANGLE = 0.02  # [rad]
_SAME_PLACE, _SAME_TURN = 0.02, np.radians(2.0)


@dataclass(frozen=True, eq=False)
class FoundBodies:
    """How bodies and joints are to be read."""

    there: BodyReading
    reading: Interpretation
    """Of the joints, and of the bodies' poses as the root's."""
    pos: Float[np.ndarray, "T 3"]
    quat: Float[np.ndarray, "T 4"]
    """The root body's, as in the file."""
    format: str


def read_bodies(
    file: MotionFile, bodies: Bodies, model: RobotModel, layout: Layout, claim: Interpretation
) -> Check[FoundBodies | None]:
    """Return how bodies and joints are to be read, None where the bodies do not tell."""
    places = claimed_places(model, file.body_names, bodies.pos.shape[1])
    if model.body_names[0] not in places or len(places) < 3:
        says = f"{bodies.pos.shape[1]} bodies without names" if file.body_names is None else "other names"
        expected = f"{len(model.body_names)} bodies of {model.spec.name}"
        yield Finding("unknown", "body order", expected, f"the file has {says}: not compared")
        return None
    off = off_unit(bodies.quat[:, list(places.values())])
    if off > UNIT_TOLERANCE:
        says = f"their lengths differ from 1 by up to {off:.2g}"
        yield unnormalized("bodies", "unit quaternions", says, BODIES)
        if off > NO_ROTATION:
            return None
    there = yield from _fitting(model, bodies, list(body_readings(model, places, claim, bodies.pos)), file)
    if there.reading.metres != 1.0:
        yield _unit(there.reading.metres, file.root is not None)
    reading, format_name = yield from _joints(file, AnglesOfBodies(model, there, bodies, layout.joint_pos))
    root = there.places[model.body_names[0]]
    found = FoundBodies(there, reading, bodies.pos[:, root], bodies.quat[:, root], format_name)
    if layout.pos is not None and layout.quat is not None:
        yield _root(found, layout.pos, layout.quat, claim)
    return found


def _unit(metres: float, with_root: bool) -> Finding:
    says = f"neighbouring bodies are {1 / metres:g} times as far apart as the robot's"
    mend = tuple(Change("multiply positions", of, (metres,)) for of in (BODIES, *([ROOT] if with_root else [])))
    return Finding("contradiction", "length unit", "metres", says, f"Multiply positions by {metres:g}.", "poses", mend)


def _fitting(model: RobotModel, bodies: Bodies, readings: list[BodyReading], file: MotionFile) -> Check[BodyReading]:
    fits = [fit_tree(model, there, bodies.pos, bodies.quat) for there in readings]
    # Where both orders are in use, neither contradicts the claim.
    open_order = file.convention.order is None
    legal = [0, *(i for i, there in enumerate(readings) if open_order and _is_legal(there, readings[0]))]
    by_fit = sorted(range(len(fits)), key=lambda index: fits[index].penalty)
    best = min(legal, key=by_fit.index)
    if fits[best].penalty > _ENOUGH:
        other = by_fit[0]
        if fits[other].penalty < _PART * fits[best].penalty:
            says = f"{fits[other]}; as claimed {fits[best]}"
            yield from _contradictions(readings[other], readings[best], says, bodies.pos.shape[1])
            return readings[other]
        says = f"{fits[best]} in the best of {len(fits)} readings"
        advice = "Are these bodies of this robot? Name another --robot."
        yield Finding("contradiction", "bodies", f"bodies of {model.spec.name}", says, advice, "poses")
        return readings[best]
    there = readings[best]
    order = there.order or ("as the file names them" if file.body_names else "in MuJoCo's depth-first order")
    claim = f"quaternions {there.reading.quat_order}, bodies {order}"
    alternative = min((fit.penalty, str(fit)) for index, fit in enumerate(fits) if index != best)[1]
    yield Finding("ok", "bodies", claim, f"{fits[best]}; in the next best reading {alternative}")
    return there


def _is_legal(there: BodyReading, claimed: BodyReading) -> bool:
    return there.order.startswith("in ") and replace(there.reading, metres=1.0) == replace(claimed.reading, metres=1.0)


def _contradictions(found: BodyReading, claim: BodyReading, says: str, count: int) -> Iterator[Finding]:
    changed = {
        "quaternion order": found.reading.quat_order != claim.reading.quat_order,
        "quaternion inverse": found.reading.inverted != claim.reading.inverted,
    }
    demand = "read as the format demands"
    for item in rotation_deviations(claim.reading):
        if changed[item.subject]:
            what = f"the bodies' quaternions are {item.is_}: {says}"
            mend = changes(claim.reading.of_poses, item.reading.of_poses, BODIES, 0)
            yield Finding("contradiction", item.subject, demand, what, item.advice, "poses", mend)
    if found.order != claim.order and found.order:
        what = f"the bodies are {found.order}: {says}"
        order = {claim.places[name]: float(place) for name, place in found.places.items() if name in claim.places}
        mend = (Change("take bodies", "", tuple(order.get(index, index) for index in range(count))),)
        yield Finding("contradiction", "body order", demand, what, "Reorder the bodies.", "poses", mend)


def _joints(file: MotionFile, told: AnglesOfBodies) -> Check[tuple[Interpretation, str]]:
    """Return how the joints are to be read, by what the bodies imply, and what the format is."""
    yield from _held(told)
    there, words = told.there, "as the bodies' poses imply"
    name, claimed, order = file.format, there.reading, "breadth" if "breadth" in there.order else "depth"
    if file.convention.order is None:
        name = BREADTH_FIRST if order == "breadth" else DEPTH_FIRST
        if order == "breadth":
            claimed = replace(claimed, columns=isaac_lab_columns(told.model))
    errors = told.errors(claimed)
    if errors.max(initial=0.0) < _SAME_ANGLE:
        yield Finding("ok", "joints", words, f"within {np.degrees(errors.max(initial=0.0)):.2g} deg")
        return claimed, name
    base = float(errors.mean())
    candidates = [(float(told.errors(item.reading).mean()), item) for item in _joint_ways(told, claimed)]
    best, deviation = min(candidates, key=lambda pair: pair[0])
    if best >= 0.2 * base:
        return (yield from _single_joints(told, claimed)), name
    says = (
        f"the joint angles are {deviation.is_}: {np.degrees(best):.2g} deg from what the bodies imply, "
        f"{np.degrees(base):.2g} deg as claimed"
    )
    subject, advice = deviation.subject, deviation.advice
    if file.convention.order is None and deviation.is_ in (IN_BREADTH_FIRST, IN_DEPTH_FIRST):
        words, subject = "joints and bodies in one order", "joint and body order"
        says = f"the bodies are in {order}-first order; {says}"
        advice = f"{DEPTH_FIRST} wants both in MuJoCo's depth-first order, {BREADTH_FIRST} both in Isaac Lab's."
    mend = changes(claimed, deviation.reading, ROOT, file.joint_pos.shape[1])
    yield Finding("contradiction", subject, words, says, advice, "poses", mend)
    return deviation.reading, name


def _held(told: AnglesOfBodies) -> Iterator[Finding]:
    """Compare joints that the file lacks, which are held still, with what the bodies imply."""
    off = np.nan_to_num(angles_apart(np.where(told.has_column, np.nan, told.implied)))
    if (off > _SAME_ANGLE).any():
        names = told.model.joint_names
        turned = (f"{names[i]} by {np.degrees(off[i]):.1f} deg" for i in np.flatnonzero(off > _SAME_ANGLE))
        says = f"the bodies turn joints that the file lacks: {', '.join(turned)}"
        advice = "Write these joints, too, or the bodies of the robot with its joints held still."
        yield Finding("contradiction", "joint count", "joints that the file lacks are at 0 rad", says, advice, "poses")


def _joint_ways(told: AnglesOfBodies, claimed: Interpretation) -> Iterator[Deviation]:
    """Yield the known mistakes, then the order that fits best."""
    yield from joint_deviations(claimed, told.model, told.joint_pos)
    columns = told.in_best_order(claimed).columns
    elsewhere = [
        f"{name} in column {found}"
        for name, place, found in zip(told.model.joint_names, claimed.columns, columns, strict=True)
        if found != place
    ]
    yield reordered(claimed, "joint order", f"in another order ({', '.join(elsewhere)})", np.array(columns))


def _single_joints(told: AnglesOfBodies, claimed: Interpretation) -> Check[Interpretation]:
    """Return the reading in which those joints are negated, or measured from elsewhere, that are."""
    names, width, words = told.model.joint_names, told.joint_pos.shape[1], "as the bodies' poses imply"
    angles, implied = claimed.angles(told.joint_pos), np.where(told.has_column, told.implied, np.nan)
    straight, turned = angles_apart(implied - angles), angles_apart(implied + angles)
    offsets = np.median(implied - angles, axis=0)
    off = straight > _SAME_ANGLE
    negated = off & (turned < 0.2 * straight)
    moved = off & ~negated & (angles_apart(implied - angles - offsets) < np.minimum(_SAME_ANGLE, 0.2 * straight))
    reading = replace(claimed, signs=tuple((np.where(negated, -1.0, 1.0) * np.array(claimed.signs)).tolist()))
    if negated.any():
        which = ", ".join(np.array(names)[negated])
        mend = changes(claimed, reading, ROOT, width)
        yield Finding("contradiction", "joint sign", words, f"negated for {which}", f"Negate {which}.", "poses", mend)
    if moved.any():
        which = ", ".join(f"{offsets[i]:+.3f} rad to {names[i]}" for i in np.flatnonzero(moved))
        moved_by = replace(reading, offsets=tuple(np.where(moved, offsets, 0.0).tolist()))
        mend, reading = changes(reading, moved_by, ROOT, width), moved_by
        yield Finding("contradiction", "joint zero", words, f"off by {which}", f"Add {which}.", "poses", mend)
    rest = np.flatnonzero(off & ~negated & ~moved)
    if len(rest):
        wrong = ", ".join(f"{names[i]} by {np.degrees(straight[i]):.1f} deg" for i in rest)
        advice = "Joints and bodies are of different motions or robots: write both from one configuration."
        yield Finding("contradiction", "joints", words, f"they differ: {wrong}", advice, "poses")
    return reading


def _root(found: FoundBodies, pos: np.ndarray, quat: np.ndarray, claim: Interpretation) -> Finding:
    """Compare the root's own columns with the pose of the root's body."""
    base = replace(found.reading, quat_order=claim.quat_order, inverted=claim.inverted)
    body_pos, body_quat = found.reading.position(found.pos), found.reading.rotation(found.quat)
    moved = float(np.median(np.linalg.norm(base.position(pos) - body_pos, axis=1)))
    turned = float(np.median(se3.angle_between(base.rotation(quat), body_quat)))
    same = "the root's pose is that of its body"
    says = f"{1000 * moved:.2g} mm and {np.degrees(turned):.2g} deg apart"
    if moved < _SAME_PLACE and turned < _SAME_TURN:
        return Finding("ok", "root", same, says)
    for deviation in rotation_deviations(base):
        if float(np.median(se3.angle_between(deviation.reading.rotation(quat), body_quat))) < 0.2 * turned:
            says = f"the root's quaternions are {deviation.is_}: {np.degrees(turned):.2g} deg apart as claimed"
            mend = changes(base.of_poses, deviation.reading.of_poses, ROOT, 0)
            return Finding("contradiction", deviation.subject, same, says, deviation.advice, "poses", mend)
    advice = "Write the root and the bodies from one configuration."
    return Finding("contradiction", "root", same, says, advice, "poses")
