"""Contacts from geometry: which part touches which object, when, and where.

A part is in contact while its surface, capsules around its bones, is nearer to the object's surface than a
threshold. Distances are exact up to `FAR` and are taken only where they can matter: points outside
the object's box by more than that are far, and of the others only those that a coarse search leaves as possibly
the nearest of their frame are compared with triangles.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.errors import ArgumentError
from hoi_retarget.human.capsules import BODY_CAPSULES, PART_CAPSULES, Capsule, Spheres, spheres
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import FEET, PARTS
from hoi_retarget.human.stance import stance
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import nearest_active
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.objects.track import ObjectTrack

FAR = 0.10
"""[m]; what is farther from an object than this is only known to be."""
_FINENESS = 0.01  # [m] of the coarse search's triangles, for objects up to a metre in size.
GUESSED_FINGERS = 0.015
"""[m]; how much farther a hand may be whose fingers are not recorded: most hold with bent ones."""
_CROSSING = 1e-6  # [m]; a middle that is nearer to the surface lies on it, and has no direction from it.
_GRAVITY = 9.8  # [m/s^2]
_SKIN_FRAMES = 500  # Whose skin is made at once: bounds the memory.


@dataclass(frozen=True)
class Proximity:
    """The paper's criterion, steadied: near enough, slow enough, long enough.

    A contact is a run of frames nearer than `release`, in at least one of which the part is nearer than `touch`
    and slow against the object. The same clip backwards has the same contacts.
    """

    touch: float = 0.010
    """Distance of the surfaces below which a contact is made [m]."""
    release: float = 0.015
    """Distance up to which it lasts [m]."""
    speed: float = 0.5
    """Largest speed of the part against the object at which a contact is made [m/s]."""
    gap: float = 0.1
    """Interruptions up to this long are closed [s]."""
    shortest: float = 0.1
    """Contacts shorter than this are dropped [s]."""

    def __post_init__(self) -> None:
        if not 0 <= self.touch <= self.release <= FAR:
            raise ArgumentError(
                f"The distances touch {self.touch} m and release {self.release} m must be in this order, "
                f"between 0 and {FAR} m."
            )
        if not (self.speed > 0 and self.gap >= 0 and self.shortest >= 0):
            raise ArgumentError(
                f"The speed {self.speed} m/s must be positive, the gap {self.gap} s and the shortest contact "
                f"{self.shortest} s not negative."
            )


@dataclass(frozen=True)
class InterAct:
    """The rules of InterAct's conversion to InterMimic's files, each frame on its own.

    They compare a body's mesh with points on the object; here they compare capsules with triangles. The
    numbers are theirs.
    """

    near: float = 0.02
    """Distance of the whole body below which there is a contact [m]."""
    margin: float = 0.005
    """How much farther than the nearest of the body a touching part may be, while there is a contact [m]."""
    alone: float = 0.01
    """How far a touching part may be while there is none [m]."""
    raised: float = 0.10
    """Height of the object's lowest point at which somebody must be holding it [m]."""
    falling: float = 6.0
    """Difference from 9.8 m/s^2 upwards below which an object counts as falling [m/s^2]."""


Rule = Proximity | InterAct
PROXIMITY = Proximity()


@dataclass(frozen=True, eq=False)
class Nearness:
    """How near a part's surface is to an object's, and where, frame by frame."""

    person: int
    object: int
    part: str
    distances: Float[np.ndarray, "T"]
    """From surface to surface, negative where they overlap [m]; infinite beyond `FAR`."""
    contact_points: Float[np.ndarray, "T 3"]
    """The object's nearest point, in its frame at captured size [m]; NaN beyond `FAR`."""
    directions_object: Float[np.ndarray, "T 3"]
    """Unit direction from there to the middle of the part's nearest bone, in the object's frame: the surface's normal,
    or one of an edge's; it points inwards where the bone itself has sunk in. NaN beyond `FAR` and on the surface."""

    def confidence(self, rule: Proximity = PROXIMITY) -> Float[np.ndarray, "T"]:
        """Return how surely this is a contact: 1 up to the distance `touch`, falling to 0 at `release`."""
        width = max(rule.release - rule.touch, np.finfo(float).tiny)
        return np.clip((rule.release - self.distances) / width, 0.0, 1.0)


def label_contacts(
    clip: Clip,
    *,
    rule: Rule = PROXIMITY,
    points: Literal["part", "surface"] = "part",
    near: tuple["Nearness", ...] | None = None,
) -> tuple[ContactTrack, ...]:
    """Return the contacts of a clip: a track for each person, object and part, in this order.

    Args:
        clip: its own contacts are not looked at.
        rule: when a part touches.
        points: `part` gives the part's own point (`Person.part_position`) in the object's frame, as the readers do;
            `surface` gives the object's point nearest to the part.
        near: the clip's `nearness`, where it is known already.

    Raises:
        GeometryError: an object's mesh cannot be read.
    """
    near = nearness(clip) if near is None else near
    active = touching(clip, near, rule) if isinstance(rule, Proximity) else _by_interact(clip, rule)
    tracks = []
    for item, flags in zip(near, active, strict=True):
        places = _part_points(clip, item) if points == "part" else _surface_points(item, flags)
        tracks.append(ContactTrack(item.person, item.object, item.part, flags, places))
    return tuple(tracks)


def nearness(clip: Clip) -> tuple[Nearness, ...]:
    """Return how near each part of each person is to each object, in the order of `label_contacts`.

    Raises:
        GeometryError: an object's mesh cannot be read.
    """
    coarse = [_Coarse.of(surface_of(track.geometry)) for track in clip.objects]
    found = []
    for person, human in enumerate(clip.people):
        for index, track in enumerate(clip.objects):
            for part in PARTS:
                near = (_of_capsules if human.shape is None else _of_skin)(human, part, track, coarse[index])
                found.append(Nearness(person, index, part, *near))
    return tuple(found)


# Distances


@dataclass(frozen=True, eq=False)
class _Coarse:
    """A surface with points on it, none of whose own points is farther than `fineness` from one of them."""

    surface: Surface
    tree: KDTree
    fineness: float

    @classmethod
    def of(cls, surface: Surface) -> "_Coarse":
        size = float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
        limit = _FINENESS * max(1.0, size)
        triangles = surface.triangles
        done = []
        while len(triangles):
            edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=-1)
            small = edges.max(axis=1) <= limit
            done.append(triangles[small])
            triangles = _halved(triangles[~small], edges[~small].argmax(axis=1))
        triangles = np.concatenate(done)
        middles = triangles.mean(axis=1)
        fineness = float(np.linalg.norm(triangles - middles[:, None], axis=-1).max())
        return cls(surface, KDTree(middles), fineness)


def _halved(triangles: Float[np.ndarray, "F 3 3"], longest: Int[np.ndarray, "F"]) -> Float[np.ndarray, "G 3 3"]:
    """Return triangles cut in two across their longest edge."""
    order = (longest[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(triangles, order[..., None], axis=1), 1, 0)
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


_Near = tuple[Float[np.ndarray, "T"], Float[np.ndarray, "T 3"], Float[np.ndarray, "T 3"]]


def _nearest(balls: Spheres, track: ObjectTrack, coarse: _Coarse) -> _Near:
    """Return distance, point and direction of the sphere that is nearest in each frame."""
    middles = se3.rotate_inverse(track.quats[:, None], balls.middles - track.positions[:, None])
    bound = _lower_bounds(middles, balls.radii, coarse)
    distances = np.full(len(middles), np.inf)
    points, directions = np.full((len(middles), 3), np.nan), np.full((len(middles), 3), np.nan)

    def compare(candidates: Bool[np.ndarray, "T n"]) -> None:
        frames, which = np.nonzero(candidates & (bound <= FAR))
        middle = middles[frames, which]
        closest = coarse.surface.closest_points(middle)
        away = np.linalg.norm(middle - closest, axis=1)
        gap = away - balls.radii[which]
        order = np.lexsort((gap, frames))
        best = order[np.unique(frames[order], return_index=True)[1]]
        best = best[(gap[best] < distances[frames[best]]) & (gap[best] <= FAR)]
        distances[frames[best]], points[frames[best]] = gap[best], closest[best]
        apart = np.where(away[best] > _CROSSING, away[best], np.nan)[:, None]
        directions[frames[best]] = (middle[best] - closest[best]) / apart

    # The likeliest of each frame bounds all others; few of those are left to compare.
    likeliest = np.arange(bound.shape[1]) == bound.argmin(axis=1)[:, None]
    compare(likeliest)
    compare(~likeliest & (bound < distances[:, None]))
    return distances, points, directions


def _of_capsules(human: Person, part: str, track: ObjectTrack, coarse: _Coarse) -> _Near:
    """Return distance, point and direction of a part from its capsules."""
    return _nearest(spheres(human, PART_CAPSULES[part]), track, coarse)


def _of_skin(human: Person, part: str, track: ObjectTrack, coarse: _Coarse) -> _Near:
    """Return the same from a part's skin: its vertices are spheres without a size."""
    assert human.shape is not None, "asked before"
    joints = tuple({capsule.joint for capsule in PART_CAPSULES[part]})
    vertices = human.shape.vertices_of(joints)
    found = []
    for first in range(0, len(track.positions), _SKIN_FRAMES):
        frames = slice(first, first + _SKIN_FRAMES)
        skin = human.shape.skin(human.joint_positions[frames], human.joint_quats[frames], vertices)
        piece = replace(track, positions=track.positions[frames], quats=track.quats[frames])
        found.append(_nearest(Spheres(skin, np.zeros(len(vertices))), piece, coarse))
    distances, points, directions = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return distances, points, directions


def _lower_bounds(
    middles: Float[np.ndarray, "T n 3"], radii: Float[np.ndarray, "n"], coarse: _Coarse
) -> Float[np.ndarray, "T n"]:
    """Return distances from the object's surface [m] that none of the spheres is nearer than."""
    low, high = coarse.surface.vertices.min(axis=0), coarse.surface.vertices.max(axis=0)
    outside = np.maximum(np.maximum(low - middles, middles - high), 0.0)
    bound = np.linalg.norm(outside, axis=-1) - radii
    near = bound <= FAR
    # Beyond the search's reach the tree answers with infinity, which is as good.
    reach = FAR + float(radii.max()) + coarse.fineness
    away = np.asarray(coarse.tree.query(middles[near], distance_upper_bound=reach)[0])
    bound[near] = np.maximum(bound[near], (away - coarse.fineness) - np.broadcast_to(radii, bound.shape)[near])
    return bound


# When


def touching(clip: Clip, near: Iterable[Nearness], rule: Proximity = PROXIMITY) -> list[Bool[np.ndarray, "T"]]:
    """Return when each part touches by the paper's criterion, in the order of `near`."""
    gap, shortest = (int(np.floor(seconds * clip.fps + 1e-6)) for seconds in (rule.gap, rule.shortest))
    stands = [stance(person, clip.fps) for person in clip.people]
    found = []
    for item in near:
        speed = np.linalg.norm(np.gradient(_part_points(clip, item), axis=0), axis=1) * clip.fps
        slack = 0.0 if clip.people[item.person].fingers_recorded or item.part in FEET else GUESSED_FINGERS
        made = (item.distances < rule.touch + slack) & (speed < rule.speed)
        lasting = item.distances < rule.release + slack
        if item.part in FEET:
            lasting &= ~stands[item.person][:, FEET.index(item.part)]  # It stands on the floor beside the object.
        flags = np.zeros(clip.frames, dtype=bool)
        for first, stop in runs(lasting):
            flags[first:stop] = made[first:stop].any()
        found.append(_steadied(flags, gap, shortest))
    return found


def _steadied(flags: Bool[np.ndarray, "T"], gap: int, shortest: int) -> Bool[np.ndarray, "T"]:
    """Return flags without interruptions up to `gap` frames, and then without runs of fewer than `shortest`."""
    steady = flags.copy()
    for first, stop in runs(~flags):
        if first > 0 and stop < len(flags) and stop - first <= gap:
            steady[first:stop] = True
    for first, stop in runs(steady):
        # What the clip's ends cut off may have been longer.
        if first > 0 and stop < len(steady) and stop - first < shortest:
            steady[first:stop] = False
    return steady


def _by_interact(clip: Clip, rule: InterAct) -> list[Bool[np.ndarray, "T"]]:
    found = []
    for human in clip.people:
        balls = spheres(human, BODY_CAPSULES)
        lowest = float((balls.middles[..., 2] - balls.radii).min())
        for track in clip.objects:
            coarse = _Coarse.of(surface_of(track.geometry))
            by_joints = {
                part: _unsigned(human, track, coarse, [c for c in capsules if c.joint in PARTS[part].label_joints])
                for part, capsules in PART_CAPSULES.items()
            }
            body = np.maximum(_nearest(balls, track, coarse)[0], 0.0)
            contact = _touched(clip.fps, track, body, lowest, rule)
            limit = np.where(contact, body + rule.margin, rule.alone)
            found += [distances < limit for distances in by_joints.values()]
    return found


def _unsigned(
    human: Person, track: ObjectTrack, coarse: _Coarse, capsules: Iterable[Capsule]
) -> Float[np.ndarray, "T"]:
    """Return distances [m] as between two meshes' points, which know no inside."""
    return np.maximum(_nearest(spheres(human, capsules), track, coarse)[0], 0.0)


def _touched(
    fps: float, track: ObjectTrack, body: Float[np.ndarray, "T"], lowest: float, rule: InterAct
) -> Bool[np.ndarray, "T"]:
    """Return when InterAct's rules say that somebody touches the object."""
    bottom = track.lowest
    grounded = bottom - min(float(bottom.min()), lowest) < rule.raised
    acceleration = np.zeros_like(track.positions)
    acceleration[1:-1] = np.diff(track.positions, n=2, axis=0) * fps**2
    # Their sign: what falls freely differs by 19.6 from this, so hardly anything counts as falling.
    falling = np.linalg.norm(acceleration - [0.0, 0.0, _GRAVITY], axis=1) < rule.falling
    return ((body < rule.near) | (~grounded & ~falling)) & (body <= FAR)


# Where


def _part_points(clip: Clip, item: Nearness) -> Float[np.ndarray, "T 3"]:
    return clip.objects[item.object].to_object(clip.people[item.person].part_position(item.part))


def _surface_points(item: Nearness, active: Bool[np.ndarray, "T"]) -> Float[np.ndarray, "T 3"]:
    """Return the nearest points; in closed interruptions that led beyond `FAR`, those of the nearest known frame."""
    known = np.isfinite(item.distances)
    if not active.any() or known[active].all():
        return item.contact_points
    return item.contact_points[nearest_active(known)]
