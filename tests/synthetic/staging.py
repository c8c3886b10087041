"""Parts of scenes: paths to walk, key times of bending, and objects that are moved."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack
from synthetic.acting import Actor, Keys, Span
from synthetic.human import Quats, Scalars
from synthetic.object_shapes import Shape
from synthetic.walking import Place, Times, Walk, ground_of, minimum_jerk

Anchor = Callable[[Times], tuple[Scalars, Scalars, Scalars]]
"""A place over time: x [m], y [m], yaw [rad]."""
Objects = Callable[[Times], tuple[ObjectTrack, ...]]


@dataclass(frozen=True)
class StagedScene:
    """A scene as functions of time, at rest at its beginning, after `there` and after `cycle`."""

    there: float
    """Duration of the way there [s]."""
    cycle: float
    """Duration of the way there and back, to the pose of the beginning [s]."""
    actors: tuple[Actor, ...]
    objects: Objects


def carried(  # the last three are durations and a height
    shape: Shape,
    spans: Sequence[Span],
    spots: Sequence[Place],
    anchor: Anchor,
    *,
    take: Span,
    put: Span,
    raised: float = 0.0,
) -> Objects:
    """Return the motion of an upright object that is carried from one spot to the next.

    Args:
        shape: Of the object.
        spans: When it is held.
        spots: Where it rests before, between and after.
        anchor: Its place while it is carried.
        take: Begin and end of taking it, from rest to moving with the walkers, after the touch [s].
        put: Begin and end of putting it down, before the release [s].
        raised: Height above the resting height while carried [m].
    """

    def objects(times: Times) -> tuple[ObjectTrack, ...]:
        x, y, yaw = (np.full(times.shape, value) for value in (spots[0].x, spots[0].y, spots[0].yaw))
        z = np.full(times.shape, shape.half[2])
        held_x, held_y, held_yaw = anchor(times)
        for (touch, release), (origin, goal) in zip(spans, pairwise(spots), strict=True):
            up = minimum_jerk(times, touch + take[0], touch + take[1])
            down = minimum_jerk(times, release - put[0], release - put[1])
            x += up * (held_x - origin.x) + down * (goal.x - held_x)
            y += up * (held_y - origin.y) + down * (goal.y - held_y)
            yaw += up * (held_yaw - origin.yaw) + down * (goal.yaw - held_yaw)
            z += raised * (up - down)
        return (ObjectTrack(shape.name, np.stack([x, y, z], axis=1), upright(yaw), shape.geometry),)

    return objects


def before(walk: Walk, height: float, forward: float, left: float = 0.0, turn: float = 0.0) -> Anchor:
    """Return the place that stays beside a walker.

    Args:
        walk: Of the walker.
        height: Of the walker [m].
        forward: From the walker [m].
        left: From the walker [m].
        turn: Against the walker's heading [rad].
    """

    def anchor(times: Times) -> tuple[Scalars, Scalars, Scalars]:
        ground = ground_of(walk, height, times)
        cosine, sine = np.cos(ground.yaw), np.sin(ground.yaw)
        x = ground.position[:, 0] + forward * cosine - left * sine
        y = ground.position[:, 1] + forward * sine + left * cosine
        return x, y, ground.yaw + turn

    return anchor


def upright(yaw: Scalars) -> Quats:
    """Return rotations about the vertical [rad]."""
    return se3.exp(yaw[:, None] * np.array([0.0, 0.0, 1.0]))


def arc(begin: Place, radius: float, turn: float) -> Callable[[float], Place]:
    """Return a path on a circle to the left, which turns by `turn` [rad]."""

    def path(fraction: float) -> Place:
        angle = fraction * turn
        return begin.ahead(radius * float(np.sin(angle)), radius * (1.0 - float(np.cos(angle))), angle)

    return path


def dips(spans: tuple[Span, ...], depth: float, *, down: float = 1.0, up: float = 1.1) -> Keys:
    """Return keys that reach a depth where spans begin and end, and 0 between: to pick up, to put down.

    Args:
        spans: When the object is held.
        depth: Value at the depth.
        down: Duration of the way there [s].
        up: Duration of the way back [s].
    """
    keys = [(0.0, 0.0)]
    for touch, release in spans:
        keys += [(touch - 0.1 - down, 0.0), (touch - 0.1, depth), (touch + 0.1, depth), (touch + 0.1 + up, 0.0)]
        keys += [(release - 0.1 - down, 0.0), (release - 0.1, depth), (release + 0.2, depth)]
        keys += [(release + 0.2 + up, 0.0)]
    return tuple(keys)


def holds(spans: tuple[Span, ...], depth: float, *, down: float = 1.0, up: float = 1.0) -> Keys:
    """Return keys that stay at a depth for the whole of every span; arguments are those of `dips`."""
    keys = [(0.0, 0.0)]
    for touch, release in spans:
        keys += [(touch - down, 0.0), (touch, depth), (release, depth), (release + up, 0.0)]
    return tuple(keys)


def rounded(seconds: float) -> float:
    """Return a duration [s] rounded up to a tenth of a second, so that common rates divide it."""
    return float(np.ceil(seconds * 10.0 - 1e-9) / 10.0)
