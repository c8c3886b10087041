"""Contacts from geometry: which part touches which object, when, and where.

A part is in contact while its surface, capsules around its bones, is nearer to the object's surface than a
threshold. Distances are exact up to `FAR`: points outside the object's box by more than that are far.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.errors import ArgumentError
from hoi_retarget.human import capsules
from hoi_retarget.human.person import Person, stance
from hoi_retarget.human.skeleton import BODY_PARTS, FEET, FINGER_PARTS, HANDS, PARTS
from hoi_retarget.human.skinned_mesh import vertices_of
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import closed_and_opened, nearest_active, speeds
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.objects.track import ObjectTrack

FAR = 0.10  # [m]; larger distances from an object are not measured.
GUESSED_FINGERS = 0.015  # [m]; how much farther a hand may be whose fingers are not recorded: most hold with bent ones.
GUESSED_BODY = 0.015  # [m]; the same of pelvis, thighs and forearms without a skin: how thick they are is guessed.
_SKIN_FRAMES = 500  # Whose skin is made at once: bounds the memory.


@dataclass(frozen=True)
class Proximity:
    """The paper's criterion, made steady: near enough, slow enough, long enough.

    A contact is a run of frames nearer than `release`, in at least one of which the part is nearer than `touch`
    and slow against the object. The same clip backwards has the same contacts.
    """

    touch: float = 0.010  # Distance of the surfaces below which a contact is made [m].
    release: float = 0.015  # Distance up to which it lasts [m].
    speed: float = 0.5  # Largest speed of the part against the object at which a contact is made [m/s].
    gap: float = 0.1  # Interruptions up to this long are closed [s].
    shortest: float = 0.1  # Contacts shorter than this are dropped [s].

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


PROXIMITY = Proximity()
SKIN_FINGERS, CAPSULE_FINGERS = Proximity(touch=0.004, release=0.006), Proximity(touch=0.008, release=0.010)
"""Of fingers of a hand that touches, by skin and by capsules."""
ON_SURFACE, LABELLED = 0.002, 0.015
"""Of fingers' given points, beyond which these are places of joints, and of labelled fingers that touch indeed [m]."""
EDITED = 1e-6  # A point that is farther from the recorded one was edited [m].


@dataclass(frozen=True, eq=False)
class PartObjectDistance:
    """The distance of a part's surface from an object's, and the nearest point, frame by frame."""

    person: int
    object: int
    part: str
    distances: Float[np.ndarray, "T"]
    """From surface to surface, negative where they overlap [m]; infinite beyond `FAR`."""
    contact_points: Float[np.ndarray, "T 3"]
    """The object's nearest point, in its frame at captured size [m]; NaN beyond `FAR`."""


def label_contacts(
    clip: Clip,
    *,
    rule: Proximity = PROXIMITY,
    points: Literal["part", "surface"] = "part",
    near: tuple[PartObjectDistance, ...] | None = None,
) -> tuple[ContactTrack, ...]:
    """Return the contacts of a clip: a track for each person, object and part, in this order.

    Raises `GeometryError` where an object's mesh cannot be read.

    `clip`: its own contacts are not looked at; `rule`: when a part touches; `points`: `part` gives the part's own point
    (`Person.part_position`) in the object's frame, as the readers do; `surface` gives the object's point nearest to the
    part; `near`: the clip's `part_object_distances`, where it is known already.
    """
    near = part_object_distances(clip) if near is None else near
    tracks = []
    for item, flags in zip(near, touching(clip, near, rule), strict=True):
        places = _part_points(clip, item) if points == "part" else _surface_points(item, flags)
        tracks.append(ContactTrack(item.person, item.object, item.part, flags, places))
    return tuple(tracks)


@lru_cache(maxsize=1)  # Targets and figures ask for those of the same clip.
def with_finger_contacts(clip: Clip, person: int) -> Clip:
    """Return a clip with the contacts of a person's fingers on the surface; raises as `finger_contacts`."""
    others = [track for track in clip.contacts if track.person != person or track.part not in FINGER_PARTS]
    return replace(clip, contacts=(*others, *finger_contacts(clip, person)))


def finger_contacts(clip: Clip, person: int) -> tuple[ContactTrack, ...]:
    """Return the contacts of a person's fingers: as labelled, or found while their hands touch.

    Points are the clip's where these are on the surface, else the object's nearest: labels may be late, by tenths of a
    second, and fingers that are off by then do not touch. Edited points are the surface's nearest to them; fingers with
    none go along where their hand was edited. None are found of fingers that are made up. Raises `GeometryError` where
    an object's mesh cannot be read.
    """
    human, found = clip.people[person], []
    labelled = [track for track in clip.contacts if track.person == person and track.part in FINGER_PARTS]
    if labelled or any(track.person == person and track.part in FINGER_PARTS for track in clip.recorded_contacts):
        return tuple(_labelled(clip, track) for track in labelled)
    rule = CAPSULE_FINGERS if human.shape is None else SKIN_FINGERS
    for track in clip.contacts:
        if track.person != person or track.part not in HANDS or not track.active.any() or not human.fingers_recorded:
            continue
        side, touched = track.part.split("_")[0], [clip.objects[track.object]]
        fingers = [part for part in FINGER_PARTS if part.startswith(side)]
        near = [PartObjectDistance(person, track.object, part, *of_part(human, part, touched)[0]) for part in fingers]
        recorded = track.active & _touches(clip.recorded_contacts or clip.contacts, track)
        for item, flags in zip(near, touching(clip, near, rule), strict=True):
            active = flags & recorded
            found.append(ContactTrack(person, track.object, item.part, active, _surface_points(item, active)))
    return tuple(_along_hand(clip, finger) for finger in found)


def recorded_points(clip: Clip, track: ContactTrack, points: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "T 3"]:
    """Return the points of a contact before it was edited [m], and the given ones where it is new."""
    for item in clip.recorded_contacts:
        if (item.person, item.part, item.object) == (track.person, track.part, track.object):
            points = np.where(item.active[:, None], item.contact_points, points)
    return points


def _touches(tracks: Iterable[ContactTrack], like: ContactTrack) -> Bool[np.ndarray, "T"]:
    """Return whether the part of a contact touches its object by some tracks."""
    own = (
        item.active for item in tracks if (item.person, item.part, item.object) == (like.person, like.part, like.object)
    )
    return np.any([np.zeros(len(like.active), dtype=bool), *own], axis=0)


def _labelled(clip: Clip, track: ContactTrack) -> ContactTrack:
    """Return a labelled contact on the surface: where it was edited to, else the recorded one along with its hand."""
    touched = clip.objects[track.object]
    before = recorded_points(clip, track, np.full(track.contact_points.shape, np.nan))
    apart = np.linalg.norm(before - track.contact_points, axis=1)[track.active]
    if clip.recorded_contacts and not (apart < EDITED).all():
        points = track.contact_points.copy()
        points[track.active] = surface_of(touched.geometry).closest_points(points[track.active])
        return replace(track, contact_points=points)
    return _along_hand(clip, _on_surface(clip.people[track.person], track, touched))


def _along_hand(clip: Clip, finger: ContactTrack) -> ContactTrack:
    """Return a finger's contact that ends where somebody ended its hand's, and goes along the surface with that."""
    if not clip.recorded_contacts:
        return finger
    hand, points = replace(finger, part=f"{finger.part.split('_')[0]}_hand"), finger.contact_points.copy()
    active = finger.active & (_touches(clip.contacts, hand) | ~_touches(clip.recorded_contacts, hand))
    surface = surface_of(clip.objects[finger.object].geometry)
    for track in clip.contacts:
        at = np.flatnonzero(track.active & active)
        before = recorded_points(clip, track, np.full(points.shape, np.nan))
        known = np.isfinite(before[:, 0])
        if (track.person, track.part, track.object) != (finger.person, hand.part, finger.object) or not known.any():
            continue
        before = before[nearest_active(known)]
        if at.size and (np.any(before[at] != track.contact_points[at]) or any(track.turn)):
            old, new = (surface.closest_points(place[at]) for place in (before, track.contact_points))
            turned = se3.rotate(se3.exp(np.radians(track.turn)), points[at] - old)
            points[at] = surface.closest_points(new + turned)
    return replace(finger, active=active, contact_points=points)


def _on_surface(human: Person, track: ContactTrack, touched: ObjectTrack) -> ContactTrack:
    given = track.contact_points[track.active]
    if not len(given) or surface_of(touched.geometry).distances(given).max() < ON_SURFACE:
        return track
    gaps, nearest = of_part(human, track.part, [touched])[0]
    return replace(track, active=track.active & (gaps < LABELLED), contact_points=nearest)


def body_distances(clip: Clip, index: int) -> Float[np.ndarray, "T"]:
    """Return the distance of an object from the nearest body, by capsules [m]; infinite beyond `FAR`.

    Raises `GeometryError` where its mesh cannot be read.
    """
    track = clip.objects[index]
    surface = surface_of(track.geometry)
    bodies = (capsules.spheres(human, capsules.BODY_CAPSULES) for human in clip.people)
    return np.min([nearest_to(body, track, surface)[0] for body in bodies], axis=0)


def part_object_distances(clip: Clip) -> tuple[PartObjectDistance, ...]:
    """Return the distance of each part of each person from each object, in the order of `label_contacts`.

    Raises `GeometryError` where an object's mesh cannot be read.
    """
    found = []
    for person, human in enumerate(clip.people):
        near = {part: of_part(human, part, clip.objects) for part in PARTS}
        for index in range(len(clip.objects)):
            found += [PartObjectDistance(person, index, part, *near[part][index]) for part in PARTS]
    return tuple(found)


# Distances


_Near = tuple[Float[np.ndarray, "T"], Float[np.ndarray, "T 3"]]


def nearest_to(balls: capsules.Spheres, track: ObjectTrack, surface: Surface) -> _Near:
    """Return distance and point of the nearest sphere in each frame."""
    middles = se3.rotate_inverse(track.quats[:, None], balls.middles - track.positions[:, None])
    radii = np.broadcast_to(balls.radii, middles.shape[:2])
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    outside = np.linalg.norm(np.maximum(np.maximum(low - middles, middles - high), 0.0), axis=-1)
    least = outside - radii  # What a distance is at least: few spheres can be nearer than one of the nearest is.
    first, most = least.argmin(axis=1), np.full(len(least), -np.inf)
    may = np.flatnonzero(least.min(axis=1) <= FAR)
    one = middles[may, first[may]]
    most[may] = np.linalg.norm(one - surface.closest_points(one), axis=1) - radii[may, first[may]]
    near = least <= np.minimum(most, FAR)[:, None]
    gaps = np.full(radii.shape, np.inf)
    gaps[near] = surface.distances(middles[near]) - radii[near]
    nearest = gaps.argmin(axis=1)[:, None]
    distances = np.take_along_axis(gaps, nearest, axis=1)[:, 0]
    known = distances <= FAR
    distances[~known] = np.inf
    middle = np.take_along_axis(middles, nearest[..., None], axis=1)[known, 0]
    points = np.full((len(middles), 3), np.nan)
    points[known] = surface.closest_points(middle)
    return distances, points


def of_part(human: Person, part: str, tracks: Sequence[ObjectTrack]) -> list[_Near]:
    """Return a part's distance from each object and the nearest point, by its skin, or by its capsules.

    The skin's vertices are spheres without a size. Raises `GeometryError` where an object's mesh cannot be read.
    """
    own = (capsules.PART_CAPSULES | capsules.RESTING_CAPSULES | capsules.FINGER_CAPSULES)[part]
    surfaces = [surface_of(track.geometry) for track in tracks]
    if human.shape is None:
        balls = capsules.spheres(human, own)
        return [nearest_to(balls, track, surface) for track, surface in zip(tracks, surfaces, strict=True)]
    joints = tuple({capsule.joint for capsule in own})
    vertices = vertices_of(human.shape.owners, joints)
    found: list[list[_Near]] = [[] for _ in tracks]
    for first in range(0, len(human.joint_quats), _SKIN_FRAMES):
        frames = slice(first, first + _SKIN_FRAMES)
        skin = human.shape.skin(human.joint_positions[frames], human.joint_quats[frames], vertices)
        for track, surface, near in zip(tracks, surfaces, found, strict=True):
            piece = replace(track, positions=track.positions[frames], quats=track.quats[frames])
            near.append(nearest_to(capsules.Spheres(skin, np.zeros(len(vertices))), piece, surface))
    return [(np.concatenate([gap for gap, _ in near]), np.concatenate([point for _, point in near])) for near in found]


# When


def touching(
    clip: Clip, near: Iterable[PartObjectDistance], rule: Proximity = PROXIMITY
) -> list[Bool[np.ndarray, "T"]]:
    """Return when each part touches by the paper's criterion, in the order of `near`."""
    gap, shortest = (int(np.floor(seconds * clip.fps + 1e-6)) for seconds in (rule.gap, rule.shortest))
    stands = [stance(person, clip.fps) for person in clip.people]
    found = []
    for item in near:
        speed = speeds(_part_points(clip, item), clip.fps)
        slack = _guessed(clip.people[item.person], item.part)
        made = (item.distances < rule.touch + slack) & (speed < rule.speed)
        lasting = item.distances < rule.release + slack
        if item.part in FEET:
            lasting &= ~stands[item.person][:, FEET.index(item.part)]  # It stands on the floor beside the object.
        flags = np.zeros(clip.frames, dtype=bool)
        for first, stop in runs(lasting):
            flags[first:stop] = made[first:stop].any()
        found.append(closed_and_opened(flags, gap=gap, shortest=shortest))
    return found


def _guessed(person: Person, part: str) -> float:
    """Return the distance to allow for a part of guessed shape [m]."""
    if part in BODY_PARTS:
        return 0.0 if person.shape is not None else GUESSED_BODY
    return 0.0 if person.fingers_recorded or part in FEET else GUESSED_FINGERS


# Where


def _part_points(clip: Clip, item: PartObjectDistance) -> Float[np.ndarray, "T 3"]:
    return clip.objects[item.object].to_object(clip.people[item.person].part_position(item.part))


def _surface_points(item: PartObjectDistance, active: Bool[np.ndarray, "T"]) -> Float[np.ndarray, "T 3"]:
    """Return the nearest points; in closed interruptions that led beyond `FAR`, those of the nearest known frame."""
    known = np.isfinite(item.distances)
    if not active.any() or known[active].all():
        return item.contact_points
    return item.contact_points[nearest_active(known)]
