"""Findings about bodies: their order and convention, and the agreement of joints and root with them.

Two neighbouring bodies of the robot's tree can only turn about their hinge. That needs no joint angles, so poses give
the order of the bodies, the order of quaternion components and the unit of length on their own; the angles that they
imply then identify the columns of joint angles.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Bool, Float

from hoi_retarget.motion.check import interpretation
from hoi_retarget.motion.check.finding import BODIES, ROOT, Change, Check, FormatFinding, contradiction
from hoi_retarget.motion.check.layout import NO_ROTATION, NORMALIZE, UNIT_TOLERANCE, Layout, off_unit
from hoi_retarget.motion.formats import Bodies, MotionFile, isaac_lab
from hoi_retarget.motion.links import breadth_first
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import evenly_spaced
from hoi_retarget.robots.model import RobotModel

_MAX_FRAMES = 200  # Of a check, evenly over the clip.
_SAME_MAGNITUDE = 0.1  # In powers of ten.
Places = dict[str, int]  # Where in the file each of the robot's bodies is.


@dataclass(frozen=True)
class TreeFit:
    """The fit of poses to the tree under one reading."""

    turned: float  # Median angle between two neighbours' rotation and the nearest that their hinge allows [deg].
    moved: float  # Median distance between a body's place in its parent and where its hinge is [m].

    @property
    def penalty(self) -> float:
        """One number [unitless] to compare readings by: 1 is 10 degrees or 10 cm off."""
        return self.turned / 10.0 + self.moved / 0.1

    def __str__(self) -> str:
        return f"neighbours {self.turned:.2g} deg and {1000 * self.moved:.2g} mm off their hinges"


@dataclass(frozen=True)
class BodyReading:
    """One way to read a file's bodies."""

    order: str  # In words that follow 'are'; empty as claimed.
    places: Places
    reading: interpretation.Interpretation


def claimed_places(model: RobotModel, names: tuple[str, ...] | None, count: int) -> Places:
    """Return the places of the robot's bodies by the file's names, or else in the MJCF's order."""
    if names is not None:
        return {name: names.index(name) for name in model.body_names if name in names}
    return {name: index for index, name in enumerate(model.body_names)} if count == len(model.body_names) else {}


def _body_readings(
    model: RobotModel, places: Places, claim: interpretation.Interpretation, pos: np.ndarray
) -> Iterator[BodyReading]:
    """Yield the claimed reading first, then every other one: orders of bodies times orders of components.

    Each has the unit of length that the distances of neighbours have in its order.
    """
    orders = [("", places), *_other_orders(model, places)]
    units = [_unit_of_length(model, there, pos) for _, there in orders]
    other = "xyzw" if claim.quat_order == "wxyz" else "wxyz"
    rotations = [
        claim,
        replace(claim, quat_order=other),
        replace(claim, inverted=True),
        replace(claim, quat_order=other, inverted=True),
    ]
    for reading in rotations:
        for (order, there), metres in zip(orders, units, strict=True):
            yield BodyReading(order, there, replace(reading, metres=metres))


def _other_orders(model: RobotModel, places: Places) -> Iterator[tuple[str, Places]]:
    columns = sorted(places.values())
    present = [name for name in model.body_names if name in places]
    breadth = [model.body_names[index] for index in breadth_first(model)[0] if model.body_names[index] in places]
    sides = interpretation.mirrored(model.body_names)
    swapped = {model.body_names[index]: model.body_names[other] for index, other in enumerate(sides)}
    candidates = [
        ("in Isaac Lab's breadth-first order", dict(zip(breadth, columns, strict=True))),
        ("in MuJoCo's depth-first order", dict(zip(present, columns, strict=True))),
        ("with left and right exchanged", {name: places[swapped[name]] for name in present if swapped[name] in places}),
    ]
    for words, candidate in candidates:
        if candidate != places:
            yield words, candidate


def _unit_of_length(model: RobotModel, places: Places, pos: Float[np.ndarray, "T B 3"]) -> float:
    """Return one unit of the file's lengths [m]: 0.01 or 0.001 where distances are too long by that, else 1."""
    pairs = [pair for pair in _neighbours(model, places) if np.linalg.norm(model.offsets[:, pair.hinge]) > 0.02]
    if not pairs:
        return 1.0
    frames = evenly_spaced(len(pos), _MAX_FRAMES)
    stored = np.array([np.median(np.linalg.norm(pos[frames, p.child] - pos[frames, p.parent], axis=-1)) for p in pairs])
    known = np.array([np.linalg.norm(model.offsets[:, pair.hinge]) for pair in pairs])
    magnitude = float(np.log10(max(float(np.median(stored / known)), 1e-9)))
    return next((unit for unit in (0.01, 0.001) if abs(magnitude + np.log10(unit)) < _SAME_MAGNITUDE), 1.0)


@dataclass(frozen=True)
class _Neighbours:
    hinge: int
    parent: int  # Columns in the file.
    child: int
    parent_body: int
    child_body: int


def _neighbours(model: RobotModel, places: Places) -> Iterator[_Neighbours]:
    """Yield the hinges between two bodies of the file."""
    body_of_node = {int(node): body for body, node in reversed(list(enumerate(model.bodies.nodes)))}
    for hinge, parent in enumerate(model.parents):
        parent_body, child_body = body_of_node.get(int(parent)), body_of_node.get(hinge + 1)
        if parent_body is None or child_body is None:
            continue
        parent_place = places.get(model.body_names[parent_body])
        child_place = places.get(model.body_names[child_body])
        if parent_place is not None and child_place is not None:
            yield _Neighbours(hinge, parent_place, child_place, parent_body, child_body)


def _fit_tree(model: RobotModel, there: BodyReading, bodies: Bodies) -> TreeFit:
    """Return the fit of the poses to the tree under one reading."""
    frames = evenly_spaced(len(bodies.pos), _MAX_FRAMES)
    pos, quat = bodies.pos[frames], bodies.quat[frames]
    turned, moved = [], []
    for pair in _neighbours(model, there.places):
        rotation, position = _relative(model, there, pair, pos, quat)
        nearest = _hinge_rotation(model, pair.hinge, _hinge_angle(model, pair.hinge, rotation))
        turned.append(np.median(se3.matrix_angle_between(rotation, nearest)))
        moved.append(np.median(np.linalg.norm(position - model.offsets[:, pair.hinge], axis=-1)))
    if not turned:
        return TreeFit(0.0, 0.0)
    return TreeFit(float(np.degrees(np.mean(turned))), float(np.mean(moved)))


def _relative(
    model: RobotModel, there: BodyReading, pair: _Neighbours, pos: np.ndarray, quat: np.ndarray
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3"]]:
    """Return a node's pose in its parent node, of the two bodies that are fixed to them."""
    poses = []
    for place, body in ((pair.parent, pair.parent_body), (pair.child, pair.child_body)):
        fixed_rotation, fixed_position = model.bodies.rotations[:, :, body], model.bodies.positions[:, body]
        rotation = se3.quat_to_matrix(there.reading.rotation(quat[:, place])) @ fixed_rotation.T
        position = there.reading.position(pos[:, place]) - rotation @ fixed_position
        poses.append((rotation, position))
    (parent_rotation, parent_position), (child_rotation, child_position) = poses
    inverse = parent_rotation.transpose(0, 2, 1)
    return inverse @ child_rotation, np.einsum("tij,tj->ti", inverse, child_position - parent_position)


def _hinge_angle(model: RobotModel, hinge: int, rotation: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T"]:
    """Return the angle of the hinge that comes nearest to a rotation [rad]."""
    _, cosine, sine = model.hinge_rotations[..., hinge]
    return np.arctan2(np.einsum("ij,tij->t", sine, rotation), np.einsum("ij,tij->t", cosine, rotation))


def _hinge_rotation(model: RobotModel, hinge: int, angle: Float[np.ndarray, "T"]) -> Float[np.ndarray, "T 3 3"]:
    constant, cosine, sine = model.hinge_rotations[..., hinge]
    return constant + cosine * np.cos(angle)[:, None, None] + sine * np.sin(angle)[:, None, None]


_MAX_OPEN_JOINTS = 4  # Columns of more joints are not tried in all orders.
_MAX_COLUMN_FRAMES = 40


@dataclass(frozen=True, eq=False)
class AnglesOfBodies:
    """Joint angles implied by bodies, beside the file's columns of angles."""

    model: RobotModel
    there: BodyReading
    bodies: Bodies
    joint_pos: Float[np.ndarray, "T c"]

    @cached_property
    def implied(self) -> Float[np.ndarray, "T n"]:
        """Joint angles by the poses of bodies [rad]; NaN for joints with a body missing."""
        angles = np.full((len(self.bodies.pos), self.model.n), np.nan)
        for pair in _neighbours(self.model, self.there.places):
            rotation, _ = _relative(self.model, self.there, pair, self.bodies.pos, self.bodies.quat)
            angles[:, pair.hinge] = _hinge_angle(self.model, pair.hinge, rotation)
        return angles

    @property
    def has_column(self) -> Bool[np.ndarray, "n"]:
        """Whether the file has each joint."""
        return np.array(self.there.reading.columns) >= 0

    @property
    def comparable(self) -> Bool[np.ndarray, "n"]:
        """Whether each joint has both a column and an implied angle."""
        return np.isfinite(self.implied).all(axis=0) & self.has_column

    def errors(self, reading: interpretation.Interpretation) -> Float[np.ndarray, "k"]:
        """Return the distances of the columns from the angles, of the comparable joints [rad]."""
        both = self.comparable
        return angles_apart(self.implied[:, both] - reading.angles(self.joint_pos)[:, both])

    def in_best_order(self, claim: interpretation.Interpretation) -> interpretation.Interpretation:
        """Return a claim with the order of its columns that fits best.

        Columns of joints between bodies that are missing follow from the places of the bodies behind them, up to four.
        """
        both, columns = self.comparable, np.array(claim.columns)
        there = columns[columns >= 0]
        apart = np.abs(self.implied[:, both, None] - self.joint_pos[:, None, there]).mean(axis=0)
        columns[both] = there[scipy.optimize.linear_sum_assignment(apart)[1]]
        left = np.setdiff1d(there, columns[both]).tolist()
        others = np.flatnonzero(~both & (columns >= 0))
        orders = permutations(left) if len(left) <= _MAX_OPEN_JOINTS else [left]
        readings = []
        for order in orders:
            columns[others] = order
            readings.append(replace(claim, columns=tuple(columns.tolist())))
        return min(readings, key=self._body_error) if len(readings) > 1 else readings[0]

    def _body_error(self, reading: interpretation.Interpretation) -> float:
        """Return the mean distance of bodies from where the joint angles put them [m]."""
        frames = evenly_spaced(len(self.joint_pos), _MAX_COLUMN_FRAMES)
        pos, quat = self.bodies.pos[frames], self.bodies.quat[frames]
        names, places = list(self.there.places), list(self.there.places.values())
        root = self.there.places[self.model.body_names[0]]
        qpos = reading.qpos(pos[:, root], quat[:, root], self.joint_pos[frames])
        at = self.model.forward(qpos).body_positions[:, [self.model.body_names.index(name) for name in names]]
        return float(np.linalg.norm(at - reading.position(pos[:, places]), axis=-1).mean())


def angles_apart(difference: Float[np.ndarray, "T k"]) -> Float[np.ndarray, "k"]:
    """Return the root mean square of differences of angles over time, whole turns left out [rad]."""
    with np.errstate(over="ignore"):
        wrapped = np.abs(np.angle(np.exp(1j * np.clip(difference, -1e6, 1e6))))
    # Angles that are far beyond a turn would look near by chance.
    return np.sqrt(np.mean(np.where(np.abs(difference) > 7.0, np.pi, wrapped) ** 2, axis=0))


BREADTH_FIRST, DEPTH_FIRST = isaac_lab.BEYONDMIMIC.name, isaac_lab.MJLAB.name
_MAX_FIT_PENALTY = 0.3  # Of a good fit: 3 degrees or 3 cm.
_BETTER_SHARE = 0.7  # Of a penalty: a fit below is better.
_ANGLE_TOLERANCE = 0.02  # [rad]
_ROOT_TOLERANCE_M, _ROOT_TOLERANCE_RAD = 0.02, np.radians(2.0)


@dataclass(frozen=True, eq=False)
class FoundBodies:
    """The reading of bodies and joints by their numbers."""

    there: BodyReading
    reading: interpretation.Interpretation  # Of the joints, and of the bodies' poses as the root's.
    pos: Float[np.ndarray, "T 3"]
    quat: Float[np.ndarray, "T 4"]  # The root body's, as in the file.
    format: str


def read_bodies(
    file: MotionFile, bodies: Bodies, model: RobotModel, layout: Layout, claim: interpretation.Interpretation
) -> Check[FoundBodies | None]:
    """Return the reading of bodies and joints; None where the bodies leave it open."""
    places = claimed_places(model, file.body_names, bodies.pos.shape[1])
    if model.body_names[0] not in places or len(places) < 3:
        numbers = f"{bodies.pos.shape[1]} bodies without names" if file.body_names is None else "other names"
        expected = f"{len(model.body_names)} bodies of {model.spec.name}"
        yield FormatFinding("unknown", "body order", expected, f"the file has {numbers}: not compared")
        return None
    off = off_unit(bodies.quat[:, list(places.values())])
    if off > UNIT_TOLERANCE:
        numbers = f"their lengths differ from 1 by up to {off:.2g}"
        fix = (Change("normalize quaternions", BODIES),)
        yield contradiction("bodies", "unit quaternions", numbers, NORMALIZE, fix=fix)
        if off > NO_ROTATION:
            return None
    there = yield from _fitting(model, bodies, list(_body_readings(model, places, claim, bodies.pos)), file)
    if there.reading.metres != 1.0:
        metres = there.reading.metres
        numbers = f"neighbouring bodies are {1 / metres:g} times as far apart as the robot's"
        owners = (BODIES, *([ROOT] if file.root is not None else []))
        fix = tuple(Change("multiply positions", of, (metres,)) for of in owners)
        yield contradiction("length unit", "metres", numbers, f"Multiply positions by {metres:g}.", fix=fix)
    reading, format_name = yield from _joints(file, AnglesOfBodies(model, there, bodies, layout.joint_pos))
    root = there.places[model.body_names[0]]
    found = FoundBodies(there, reading, bodies.pos[:, root], bodies.quat[:, root], format_name)
    if layout.pos is not None and layout.quat is not None:
        yield _root(found, layout.pos, layout.quat, claim)
    return found


def _fitting(model: RobotModel, bodies: Bodies, readings: list[BodyReading], file: MotionFile) -> Check[BodyReading]:
    fits = [_fit_tree(model, there, bodies) for there in readings]
    # Where both orders are in use, neither contradicts the claim.
    open_order = file.convention.order is None
    legal = [0, *(i for i, there in enumerate(readings) if open_order and _is_legal(there, readings[0]))]
    by_fit = sorted(range(len(fits)), key=lambda index: fits[index].penalty)
    best = min(legal, key=by_fit.index)
    if fits[best].penalty > _MAX_FIT_PENALTY:
        other = by_fit[0]
        if fits[other].penalty < _BETTER_SHARE * fits[best].penalty:
            numbers = f"{fits[other]}; as claimed {fits[best]}"
            yield from _contradictions(readings[other], readings[best], numbers, bodies.pos.shape[1])
            return readings[other]
        numbers = f"{fits[best]} in the best of {len(fits)} readings"
        advice = "Are these bodies of this robot? Name another --robot."
        yield contradiction("bodies", f"bodies of {model.spec.name}", numbers, advice)
        return readings[best]
    there = readings[best]
    order = there.order or ("as the file names them" if file.body_names else "in MuJoCo's depth-first order")
    claim = f"quaternions {there.reading.quat_order}, bodies {order}"
    alternative = min((fit.penalty, str(fit)) for index, fit in enumerate(fits) if index != best)[1]
    yield FormatFinding("ok", "bodies", claim, f"{fits[best]}; in the next best reading {alternative}")
    return there


def _is_legal(there: BodyReading, claimed: BodyReading) -> bool:
    return there.order.startswith("in ") and replace(there.reading, metres=1.0) == replace(claimed.reading, metres=1.0)


def _contradictions(found: BodyReading, claim: BodyReading, numbers: str, count: int) -> Iterator[FormatFinding]:
    changed = {
        "quaternion order": found.reading.quat_order != claim.reading.quat_order,
        "quaternion inverse": found.reading.inverted != claim.reading.inverted,
    }
    demand = "read as the format demands"
    for item in interpretation.rotation_deviations(claim.reading):
        if changed[item.subject]:
            what = f"the bodies' quaternions are {item.is_}: {numbers}"
            fix = interpretation.changes(claim.reading.of_poses, item.reading.of_poses, BODIES, 0)
            yield contradiction(item.subject, demand, what, item.advice, fix=fix)
    if found.order != claim.order and found.order:
        what = f"the bodies are {found.order}: {numbers}"
        order = {claim.places[name]: float(place) for name, place in found.places.items() if name in claim.places}
        fix = (Change("take bodies", "", tuple(order.get(index, index) for index in range(count))),)
        yield contradiction("body order", demand, what, "Reorder the bodies.", fix=fix)


def _joints(file: MotionFile, joints: AnglesOfBodies) -> Check[tuple[interpretation.Interpretation, str]]:
    """Return the reading of the joints by the implied angles, and the name of the format."""
    yield from _held(joints)
    there, words = joints.there, "as the bodies' poses imply"
    name, claimed, order = file.format, there.reading, "breadth" if "breadth" in there.order else "depth"
    if file.convention.order is None:
        name = BREADTH_FIRST if order == "breadth" else DEPTH_FIRST
        if order == "breadth":
            claimed = replace(claimed, columns=interpretation.isaac_lab_columns(joints.model))
    errors = joints.errors(claimed)
    if errors.max(initial=0.0) < _ANGLE_TOLERANCE:
        yield FormatFinding("ok", "joints", words, f"within {np.degrees(errors.max(initial=0.0)):.2g} deg")
        return claimed, name
    base = float(errors.mean())
    candidates = [(float(joints.errors(item.reading).mean()), item) for item in _joint_readings(joints, claimed)]
    best, deviation = min(candidates, key=lambda pair: pair[0])
    if best >= 0.2 * base:
        return (yield from _single_joints(joints, claimed)), name
    numbers = (
        f"the joint angles are {deviation.is_}: {np.degrees(best):.2g} deg from what the bodies imply, "
        f"{np.degrees(base):.2g} deg as claimed"
    )
    subject, advice = deviation.subject, deviation.advice
    if file.convention.order is None and deviation.is_ in (
        interpretation.IN_BREADTH_FIRST,
        interpretation.IN_DEPTH_FIRST,
    ):
        words, subject = "joints and bodies in one order", "joint and body order"
        numbers = f"the bodies are in {order}-first order; {numbers}"
        advice = f"{DEPTH_FIRST} wants both in MuJoCo's depth-first order, {BREADTH_FIRST} both in Isaac Lab's."
    fix = interpretation.changes(claimed, deviation.reading, ROOT, file.joint_pos.shape[1])
    yield contradiction(subject, words, numbers, advice, fix=fix)
    return deviation.reading, name


def _held(joints: AnglesOfBodies) -> Iterator[FormatFinding]:
    """Compare joints that the file lacks, which are held still, with their implied angles."""
    off = np.nan_to_num(angles_apart(np.where(joints.has_column, np.nan, joints.implied)))
    if (off > _ANGLE_TOLERANCE).any():
        names = joints.model.joint_names
        turned = (f"{names[i]} by {np.degrees(off[i]):.1f} deg" for i in np.flatnonzero(off > _ANGLE_TOLERANCE))
        numbers = f"the bodies turn joints that the file lacks: {', '.join(turned)}"
        advice = "Write these joints, too, or the bodies of the robot with its joints held still."
        yield contradiction("joint count", "joints that the file lacks are at 0 rad", numbers, advice)


def _joint_readings(
    joints: AnglesOfBodies, claimed: interpretation.Interpretation
) -> Iterator[interpretation.Deviation]:
    """Yield the known mistakes, then the order that fits best."""
    yield from interpretation.joint_deviations(claimed, joints.model, joints.joint_pos)
    columns = joints.in_best_order(claimed).columns
    elsewhere = [
        f"{name} in column {found}"
        for name, place, found in zip(joints.model.joint_names, claimed.columns, columns, strict=True)
        if found != place
    ]
    yield interpretation.reordered(
        claimed, "joint order", f"in another order ({', '.join(elsewhere)})", np.array(columns)
    )


def _single_joints(
    joints: AnglesOfBodies, claimed: interpretation.Interpretation
) -> Check[interpretation.Interpretation]:
    """Return the reading with the signs and zeros of single joints corrected."""
    names, width, words = joints.model.joint_names, joints.joint_pos.shape[1], "as the bodies' poses imply"
    angles, implied = claimed.angles(joints.joint_pos), np.where(joints.has_column, joints.implied, np.nan)
    straight, turned = angles_apart(implied - angles), angles_apart(implied + angles)
    offsets = np.median(implied - angles, axis=0)
    off = straight > _ANGLE_TOLERANCE
    negated = off & (turned < 0.2 * straight)
    moved = off & ~negated & (angles_apart(implied - angles - offsets) < np.minimum(_ANGLE_TOLERANCE, 0.2 * straight))
    reading = replace(claimed, signs=tuple((np.where(negated, -1.0, 1.0) * np.array(claimed.signs)).tolist()))
    if negated.any():
        which = ", ".join(np.array(names)[negated])
        fix = interpretation.changes(claimed, reading, ROOT, width)
        yield contradiction("joint sign", words, f"negated for {which}", f"Negate {which}.", fix=fix)
    if moved.any():
        which = ", ".join(f"{offsets[i]:+.3f} rad to {names[i]}" for i in np.flatnonzero(moved))
        moved_by = replace(reading, offsets=tuple(np.where(moved, offsets, 0.0).tolist()))
        fix, reading = interpretation.changes(reading, moved_by, ROOT, width), moved_by
        yield contradiction("joint zero", words, f"off by {which}", f"Add {which}.", fix=fix)
    rest = np.flatnonzero(off & ~negated & ~moved)
    if len(rest):
        wrong = ", ".join(f"{names[i]} by {np.degrees(straight[i]):.1f} deg" for i in rest)
        advice = "Joints and bodies are of different motions or robots: write both from one configuration."
        yield contradiction("joints", words, f"they differ: {wrong}", advice)
    return reading


def _root(found: FoundBodies, pos: np.ndarray, quat: np.ndarray, claim: interpretation.Interpretation) -> FormatFinding:
    """Compare the root's own columns with the pose of the root's body."""
    base = replace(found.reading, quat_order=claim.quat_order, inverted=claim.inverted)
    body_pos, body_quat = found.reading.position(found.pos), found.reading.rotation(found.quat)
    moved = float(np.median(np.linalg.norm(base.position(pos) - body_pos, axis=1)))
    turned = float(np.median(se3.angle_between(base.rotation(quat), body_quat)))
    same = "the root's pose is that of its body"
    numbers = f"{1000 * moved:.2g} mm and {np.degrees(turned):.2g} deg apart"
    if moved < _ROOT_TOLERANCE_M and turned < _ROOT_TOLERANCE_RAD:
        return FormatFinding("ok", "root", same, numbers)
    for deviation in interpretation.rotation_deviations(base):
        if float(np.median(se3.angle_between(deviation.reading.rotation(quat), body_quat))) < 0.2 * turned:
            numbers = f"the root's quaternions are {deviation.is_}: {np.degrees(turned):.2g} deg apart as claimed"
            fix = interpretation.changes(base.of_poses, deviation.reading.of_poses, ROOT, 0)
            return contradiction(deviation.subject, same, numbers, deviation.advice, fix=fix)
    advice = "Write the root and the bodies from one configuration."
    return contradiction("root", same, numbers, advice)
