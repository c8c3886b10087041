"""Contacts of people who sit or lean: pelvis, thighs and forearms that rest on an object which stands still.

They are found by geometry alone: no source labels them. What moves, such as a box on the arms, is carried, not a rest;
what is beside or over a part, such as a back or a table top over the knees, does not bear it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import PELVIS, Clip, ContactTrack
from hoi_retarget.clip.label_contacts import FAR, PartObjectDistance, Proximity, nearest_to, of_part, touching
from hoi_retarget.human.capsules import RESTING_CAPSULES, Spheres, spheres
from hoi_retarget.human.person import Person
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectTrack

RESTING = Proximity(shortest=0.5)  # Parts that pass over an object's edge or brush it do not rest there.
STEEPEST = np.radians(45.0)  # Of the way from the place that bears a part up to its bone, against the vertical.


def resting_contacts(
    clip: Clip, still: Sequence[Bool[np.ndarray, "T"]], *, seats_only: bool = False
) -> tuple[ContactTrack, ...]:
    """Return a track for each person, object and part that rests on it in some frame.

    Raises `GeometryError` where an object's mesh cannot be read.
    """
    found = []
    for person, human in enumerate(clip.people):
        for index, (track, stands) in enumerate(zip(clip.objects, still, strict=True)):
            resting, stays = [], _in_frames(track, stands)
            for part, capsules in RESTING_CAPSULES.items():
                if seats_only and part != PELVIS and not resting:
                    break
                balls = spheres(human, capsules)
                some = Spheres(balls.middles[stands], balls.radii)
                if not np.isfinite(nearest_to(some, stays, surface_of(track.geometry))[0]).any():
                    continue  # Most parts never come near: their skin is not made.
                ((distances, points),) = of_part(human, part, (track,))
                bears = stands & (distances <= FAR) & _below(human, part, track, points)
                near = PartObjectDistance(person, index, part, np.where(bears, distances, np.inf), points)
                (active,) = touching(clip, (near,), RESTING)
                if active.any():
                    places = track.to_object(human.part_position(part))
                    resting.append(ContactTrack(person, index, part, active, places))
            found += resting
    return tuple(found)


def _in_frames(track: ObjectTrack, frames: Bool[np.ndarray, "T"]) -> ObjectTrack:
    return replace(track, positions=track.positions[frames], quats=track.quats[frames])


def _below(human: Person, part: str, track: ObjectTrack, points: Float[np.ndarray, "T 3"]) -> Bool[np.ndarray, "T"]:
    """Return where the nearest point of an object, in its frame [m], is below a part's bone; not where it is NaN."""
    place = track.positions + se3.rotate(track.quats, points)
    (capsule,) = RESTING_CAPSULES[part]
    ways = capsule.axis(human) - place[:, None]
    lengths = np.linalg.norm(ways, axis=2)
    nearest = np.nan_to_num(lengths, nan=np.inf).argmin(axis=1)
    rows = np.arange(len(ways))
    return ways[rows, nearest, 2] > np.cos(STEEPEST) * lengths[rows, nearest]
