"""The choice of a hold for each episode: hands laid onto an object around the person's pose, the best one of them.

What counts is the area of touch, the distance from the person's place and pose, depth, and the reach of the arm. Forces
do not: `simulated_holds` tries whether holds keep an object.
"""

import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import replace
from weakref import ReferenceType, ref

import numpy as np
from jaxtyping import Float

from hoi_retarget.dynamics.free_hands import palm_skin, touch_of
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import evenly_spaced
from hoi_retarget.objects.distance_field import DistanceField
from hoi_retarget.retargeting.holds import hand_settling
from hoi_retarget.retargeting.holds.arm_reach import reach
from hoi_retarget.retargeting.holds.hand_shape import HandPoses, HandShape, hand_shape
from hoi_retarget.retargeting.holds.hold import Hold, PersonHold
from hoi_retarget.retargeting.surfaces.skin_points import MovingObject
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.robots.model import Kinematics, RobotModel

TURNED_TO_SURFACE = (0.0, 0.35, 0.7, 1.0)
"""Shares of the turn that lays the palm onto the surface: the first candidates."""
NEAR, FAR = 60, 36  # Numbers of candidates by lot,
NEAR_SPREAD, FAR_SPREAD = (0.025, 0.3), (0.05, 0.5)
"""and their distances from the person's pose, as standard deviations [m, rad]."""
MIRRORED = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Lots of right hands: the left palm's side is the right one's other side."""
SPREAD = (0.03, 0.5)  # Distances from the person's pose that cost half as much as 1 cm2 of touch is worth [m, rad].
PLACE = 0.03  # The same of the touch from the person's place on the surface [m].
ASKED = 0.0075
"""And of the palm along the surface where somebody edited the contact [m]: it is to be where they put it."""
ASKED_TURN = 0.1  # And of its turn where somebody turned it [rad].
DIFFERENT = (0.01, np.radians(15.0))  # Holds that differ by less in place and in turn count as one [m, rad].
ENOUGH_AREA = 4.0  # [cm2]; more touch is worth nothing.
ROUGHLY, TOUCHING, LARGEST_DEPTH = 0.005, 0.002, 0.0005
"""Distances at which skin touches, before and after the last millimetres, and depth without a cost [m]."""
POLISHED = 24  # Candidates that are laid on to the last millimetre.
DEPTH_COST, DEEPEST, STUCK_COST = 1e3, 0.0015, 100.0
"""Of a metre deeper; of more than a depth [m], at which no force holds a candidate any more."""
OFF, TURNED, DEEP = 0.004, 0.1, 0.004
"""Errors of reach, and depth of the arm, that cost as much as 1 cm2 is worth [m, rad, m]."""
BENT = 0.8  # [rad]; a change of the arm's joints that costs half as much: others are an arm held in another way.
LARGEST_COST = 20.0  # Of a frame that is out of reach.
FINALISTS, FRAMES = 12, 8  # Candidates of an episode whose reach is looked at, and frames in which it is.


def chosen_holds(
    targets: Targets, objects: tuple[MovingObject, ...], persons: Sequence[PersonHold], start: Kinematics
) -> tuple[Hold, ...]:
    """Return the holds of episodes.

    `targets`: of the robot; `objects`: of its world; `persons`: the person's; `start`: the IK trajectory.
    """
    hands = [hand_shape(start.model, targets.contact_links[held.episode.link]) for held in persons]
    return tuple(
        _remembered(held, hand, objects[held.episode.object], start) for held, hand in zip(persons, hands, strict=True)
    )


_KNOWN: OrderedDict[bytes, tuple[ReferenceType[DistanceField], ReferenceType[RobotModel], Hold]] = OrderedDict()
"""Last holds that were chosen, by all that they depend on: an edit changes one of many."""
_MOST_KNOWN = 32


def _remembered(held: PersonHold, hand: HandShape, moving_object: MovingObject, start: Kinematics) -> Hold:
    """Return the same as `best_hold`, looked for once."""
    frames = held.episode.frames
    wanted = held.asked.positions, held.asked.rotations, np.array([held.rank, held.edited, *held.turn, frames.start])
    there = moving_object.position[:, frames], moving_object.rotation[:, :, frames], start.qpos[frames]
    key = hashlib.sha256(f"{id(start.model)} {id(moving_object.field)} {hand.site} {frames.stop}".encode())
    for part in (*wanted, *there):
        key.update(np.ascontiguousarray(part, dtype=float).data)
    if found := _KNOWN.get(key.digest()):
        field, model, known = found
        # Another object or robot may have come to be where the known one was.
        if field() is moving_object.field and model() is start.model:
            return replace(known, person=held)
    best = best_hold(held, hand, moving_object, start)
    _KNOWN[key.digest()] = ref(moving_object.field), ref(start.model), best
    if len(_KNOWN) > _MOST_KNOWN:
        _KNOWN.popitem(last=False)
    return best


def best_hold(held: PersonHold, hand: HandShape, moving_object: MovingObject, start: Kinematics) -> Hold:
    """Return the best hold of an episode by itself.

    `held`: the person's hold; `hand`: the robot's hand; `moving_object`: the object; `start`: the IK trajectory.
    """
    person = held.asked
    distance, normal = moving_object.field.distances_and_normals(person.positions)
    stiffness = hand_settling.pull(SPREAD)
    if held.edited:
        stiffness[:3, :3] += (ASKED**-2.0 - SPREAD[0] ** -2.0) * (np.eye(3) - np.outer(normal[0], normal[0]))
    if any(held.turn):
        stiffness[3:, 3:] += (ASKED_TURN**-2.0 - SPREAD[1] ** -2.0) * np.eye(3)
    candidates = hand_settling.settled(
        hand, moving_object, _seeds(person, hand, moving_object), person, stiffness, hand_settling.FAR_REACHES
    )
    rough = 1e4 * hand_settling.touching_areas(hand, moving_object, candidates, ROUGHLY)
    rough = np.minimum(rough, 2.0 * ENOUGH_AREA) - _distance_costs(candidates, person, stiffness)
    rough -= DEPTH_COST * np.maximum(hand_settling.skin_depths(hand, moving_object, candidates) - ROUGHLY, 0.0)
    candidates = candidates.take(np.argsort(-rough, kind="stable")[:POLISHED])
    candidates = hand_settling.settled(hand, moving_object, candidates, person, stiffness, hand_settling.NEAR_REACHES)
    candidates = hand_settling.touching(hand, moving_object, candidates)
    areas = hand_settling.touching_areas(hand, moving_object, candidates, TOUCHING)
    deep = hand_settling.depths(hand, moving_object, candidates)
    skin, poses = palm_skin(start.model, hand.site), zip(candidates.positions, candidates.rotations, strict=True)
    touches = [touch_of(skin, moving_object.field, *pose) for pose in poses]
    middles = np.array([touch.middle for touch in touches])
    place = np.linalg.norm(middles - (person.positions - distance[:, None] * normal), axis=1)
    scores = np.minimum(1e4 * areas, ENOUGH_AREA) - DEPTH_COST * np.maximum(deep - LARGEST_DEPTH, 0.0)
    scores -= np.where(deep > DEEPEST, STUCK_COST, 0.0)
    scores -= _distance_costs(candidates, person, stiffness) + 0.5 * (place / PLACE) ** 2
    finalists = np.argsort(-scores, kind="stable")[:FINALISTS]
    frames = held.episode.first + evenly_spaced(held.episode.stop - held.episode.first, FRAMES)
    poses = candidates.take(finalists)
    found = reach(start, hand.site, moving_object, frames, poses)
    missed = (found.off / OFF) ** 2 + (found.turned / TURNED) ** 2 + (np.maximum(found.depth, 0.0) / DEEP) ** 2
    missed += 0.5 * (found.bent / BENT) ** 2
    totals = scores[finalists] - np.minimum(missed, LARGEST_COST).mean(axis=1)
    ranked = _different(poses, np.argsort(-totals, kind="stable").tolist())
    rank = held.rank % len(ranked)
    best = ranked[rank]
    choice = float(totals[best]), rank, len(ranked)
    return Hold(held, touches[finalists[best]], frames, found.off[best], float(areas[finalists[best]]), *choice)


def _different(poses: HandPoses, ranked: list[int]) -> list[int]:
    """Return the poses that differ from all that are better, the best one first."""
    found: list[int] = []
    for index in ranked:
        own = poses.take(np.array([index]))
        away = np.abs([own.away_from(poses.take(np.array([other])))[0] for other in found]).reshape(-1, 2, 3)
        if (np.linalg.norm(away, axis=2) > DIFFERENT).any(axis=1).all():
            found.append(index)
    return found


def _distance_costs(poses: HandPoses, person: HandPoses, stiffness: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "N"]:
    away = poses.away_from(person)
    return 0.5 * np.einsum("ni,ij,nj->n", away, stiffness, away)


def _seeds(person: HandPoses, hand: HandShape, moving_object: MovingObject) -> HandPoses:
    """Return the poses from which hands are laid on: by lot, in the palm's axes, and mirrored for right hands."""
    _, normals = moving_object.field.distances_and_normals(person.positions)
    turn = person.rotations[0]
    laid = se3.log(se3.shortest_rotation(turn @ hand.inward, -normals[0])[None])[0]
    random, mirrored = np.random.default_rng(0), MIRRORED if hand.site.startswith("right") else 1.0
    twists = [np.concatenate([np.zeros(3), share * laid]) for share in TURNED_TO_SURFACE]
    for count, spread in ((NEAR, NEAR_SPREAD), (FAR, FAR_SPREAD)):
        for _ in range(count):
            lot = np.repeat(spread, 3) * mirrored * random.standard_normal(6)
            twists.append((lot.reshape(2, 3) @ turn.T).ravel() + random.uniform() * np.append(np.zeros(3), laid))
    many = len(twists)
    repeated = HandPoses(np.repeat(person.positions, many, axis=0), np.repeat(person.rotations, many, axis=0))
    return repeated.moved(np.array(twists))
