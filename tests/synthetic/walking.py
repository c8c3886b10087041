"""Footsteps: where the feet stand and when they move, and the path of the body that follows.

A stance foot is fixed exactly. A step first lifts the heel about the standing toe, then the
toe travels and lands flat. The body's place on the floor is the mean of the feet, smoothed
over two steps, so that it moves at a nearly even speed and leads the feet as people do.

Everything that moves in a synthetic clip is a sum of smooth functions of time. They are twice
continuously differentiable, so velocities and accelerations have no jumps, and continuous in
time, so any frame rate samples the same motion.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.skeleton import JOINT_INDEX
from hoi_retarget.human.t_pose import rest_offsets
from hoi_retarget.numerics import se3
from synthetic.human import ANKLE_HEIGHT, SIDES, FootGoal, Scalars, Vectors, heading_quat

Times = Float[np.ndarray, "T"]


def minimum_jerk(times: Times, start: float, end: float) -> Times:
    """Return a rise from 0 at `start` [s] to 1 at `end` [s] that begins and ends at rest."""
    phase = np.clip((times - start) / (end - start), 0.0, 1.0)
    return phase**3 * (10.0 + phase * (6.0 * phase - 15.0))


def bump(times: Times, start: float, end: float) -> Times:
    """Return a hump between `start` [s] and `end` [s], 1 in the middle and 0 outside."""
    phase = np.clip((times - start) / (end - start), 0.0, 1.0)
    return (4.0 * phase * (1.0 - phase)) ** 3


def keyed(times: Times, keys: Sequence[tuple[float, float]]) -> Times:
    """Return values that pass through `(time [s], value)` keys in order of time, resting at each."""
    values = np.full(times.shape, keys[0][1])
    for (start, before), (end, after) in pairwise(keys):
        if after != before:
            values += (after - before) * minimum_jerk(times, start, end)
    return values


def soft_excess(values: np.ndarray, width: float) -> np.ndarray:
    """Return a smooth version of `max(values, 0)` that rounds the corner over about `width`."""
    return width * np.logaddexp(0.0, values / width)


STEP_SECONDS = 0.56
HEEL_LIFT = 0.15
"""Part of a step's time in which only the heel rises, while the other foot already stands."""
LANDED = 0.93
"""Part of a step's time after which the foot stands, so that both feet do for a moment."""
STANCE_HALF_WIDTH = 0.052  # of the height, like the next one
ANKLE_BEHIND_BODY = 0.026
TOE_CLEARANCE = 0.055  # [m]
HEEL_RISE = 0.75  # [rad] for a step of a quarter of the height


@dataclass(frozen=True)
class Place:
    """A place to stand on the floor: position [m] and heading [rad] about up, 0 looks along +x."""

    x: float
    y: float
    yaw: float = 0.0

    def ahead(self, forward: float, left: float = 0.0, turn: float = 0.0) -> "Place":
        """Return the place that lies `forward` and `left` of this one [m], turned by `turn` [rad]."""
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        return Place(
            float(self.x + cosine * forward - sine * left),
            float(self.y + sine * forward + cosine * left),
            self.yaw + turn,
        )

    def line_to(self, other: "Place") -> Callable[[float], "Place"]:
        """Return the straight path to another place, by the share of it that is gone."""
        return lambda fraction: self.toward(other, fraction)

    def toward(self, other: "Place", fraction: float) -> "Place":
        """Return the place at `fraction` of the straight way to another one."""
        return Place(
            self.x + fraction * (other.x - self.x),
            self.y + fraction * (other.y - self.y),
            self.yaw + fraction * (other.yaw - self.yaw),
        )


@dataclass(frozen=True)
class Step:
    """One foot moves: `side` (0 left, 1 right) to its spot at a body place."""

    side: int
    start: float
    """When the heel begins to rise [s]."""
    end: float
    """When the foot stands again [s]."""
    place: Place
    """Where the body would stand above both feet if the other foot were beside this one."""

    @property
    def travel_start(self) -> float:
        """When the toe leaves the floor [s]."""
        return self.start + HEEL_LIFT * (self.end - self.start)


@dataclass(frozen=True)
class Walk:
    """A beginning place and the steps taken from there, in order of time."""

    begin: Place
    steps: tuple[Step, ...] = ()

    @property
    def place(self) -> Place:
        """Where the walk ends."""
        return self.steps[-1].place if self.steps else self.begin

    @property
    def end(self) -> float:
        """When the last foot lands [s]."""
        return self.steps[-1].end if self.steps else 0.0

    def along(
        self, path: Callable[[float], Place], *, start: float, count: int, side: int = 0, seconds: float = STEP_SECONDS
    ) -> "Walk":
        """Return this walk followed by steps along a path, feet together at the end.

        Args:
            path: Places from 0 to 1.
            start: Time of the first step [s].
            count: Number of steps; the first and the last one are half as long as the others.
            side: Of the foot of the first step: 0 left, 1 right.
            seconds: Duration of a step [s].
        """
        places = [path(min((index + 1) / (count - 1), 1.0)) for index in range(count)]
        return self._followed_by(places, start, side, seconds)

    def sidestep(self, goal: Place, *, start: float, pairs: int, side: int, seconds: float = STEP_SECONDS) -> "Walk":
        """Return this walk followed by steps to the side: the leading foot goes out, the other one follows.

        Args:
            goal: The place at the end.
            start: Time of the first step [s].
            pairs: Number of steps of each foot.
            side: Of the leading foot: 0 left, 1 right.
            seconds: Duration of a step [s].
        """
        begin = self.place
        places = [begin.toward(goal, (index // 2 + 1) / pairs) for index in range(2 * pairs)]
        return self._followed_by(places, start, side, seconds)

    def _followed_by(self, places: Sequence[Place], start: float, side: int, seconds: float) -> "Walk":
        """Return this walk followed by a step to each place, by one foot and the other in turn."""
        steps = [
            Step((side + index) % 2, start + index * seconds, start + (index + LANDED) * seconds, place)
            for index, place in enumerate(places)
        ]
        return replace(self, steps=(*self.steps, *steps))


@dataclass(frozen=True, eq=False)
class Ground:
    """Where the body is above the floor: one row a frame."""

    position: Vectors
    """Point on the floor below the pelvis when upright [m]."""
    yaw: Scalars
    """Heading [rad]."""
    sway: Scalars
    """Shift of the weight to the left (1) or right (-1) foot."""
    stride: Scalars
    """How far the right foot is ahead of the left one [m]."""


def ground_of(walk: Walk, height: float, times: Times) -> Ground:
    """Return the body's path over the floor."""
    standing = [walk.begin, walk.begin]
    before = walk.begin
    x, y, yaw = (np.full(times.shape, value) for value in (before.x, before.y, before.yaw))
    sway = np.zeros(times.shape)
    for step in walk.steps:
        standing[step.side] = step.place
        after = standing[0].toward(standing[1], 0.5)
        middle, duration = 0.5 * (step.travel_start + step.end), (step.end - step.start) / LANDED
        progress = minimum_jerk(times, middle - duration, middle + duration)
        x += (after.x - before.x) * progress
        y += (after.y - before.y) * progress
        yaw += (after.yaw - before.yaw) * progress
        sway += (1.0 if step.side else -1.0) * bump(times, step.start - 0.35 * duration, step.end + 0.35 * duration)
        before = after
    feet = [_foot_path(walk, height, side, times)[0] for side in range(2)]
    forward = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    stride = np.sum((feet[1] - feet[0])[:, :2] * forward, axis=1)
    return Ground(np.stack([x, y, np.zeros_like(x)], axis=1), yaw, sway, stride)


def feet_of(walk: Walk, height: float, times: Times) -> tuple[FootGoal, FootGoal]:
    """Return the motion of both feet."""
    zero, feet = np.zeros(times.shape), []
    for side in range(2):
        toe, yaw, pitch = _foot_path(walk, height, side, times)
        quat = heading_quat(yaw, pitch, zero)
        ankle = toe - se3.rotate(quat, _toe_offset(height, side)[None])
        # The toes stay flat while the heel rises, and follow the foot half-way when it swings.
        toe_quat = heading_quat(yaw, 0.4 * pitch, zero)
        feet.append(FootGoal(ankle, quat, toe_quat, np.stack([np.cos(yaw), np.sin(yaw), zero], axis=1)))
    return feet[0], feet[1]


def _foot_path(walk: Walk, height: float, side: int, times: Times) -> tuple[Vectors, Scalars, Scalars]:
    """Return the toe's position [m] and the foot's yaw and pitch [rad, positive lifts the heel]."""
    place = walk.begin
    toe = np.repeat(_toe(place, height, side)[None], len(times), axis=0)
    yaw = np.full(times.shape, place.yaw)
    pitch = np.zeros(times.shape)
    for step in (step for step in walk.steps if step.side == side):
        progress = minimum_jerk(times, step.travel_start, step.end)
        move = _toe(step.place, height, side) - _toe(place, height, side)
        toe += progress[:, None] * move
        toe[:, 2] += TOE_CLEARANCE * bump(times, step.travel_start, step.end)
        yaw += progress * (step.place.yaw - place.yaw)
        # A long step forward rolls over the toe and lands heel first, a sideways or backward one does not.
        ahead = float(np.cos(place.yaw) * move[0] + np.sin(place.yaw) * move[1]) / (0.5 * height)
        roll = HEEL_RISE * np.clip(ahead, 0.12, 1.2)
        duration = step.end - step.start
        pitch += roll * bump(times, step.start, step.start + 0.72 * duration)
        pitch -= 0.22 * roll * bump(times, step.start + 0.45 * duration, step.end)
        place = step.place
    return toe, yaw, pitch


def _toe(place: Place, height: float, side: int) -> np.ndarray:
    offset = _toe_offset(height, side)
    outward = STANCE_HALF_WIDTH * height * (1.0 if side == 0 else -1.0)
    spot = place.ahead(offset[2] - ANKLE_BEHIND_BODY * height, outward + offset[0])
    return np.array([spot.x, spot.y, ANKLE_HEIGHT * height + offset[1]])


def _toe_offset(height: float, side: int) -> np.ndarray:
    return rest_offsets(height)[JOINT_INDEX[f"{SIDES[side]}_foot"]]
