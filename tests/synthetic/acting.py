"""One person acts: walks, bends, looks and grips objects of given motion.

Legs and arms are solved so that planted feet and gripping palms are exactly where they
belong. Where a grip would be out of reach, the pelvis follows, smoothly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import HANDS
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack
from synthetic.human import (
    MAXIMUM_REACH,
    SIDES,
    STANDING_PELVIS_HEIGHT,
    Body,
    FootGoal,
    HandGoal,
    Quats,
    Scalars,
    Trunk,
    Vectors,
    hand_quat,
    heading_quat,
    palm_offset,
)
from synthetic.walking import Ground, Times, Walk, feet_of, ground_of, keyed, minimum_jerk, soft_excess

PALM_CLEARANCE = 0.025
"""How far the middle of a gripping hand lies outside the surface it touches [m]."""
_RELAXED_CURL = 0.28  # [rad] per finger joint
_APPROACH_SECONDS = 0.85
_STANDOFF = 0.09  # [m] by which a hand stays off the surface until it closes
_CLOSING_SECONDS = 0.35
_COMFORTABLE_REACH = 0.925
_HANGING_REACH = 0.955
_FREE_REACH = 0.95
"""A holding hand must stay within this part of the arm's length, beyond it goals are shortened."""

Triple = tuple[float, float, float]
Span = tuple[float, float]
"""From touch to release [s]."""
Keys = tuple[tuple[float, float], ...]
_STILL: Keys = ((0.0, 0.0),)


@dataclass(frozen=True)
class Grip:
    """One hand holds one place of one object for a span of time."""

    side: int
    """0 left, 1 right."""
    surface: Triple
    """Point of the surface below the middle of the hand, in the object's frame [m]."""
    outward: Triple
    """Unit normal of the surface there, in the object's frame: where the hand comes from."""
    fingers: Triple
    """Direction in which the hand points from wrist to fingers, in the object's frame."""
    span: Span
    """From touch to release [s]."""
    palm: Triple | None = None
    """Direction that the palm faces, in the object's frame; None: against `outward`."""
    curl: float = 0.15
    """How far each finger joint is bent [rad]."""
    object: int = 0

    @property
    def point(self) -> Float[np.ndarray, "3"]:
        """Contact point in the object's frame [m]: the middle of the hand."""
        return np.array(self.surface) + PALM_CLEARANCE * np.array(self.outward)

    def closeness(self, times: Times) -> Scalars:
        """Return 1 while the hand holds, falling to 0 before and after."""
        touch, release = self.span
        rise = minimum_jerk(times, touch - _APPROACH_SECONDS, touch)
        return rise * (1.0 - minimum_jerk(times, release, release + _APPROACH_SECONDS))

    def standoff(self, times: Times) -> Scalars:
        """Return the distance of the hand from its contact point before it closes and after it opens [m]."""
        touch, release = self.span
        closed = minimum_jerk(times, touch - _CLOSING_SECONDS, touch)
        opened = minimum_jerk(times, release, release + _CLOSING_SECONDS)
        return _STANDOFF * (1.0 - closed + opened)

    def active(self, times: Times) -> np.ndarray:
        """Return the frames in which the hand holds."""
        return (times >= self.span[0]) & (times <= self.span[1])


@dataclass(frozen=True)
class Actor:
    """The actions of one person: keys are `(time [s], value)` in order of time."""

    name: str
    height: float
    walk: Walk
    grips: tuple[Grip, ...]
    crouch: Keys = _STILL
    """0 stands, 1 squats."""
    lean: Keys = _STILL
    """Forward pitch of the trunk beyond what crouching needs [rad]."""
    gaze: Keys = _STILL
    """Forward pitch of the head [rad]."""
    twist: Keys = _STILL
    """Turn of the chest to the left against the pelvis [rad]."""
    roll: Keys = _STILL
    """Sideways lean of the trunk to the right [rad]."""
    elbows: tuple[Triple, Triple] = field(default=((-0.7, 0.45, -0.45), (-0.7, -0.45, -0.45)))
    """Where the elbows point: forward, left, up relative to the body."""


@dataclass(frozen=True, eq=False)
class _Moment:
    """All that surrounds an actor at the times asked for."""

    times: Times
    ground: Ground
    objects: Sequence[ObjectTrack]


def act(actor: Actor, times: Times, objects: Sequence[ObjectTrack]) -> Person:
    """Return the person's motion at `times` [s]."""
    ground = ground_of(actor.walk, actor.height, times)
    moment = _Moment(times, ground, objects)
    feet = feet_of(actor.walk, actor.height, times)
    trunk = _trunk(actor, times, ground)
    body = Body(actor.height, len(times))
    arm = body.limb_length("left_elbow", "left_wrist")
    shift = np.zeros((len(times), 3))
    hands: list[HandGoal] = []
    # Reaching further moves the shoulders, lowering the pelvis for the legs moves them back: a few
    # rounds settle both. Every round is a smooth function of time, so the result is one too.
    for _ in range(8):
        pelvis = _lower_to_legs(actor.height, trunk.pelvis + shift, trunk.pelvis_quat, feet)
        body.set_trunk(Trunk(pelvis, trunk.pelvis_quat, trunk.chest_quat, trunk.head_quat))
        hands = [_hand_goal(actor, side, moment, body) for side in range(2)]
        shift = shift + _reach_shift(body, hands, arm)
    for side, name in enumerate(SIDES):
        body.set_foot(name, feet[side])
        body.set_hand(name, _stretched(hands[side], body.position(f"{name}_shoulder"), arm))
    return body.person(actor.name)


def contacts_of(actor: Actor, person: int, times: Times) -> tuple[ContactTrack, ...]:
    """Return the contact tracks of an actor, one for each hand and object it ever touches."""
    tracks = []
    for side, target in sorted({(grip.side, grip.object) for grip in actor.grips}):
        active = np.zeros(len(times), dtype=bool)
        points = np.full((len(times), 3), np.nan)
        for grip in actor.grips:
            if (grip.side, grip.object) == (side, target):
                holds = grip.active(times)
                active |= holds
                points[holds] = grip.point
        tracks.append(ContactTrack(person, target, HANDS[side], active, points))
    return tuple(tracks)


def _trunk(actor: Actor, times: Times, ground: Ground) -> Trunk:
    height = actor.height
    crouch, lean = keyed(times, actor.crouch), keyed(times, actor.lean)
    stride = ground.stride / height
    roll = keyed(times, actor.roll)
    # The pelvis turns with the leading leg, the chest against it; the trunk tips over the standing leg.
    pelvis_yaw = ground.yaw + 0.35 * stride
    chest_yaw = ground.yaw - 0.30 * stride + keyed(times, actor.twist)
    pelvis_quat = heading_quat(pelvis_yaw, 0.78 * crouch + 0.45 * lean, 0.4 * roll - 0.03 * ground.sway)
    chest_quat = heading_quat(chest_yaw, 0.03 + 1.20 * crouch + lean, roll + 0.012 * ground.sway)
    head_yaw = ground.yaw + 0.6 * keyed(times, actor.twist)
    head_quat = heading_quat(head_yaw, 0.05 + 0.45 * crouch + keyed(times, actor.gaze), 0.3 * roll)
    forward, left = _directions(ground.yaw)
    # Hips go back as the trunk comes forward, so that the weight stays over the feet.
    back = height * (0.10 * crouch + 0.10 * np.sin(lean))
    pelvis = ground.position - back[:, None] * forward + (0.012 * height * ground.sway)[:, None] * left
    pelvis[:, 2] = height * (STANDING_PELVIS_HEIGHT - 0.28 * crouch)
    return Trunk(pelvis, pelvis_quat, chest_quat, head_quat)


def _directions(yaw: Scalars) -> tuple[Vectors, Vectors]:
    zero = np.zeros(yaw.shape)
    return np.stack([np.cos(yaw), np.sin(yaw), zero], axis=1), np.stack([-np.sin(yaw), np.cos(yaw), zero], axis=1)


def _lower_to_legs(height: float, pelvis: Vectors, pelvis_quat: Quats, feet: tuple[FootGoal, FootGoal]) -> Vectors:
    """Return the pelvis, lowered smoothly where a leg would otherwise be too short."""
    body = Body(height, 1)
    reach = (MAXIMUM_REACH - 0.005) * body.limb_length("left_knee", "left_ankle")
    limits = [pelvis[:, 2]]
    for side, foot in zip(SIDES, feet, strict=True):
        hip = se3.rotate(pelvis_quat, body.offset(f"{side}_hip")[None])
        away = (pelvis + hip - foot.ankle)[:, :2]
        upright = np.sqrt(np.maximum(reach**2 - np.sum(away**2, axis=1), 0.01 * reach**2))
        limits.append(foot.ankle[:, 2] + upright - hip[:, 2])
    width = 0.009 * height
    lowest = -width * np.logaddexp.reduce(-np.stack(limits) / width, axis=0)
    return np.concatenate([pelvis[:, :2], lowest[:, None]], axis=1)


def _reach_shift(body: Body, hands: Sequence[HandGoal], arm: float) -> Vectors:
    """Return the shift that brings the shoulders closer to their hands' goals [m]."""
    shift = np.zeros_like(body.position("pelvis"))
    for side, goal in zip(SIDES, hands, strict=True):
        line = goal.wrist - body.position(f"{side}_shoulder")
        distance = np.linalg.norm(line, axis=1)
        # Free hands hang at a longer reach than this, but move with the shoulder: they ask for nothing.
        excess = soft_excess(distance - _COMFORTABLE_REACH * arm, 0.008 * arm) * goal.hold**3
        shift += (excess / distance)[:, None] * line
    # Two hands that ask for the same are not to be served twice.
    both = hands[0].hold * hands[1].hold
    return 0.8 * shift / (1.0 + both)[:, None]


def _hand_goal(actor: Actor, side: int, moment: _Moment, body: Body) -> HandGoal:
    name = SIDES[side]
    forward, left = _directions(moment.ground.yaw)
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), forward.shape)
    outward = left if side == 0 else -left
    # Arms swing against the legs.
    swing = (0.62 if side == 0 else -0.62) * moment.ground.stride / actor.height
    direction = 0.10 * outward - up + (0.07 + swing)[:, None] * forward
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    arm = body.limb_length(f"{name}_elbow", f"{name}_wrist")
    wrist = body.position(f"{name}_shoulder") + _HANGING_REACH * arm * direction
    quat = hand_quat(name, direction + 0.18 * forward, 0.25 * forward - outward)
    hold, curl = np.zeros(moment.times.shape), np.full(moment.times.shape, _RELAXED_CURL)
    for grip in (grip for grip in actor.grips if grip.side == side):
        closeness = grip.closeness(moment.times)
        curl += (grip.curl - _RELAXED_CURL) * closeness
        hold += closeness
    # The palm's place in the wrist depends on the fingers' curl, so wrists follow after all curls are known.
    for grip in (grip for grip in actor.grips if grip.side == side):
        closeness = grip.closeness(moment.times)
        grip_wrist, grip_quat = _grip_pose(actor.height, grip, moment.times, curl, moment.objects[grip.object])
        wrist = wrist + closeness[:, None] * (grip_wrist - wrist)
        quat = se3.slerp(quat, grip_quat, closeness)
    ahead, aside, above = actor.elbows[side]
    pole = ahead * forward + aside * left + above * up
    return HandGoal(wrist, quat, pole, curl, hold)


def _stretched(goal: HandGoal, shoulder: Vectors, arm: float) -> HandGoal:
    """Return the goal, brought smoothly nearer where it is further away than the arm can be.

    A hand on its way to a place that is still out of reach stretches towards it. Holding hands are
    within the free range, where nothing changes.
    """
    free, largest = _FREE_REACH * arm, (MAXIMUM_REACH - 0.002) * arm
    line = goal.wrist - shoulder
    distance = np.linalg.norm(line, axis=1, keepdims=True)
    if (holding := goal.hold == 1.0).any() and distance[holding].max() > free:
        raise AssertionError(f"a held place is {distance[holding].max() / arm:.3f} of the arm's length away")
    # tanh begins with slope 1 and no curvature: the seam is twice differentiable.
    beyond = np.maximum(distance - free, 0.0) / (largest - free)
    length = np.minimum(distance, free) + (largest - free) * np.tanh(beyond)
    # The wrist itself is kept where nothing is shortened, so that held places are exact.
    return replace(goal, wrist=np.where(distance > free, shoulder + line * (length / distance), goal.wrist))


def _grip_pose(height: float, grip: Grip, times: Times, curl: Scalars, track: ObjectTrack) -> tuple[Vectors, Quats]:
    name = SIDES[grip.side]
    outward = np.array(grip.outward)
    palm = -outward if grip.palm is None else np.array(grip.palm)
    in_object = hand_quat(name, np.array([grip.fingers]), palm[None])
    quat = se3.quat_multiply(track.quats, in_object)
    point = grip.point + grip.standoff(times)[:, None] * outward
    centre = track.positions + se3.rotate(track.quats, point)
    return centre - se3.rotate(quat, palm_offset(height, name, curl)), quat
