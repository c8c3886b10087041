"""Which object rests on, rides on or hangs from which other one, frame by frame, as their surfaces lie in a recording.

An object is at another one while their surfaces are nearer than `TOUCH`, up to `RELEASE` once they were, or while both
move as one within `FAR` of each other, as a lid and its box, whose hinge no mesh has. Of two such objects, the one that
stands still carries the other, and of two that move, the lower one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen, runs
from hoi_retarget.numerics.filters import closed_and_opened, seconds_to_frames, speeds
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import MOVING_SPEED, ObjectTrack

TOUCH, RELEASE, FAR = 0.010, 0.015, 0.10  # [m]
_SHORTEST_SECONDS = 0.1  # Shorter contacts and interruptions do not count.
_STILL = 0.02  # [m]; the corners of an object that stands still are never farther from their median places.
_RIDING_SHARE = 0.1  # Objects that move as one move against each other with less than this share of their speed.
_POINTS = 300  # Vertices of a surface, and as many places between them, whose distances are measured.
ON_FLOOR = 0.02  # [m]; an object whose lowest point is no higher stands on the floor, unless a deeper one carries it.
_DEEPER = 0.003  # [m]; between the lowest points of such a carrier and the object.


@dataclass(frozen=True, eq=False)
class Supports:
    """The carriers of the O objects of a clip over its T frames."""

    carriers: Int[np.ndarray, "T O"]
    """Index of the object that carries each one; -1 where nothing does but the floor, a body or the air."""
    order: tuple[int, ...]  # All objects, each behind those that ever carry it.


@lru_cache(maxsize=8)
def supports(objects: tuple[ObjectTrack, ...], fps: float) -> Supports:
    """Return the carriers of a clip's objects; the same objects are looked at once.

    Raises `GeometryError` where an object's mesh cannot be read.
    """
    order = _order(objects)
    frames = len(objects[0].positions) if objects else 0
    carriers = np.full((frames, len(objects)), -1)
    lowest = [track.lowest for track in objects] if len(objects) > 1 else []
    for place, index in enumerate(order):
        slowest = np.full(frames, np.inf)
        for other in order[:place]:
            near = _at(objects[index], objects[other], fps)
            near &= (lowest[index] > ON_FLOOR) | (lowest[other] < lowest[index] - _DEEPER)
            speed = _relative_speed(objects[index], objects[other], fps)
            # Of several the one that it moves with; where all stand still, any.
            near &= speed < slowest
            carriers[near, index], slowest[near] = other, speed[near]
        for first, stop in _constant_runs(carriers[:, index]):
            if stop - first < seconds_to_frames(_SHORTEST_SECONDS, fps):
                carriers[first:stop, index] = -1
    return Supports(frozen(carriers, int), order)


def _order(objects: Sequence[ObjectTrack]) -> tuple[int, ...]:
    """Return the objects that stand still, then the others, each kind from the lowest on."""

    def key(index: int) -> tuple[bool, float]:
        corners = objects[index].corners
        away = np.linalg.norm(corners - np.median(corners, axis=0), axis=-1).max()
        return bool(away > _STILL), float(objects[index].lowest.mean())

    return tuple(sorted(range(len(objects)), key=key)) if len(objects) > 1 else tuple(range(len(objects)))


def _constant_runs(values: Int[np.ndarray, "T"]) -> list[tuple[int, int]]:
    ends = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist(), len(values)]
    return list(pairwise(ends))


def _at(rider: ObjectTrack, carrier: ObjectTrack, fps: float) -> Bool[np.ndarray, "T"]:
    gaps = _gaps(rider, carrier)
    shortest = seconds_to_frames(_SHORTEST_SECONDS, fps)
    touching = np.zeros(len(gaps), dtype=bool)
    for first, stop in runs(gaps < RELEASE):
        touching[first:stop] = (gaps[first:stop] < TOUCH).any()
    speed = speeds(rider.corners.mean(axis=1), fps)
    along = (speed > MOVING_SPEED) & (_relative_speed(rider, carrier, fps) < _RIDING_SHARE * speed)
    return closed_and_opened(touching | along & (gaps < FAR), gap=shortest, shortest=shortest)


def _relative_speed(rider: ObjectTrack, carrier: ObjectTrack, fps: float) -> Float[np.ndarray, "T"]:
    """Return the speed of a rider's fastest corner in its carrier's frame [m/s], a mean over 0.2 s."""
    fastest = speeds(_seen(rider.corners, carrier), fps).max(axis=1)
    width = 2 * seconds_to_frames(_SHORTEST_SECONDS, fps) + 1
    return np.convolve(np.pad(fastest, width // 2, mode="edge"), np.full(width, 1.0 / width), mode="valid")


def _seen(points: Float[np.ndarray, "T K 3"], carrier: ObjectTrack) -> Float[np.ndarray, "T K 3"]:
    return se3.rotate_inverse(carrier.quats[:, None], points - carrier.positions[:, None])


def _gaps(rider: ObjectTrack, carrier: ObjectTrack) -> Float[np.ndarray, "T"]:
    """Return the distance of two surfaces, by points of each [m], infinite where their boxes are farther than `FAR`.

    It is measured again where it may have passed `TOUCH`, `RELEASE` or `FAR`.
    """
    corners, others = rider.corners, carrier.corners
    low, high = corners.min(axis=1) - others.max(axis=1), others.min(axis=1) - corners.max(axis=1)
    within = (np.maximum(low, high) < FAR).all(axis=1)
    gaps, seen = np.full(len(within), np.inf), _seen(corners, carrier)
    known = -1
    for frame in map(int, np.flatnonzero(within)):
        if known >= 0 and np.isfinite(gaps[known]):
            # No point of an object moves farther than its box's corners do.
            moved = float(np.linalg.norm(seen[frame] - seen[known], axis=-1).max())
            if not any(abs(gaps[known] - limit) <= moved for limit in (TOUCH, RELEASE, FAR)):
                gaps[frame] = gaps[known]
                continue
        known = frame
        gaps[frame] = min(_gap(rider, carrier, frame), _gap(carrier, rider, frame))
    return gaps


def _gap(one: ObjectTrack, other: ObjectTrack, frame: int) -> float:
    """Return the least distance of one object's points from the surface of another in a frame [m]."""
    surface = surface_of(other.geometry)
    world = se3.rotate(one.quats[frame], _points(one)) + one.positions[frame]
    points = se3.rotate_inverse(other.quats[frame], world - other.positions[frame])
    low, high = surface.vertices.min(axis=0) - FAR, surface.vertices.max(axis=0) + FAR
    points = points[((points > low) & (points < high)).all(axis=1)]
    return float(surface.distances(points).min(initial=np.inf))


@lru_cache(maxsize=64)
def _points(track: ObjectTrack) -> Float[np.ndarray, "K 3"]:
    surface = surface_of(track.geometry)
    step = max(1, len(surface.vertices) // _POINTS)
    return np.concatenate([surface.vertices[::step], surface.random_points(_POINTS)[0]])
