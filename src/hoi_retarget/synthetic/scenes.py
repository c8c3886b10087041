"""The scenes: who walks where and when, what is held, and how the object moves.

Each scene goes somewhere (`there`) and comes back to the pose it began in (`cycle`), where it
rests, so that it can be repeated without a seam.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hoi_retarget import se3
from hoi_retarget.clip import ObjectTrack
from hoi_retarget.synthetic.acting import Actor, Grip
from hoi_retarget.synthetic.human import Scalars
from hoi_retarget.synthetic.objects import Shape, shape
from hoi_retarget.synthetic.timing import Times, minimum_jerk
from hoi_retarget.synthetic.walking import Ground, Place, Walk, ground_of


@dataclass(frozen=True)
class Scene:
    """A scene as functions of time."""

    there: float
    """Duration of the way there [s]."""
    cycle: float
    """Duration of the way there and back [s]."""
    actors: tuple[Actor, ...]
    objects: Callable[[Times], tuple[ObjectTrack, ...]]


@dataclass(frozen=True)
class Carry:
    """An object is moved from its resting place into a pose relative to the walker, and put down."""

    lift: float
    """When it begins to leave the floor [s]."""
    lifted: float
    """When it has reached its place before the walker [s]."""
    lower: float
    """When it begins to go down [s]."""
    lowered: float
    """When it rests again [s]."""
    origin: Place
    """Where it rests before."""
    goal: Place
    """Where it rests after."""
    raised: float
    """Height of its origin above its resting height while carried [m]."""
    forward: float
    """Distance of its origin before the walker while carried [m]."""


def carried(shape: Shape, carries: tuple[Carry, ...], ground: Ground, times: Times) -> ObjectTrack:
    """Return the motion of an object that is carried, upright, before a walker."""
    first = carries[0].origin
    x, y, yaw = (np.full(times.shape, value) for value in (first.x, first.y, first.yaw))
    z = np.full(times.shape, shape.half[2])
    for carry in carries:
        up = minimum_jerk(times, carry.lift, carry.lifted)
        down = minimum_jerk(times, carry.lower, carry.lowered)
        held = _held(carry, ground)
        before, after = carry.origin, carry.goal
        for values, begin, middle, end in (
            (x, before.x, held[0], after.x),
            (y, before.y, held[1], after.y),
            (yaw, before.yaw, held[2], after.yaw),
        ):
            values += up * (middle - begin) + down * (end - middle)
        z += carry.raised * (up - down)
    return ObjectTrack(shape.name, np.stack([x, y, z], axis=1), _upright(yaw), shape.geometry)


def _held(carry: Carry, ground: Ground) -> tuple[Scalars, Scalars, Scalars]:
    x = ground.position[:, 0] + carry.forward * np.cos(ground.yaw)
    y = ground.position[:, 1] + carry.forward * np.sin(ground.yaw)
    return x, y, ground.yaw


def _upright(yaw: Scalars) -> np.ndarray:
    return se3.exp(yaw[:, None] * np.array([0.0, 0.0, 1.0]))


def carry_box(height: float, seed: int) -> Scene:
    """Walk to a box on the floor, squat, lift it with both hands, carry it round a turn, set it down."""
    generator = np.random.default_rng(seed)
    box = shape("box", seed)
    stride = height * (0.24 + 0.02 * float(generator.uniform(-1, 1)))
    turn = np.pi / 2 + 0.2 * float(generator.uniform(-1, 1))
    reach = 0.145 * height + box.half[0]
    carry_reach = 0.10 * height + box.half[0]
    raised = 0.56 * height - box.size[2] / 2

    begin = Place(0.0, 0.0)
    pick = begin.ahead(2 * stride)
    far = pick.ahead(1.6 * stride, 1.6 * stride, turn)
    box_near, box_far = pick.ahead(reach), far.ahead(reach)
    walk = Walk(begin).to(pick, start=0.15, count=3)
    touch = walk.end + 0.75
    walk = walk.along(_arc(pick, far), start=touch + 0.75, count=5)
    release = walk.end + 0.95
    there = _rounded(release + 1.0)
    touch_back = there + 0.9
    walk = walk.along(_arc(far, pick), start=touch_back + 0.75, count=7)
    release_back = walk.end + 0.95
    walk = walk.to(begin, start=release_back + 0.7, count=3)
    cycle = _rounded(walk.end + 0.5)

    carries = (
        Carry(touch + 0.1, touch + 1.1, release - 1.05, release - 0.1, box_near, box_far, raised, carry_reach),
        Carry(touch_back + 0.1, touch_back + 1.1, release_back - 1.05, release_back - 0.1,
              box_far, box_near, raised, carry_reach),
    )  # fmt: skip
    spans = ((touch, release), (touch_back, release_back))
    grips = tuple(_side_grip(box, side, *span) for span in spans for side in range(2))
    actor = Actor("person", height, walk, grips, crouch=_dips(spans, 1.0, 0.9, 0.95), gaze=_dips(spans, 0.25, 0.9, 1.0))
    return Scene(there, cycle, (actor,), lambda times: (carried(box, carries, ground_of(walk, height, times), times),))


def _side_grip(box: Shape, side: int, touch: float, release: float) -> Grip:
    sign = 1.0 if side == 0 else -1.0
    return Grip(
        side,
        surface=(-0.02, sign * box.half[1], -0.02),
        outward=(0.0, sign, 0.0),
        fingers=(1.0, 0.0, -0.75),
        touch=touch,
        release=release,
    )


def _dips(
    spans: tuple[tuple[float, float], ...], depth: float, down: float, up: float
) -> tuple[tuple[float, float], ...]:
    """Return keys that go to `depth` around the beginning and the end of every span."""
    keys = [(0.0, 0.0)]
    for touch, release in spans:
        keys += [(touch - down, 0.0), (touch, depth), (touch + 0.1, depth), (touch + up + 0.1, 0.0)]
        keys += [(release - up - 0.1, 0.0), (release - 0.1, depth), (release, depth), (release + down, 0.0)]
    return tuple(keys)


def _arc(begin: Place, end: Place) -> Callable[[float], Place]:
    """Return a path that leaves `begin` and reaches `end` along their headings or against them."""

    def path(fraction: float) -> Place:
        chord = begin.toward(end, fraction)
        return chord

    return path


def _rounded(seconds: float) -> float:
    """Return a duration rounded up to a tenth of a second, so that common rates divide it."""
    return float(np.ceil(seconds * 10.0 - 1e-9) / 10.0)
