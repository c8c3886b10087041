"""The scenes: walks, grips and the motion of objects.

Each scene goes somewhere and comes back to the pose it began in, at rest, so that it can be
repeated without a seam. Times are in seconds, places in metres.
"""

from collections.abc import Callable

import numpy as np

from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectTrack
from synthetic.acting import Actor, Grip
from synthetic.human import Scalars
from synthetic.object_shapes import Shape, shape
from synthetic.staging import Span, StagedScene, arc, before, carried, dips, holds, rounded, upright
from synthetic.walking import Place, Times, Walk, keyed


def carry_box(height: float, seed: int) -> StagedScene:
    """Walk to a box on the floor, squat, lift it with both hands, carry it round a turn, set it down."""
    vary = _variation(seed)
    box = shape("box", height=height, seed=seed)
    stride = height * vary(0.24, 0.02)
    radius, turn = height * vary(0.49, 0.05), vary(1.5, 0.15)
    at_rest, at_body = 0.135 * height + box.half[0], 0.085 * height + box.half[0]

    begin = Place(0.0, 0.0)
    pick = begin.ahead(2 * stride)
    there_path = arc(pick, radius, turn)
    put = there_path(1.0)
    walk = Walk(begin).along(begin.line_to(pick), start=0.3, count=3)
    touch = walk.end + 0.95
    walk = walk.along(there_path, start=touch + 0.75, count=5)
    release = walk.end + 1.05
    there = rounded(release + 1.4)
    touch_again = there + 1.2
    walk = walk.along(arc(put, radius, 2 * np.pi - turn), start=touch_again + 0.75, count=13)
    release_again = walk.end + 1.05
    walk = walk.along(walk.place.line_to(walk.place.ahead(-2 * stride)), start=release_again + 0.9, count=3)
    cycle = rounded(max(walk.end + 0.5, release_again + 1.4))

    spans = ((touch, release), (touch_again, release_again))
    spots = (pick.ahead(at_rest), put.ahead(at_rest), pick.ahead(at_rest, turn=2 * np.pi))
    raised = 0.53 * height - box.half[2]
    anchor = before(walk, height, at_body)
    objects = carried(box, spans, spots, anchor, take=(0.1, 1.25), put=(1.25, 0.1), raised=raised)
    grips = tuple(_box_grip(box, side, span) for span in spans for side in range(2))
    actor = Actor("person", height, walk, grips, crouch=dips(spans, 1.0, down=1.25), gaze=dips(spans, 0.2))
    return StagedScene(there, cycle, (actor,), objects)


def _box_grip(box: Shape, side: int, span: Span) -> Grip:
    sign = _sign(side)
    return Grip(
        side,
        surface=(-0.06 * float(box.half[0]), sign * float(box.half[1]), 0.1 * float(box.half[2])),
        outward=(0.0, sign, 0.0),
        fingers=(1.0, 0.0, -1.1),
        span=span,
    )


def push_table(height: float, seed: int) -> StagedScene:
    """Lean with both hands on the edge of a table and push it along the floor; later pull it back."""
    vary = _variation(seed)
    table = shape("table", height=height, seed=seed)
    stride = height * vary(0.235, 0.015)
    distance = 0.26 * height + table.half[0]

    begin = Place(0.0, 0.0)
    far = begin.ahead(5 * stride)
    touch = 1.3
    walk = Walk(begin).along(begin.line_to(far), start=touch + 0.25, count=6, seconds=0.60)
    release = walk.end + 0.35
    there = rounded(release + 1.1)
    touch_again = there + 1.2
    # Backwards in shorter steps.
    walk = walk.along(walk.place.line_to(begin), start=touch_again + 0.25, count=8, seconds=0.60)
    release_again = walk.end + 0.35
    cycle = rounded(release_again + 1.1)

    spans = ((touch, release), (touch_again, release_again))
    spots = (begin.ahead(distance), far.ahead(distance), begin.ahead(distance))
    objects = carried(table, spans, spots, before(walk, height, distance), take=(0.05, 0.25), put=(0.1, 0.0))
    grips = tuple(_edge_grip(table, side, span, height) for span in spans for side in range(2))
    lean = (*holds(spans[:1], 0.55, down=1.1, up=1.0), *holds(spans[1:], 0.45, down=1.1, up=1.0)[1:])
    actor = Actor("person", height, walk, grips, crouch=holds(spans, 0.30), lean=lean, gaze=holds(spans, 0.18))
    return StagedScene(there, cycle, (actor,), objects)


def _edge_grip(table: Shape, side: int, span: Span, height: float) -> Grip:
    # The palm lies on top of the near edge and presses forward a little.
    pitch = 1.3
    return Grip(
        side,
        surface=(-float(table.half[0]) + 0.011 * height, _sign(side) * 0.125 * height, float(table.half[2])),
        outward=(-float(np.cos(pitch)), 0.0, float(np.sin(pitch))),
        fingers=(float(np.sin(pitch)), 0.0, float(np.cos(pitch))),
        span=span,
        curl=0.25,
    )


def drag_suitcase(height: float, seed: int) -> StagedScene:
    """Take a suitcase by its handle, tilt it, and drag it behind with one hand along a bend."""
    vary = _variation(seed)
    suitcase = shape("suitcase", height=height, seed=seed)
    radius, lag = height * vary(0.71, 0.05), 0.22
    begin = Place(0.0, 0.0)
    half_round = arc(begin, radius, np.pi)
    count = int(np.ceil(np.pi * radius / (0.25 * height))) + 1
    touch = 1.1
    walk = Walk(begin).along(half_round, start=touch + 0.25, count=count, side=0)
    release = walk.end + 0.5
    there = rounded(release + 0.9)
    touch_again = there + 1.1
    walk = walk.along(arc(walk.place, radius, np.pi), start=touch_again + 0.25, count=count, side=0)
    release_again = walk.end + 0.5
    cycle = rounded(release_again + 0.9)

    spans = ((touch, release), (touch_again, release_again))
    tilt = float(np.arccos(0.470 * height / suitcase.size[2]))
    tilts = [(0.0, 0.0)]
    for start, end in spans:
        tilts += [(start + 0.1, 0.0), (start + 1.7, tilt), (end - 1.5, tilt), (end - 0.1, 0.0)]
    anchor = before(walk, height, -0.09 * height, -0.14 * height, -lag)

    def objects(times: Times) -> tuple[ObjectTrack, ...]:
        x, y, yaw = anchor(times)
        pitch = keyed(times, tuple(tilts))
        quats = se3.quat_multiply(upright(yaw), se3.exp(pitch[:, None] * np.array([0.0, 1.0, 0.0])))
        # It tilts about the lower front edge, which stays on the floor; the handle stays at the hand.
        edge = np.array([suitcase.half[0], 0.0, -suitcase.half[2]])
        back = suitcase.size[2] * np.sin(pitch)
        floor = np.stack([x - back * np.cos(yaw), y - back * np.sin(yaw), np.zeros_like(x)], axis=1)
        return (ObjectTrack("suitcase", floor - se3.rotate(quats, edge[None]), quats, suitcase.geometry),)

    grips = tuple(_handle_grip(suitcase, span) for span in spans)
    elbows = ((-0.7, 0.45, -0.45), (-0.5, -0.8, -0.6))
    actor = Actor(
        "person", height, walk, grips, lean=holds(spans, 0.06), gaze=holds(spans, 0.08, up=0.9), elbows=elbows
    )
    return StagedScene(there, cycle, (actor,), objects)


def _handle_grip(suitcase: Shape, span: Span) -> Grip:
    # Tilted, the back of the hand looks ahead and the fingers hang down around the bar.
    pitch = 0.7
    cosine, sine = float(np.cos(pitch)), float(np.sin(pitch))
    return Grip(
        1,
        surface=(float(suitcase.half[0]), 0.0, float(suitcase.half[2])),
        outward=(cosine, 0.0, sine),
        fingers=(sine, 0.0, -cosine),
        span=span,
        curl=0.6,
    )


def move_chair(height: float, seed: int) -> StagedScene:
    """Crouch at the side of a chair, grip its back and its seat, lift it and step aside with it."""
    vary = _variation(seed)
    chair = shape("chair", height=height, seed=seed)
    aside = height * vary(0.42, 0.03)
    distance = 0.115 * height + chair.half[1]

    # The chair looks to the right of the person who stands at its side.
    begin = Place(0.0, 0.0)
    far = begin.ahead(0.0, -aside)
    touch = 1.4
    walk = Walk(begin).sidestep(far, start=touch + 0.55, pairs=2, side=1)
    release = walk.end + 0.7
    there = rounded(release + 1.4)
    touch_again = there + 1.4
    walk = walk.sidestep(begin, start=touch_again + 0.55, pairs=2, side=0)
    release_again = walk.end + 0.7
    cycle = rounded(release_again + 1.4)

    spans = ((touch, release), (touch_again, release_again))
    turn, raised = -np.pi / 2, height * vary(0.055, 0.01)
    spots = tuple(place.ahead(distance, turn=turn) for place in (begin, far, begin))
    anchor = before(walk, height, distance, turn=turn)
    objects = carried(chair, spans, spots, anchor, take=(0.1, 0.9), put=(0.8, 0.1), raised=raised)
    grips = tuple(_chair_grip(chair, side, span, height) for span in spans for side in range(2))
    actor = Actor(
        "person",
        height,
        walk,
        grips,
        crouch=holds(spans, 0.60, down=1.2, up=1.2),
        lean=holds(spans, 0.12, down=1.2, up=1.2),
        roll=holds(spans, 0.16, down=1.2, up=1.2),
        twist=holds(spans, -0.15, down=1.2, up=1.2),
    )
    return StagedScene(there, cycle, (actor,), objects)


def _chair_grip(chair: Shape, side: int, span: Span, height: float) -> Grip:
    # The chair's +x is the person's right and its +y is ahead of the person: one hand presses on the
    # back from behind, the other on the front of the seat.
    x, y, z = (float(value) for value in chair.half)
    if side == 0:
        back = (-x, -y + 0.011 * height, 0.385 * height - z)
        return Grip(0, back, outward=(-1.0, 0.0, 0.0), fingers=(0.0, 1.0, -0.15), span=span, curl=0.2)
    seat = (x, -y + 0.06 * height, 0.247 * height - z)
    return Grip(1, seat, outward=(1.0, 0.0, 0.0), fingers=(0.0, 1.0, -0.5), span=span, curl=0.2)


def carry_table(height: float, seed: int) -> StagedScene:
    """Two people face each other, lift a table by its ends and carry it sideways; the second is 4 % shorter."""
    vary = _variation(seed)
    table = shape("table", height=height, seed=seed)
    heights = (height, 0.96 * height)
    aside = height * vary(0.50, 0.03)

    touch, pairs = 1.4, 3
    release = touch + 0.65 + 2 * pairs * 0.54 + 0.75
    there = rounded(release + 1.4)
    touch_again = there + 1.4
    release_again = touch_again + (release - touch)
    cycle = rounded(release_again + 1.4)
    spans = ((touch, release), (touch_again, release_again))

    walks = []
    for person, tall in enumerate(heights):
        distance = 0.11 * tall + table.half[0]
        begin = Place(-distance, 0.0) if person == 0 else Place(distance, 0.0, np.pi)
        far = begin.ahead(0.0, aside if person == 0 else -aside)
        walk = Walk(begin).sidestep(far, start=touch + 0.65, pairs=pairs, side=person, seconds=0.54)
        walks.append(walk.sidestep(begin, start=touch_again + 0.65, pairs=pairs, side=1 - person, seconds=0.54))

    raised = 0.125 * height
    spots = (Place(0.0, 0.0), Place(0.0, aside), Place(0.0, 0.0))

    def anchor(times: Times) -> tuple[Scalars, Scalars, Scalars]:
        paths = [before(walk, tall, 0.0)(times) for walk, tall in zip(walks, heights, strict=True)]
        middle = 0.5 * (paths[0][1] + paths[1][1])
        return 0.0 * middle, middle, 0.0 * middle

    objects = carried(table, spans, spots, anchor, take=(0.1, 1.1), put=(1.0, 0.1), raised=raised)

    actors = tuple(
        Actor(
            f"person{person}",
            tall,
            walks[person],
            tuple(_end_grip(table, person, side, span, tall) for span in spans for side in range(2)),
            crouch=dips(spans, 0.50, down=1.1),
            lean=holds(spans, 0.12),
            gaze=dips(spans, 0.1),
        )
        for person, tall in enumerate(heights)
    )
    return StagedScene(there, cycle, actors, objects)


def _end_grip(table: Shape, person: int, side: int, span: Span, height: float) -> Grip:
    # Palms up under the top; the first person stands at -x and looks along +x, the second faces him.
    facing = 1.0 if person == 0 else -1.0
    underside = float(table.half[2]) - table.blocks[0].high[2] + table.blocks[0].low[2]
    return Grip(
        side,
        surface=(-facing * (float(table.half[0]) - 0.03 * height), facing * _sign(side) * 0.115 * height, underside),
        outward=(0.0, 0.0, -1.0),
        fingers=(facing, 0.0, 0.0),
        span=span,
        curl=0.2,
    )


def _sign(side: int) -> float:
    return 1.0 if side == 0 else -1.0


def _variation(seed: int) -> Callable[[float, float], float]:
    """Return a function that varies a value by up to an amount, the same way for the same seed."""
    generator = np.random.default_rng(seed)
    return lambda value, amount: value + amount * float(generator.uniform(-1.0, 1.0))
