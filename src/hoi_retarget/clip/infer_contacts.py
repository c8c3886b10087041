"""Contacts of a clip, of its source or else from distances between body and object; who may move an object.

Every decision becomes a note of the clip. An object may be moved by somebody with the body beside it, or beside
another object that it rides on.
"""

from collections.abc import Collection
from dataclasses import replace
from itertools import product

import numpy as np
from jaxtyping import Bool

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.clip.grasp_check import ADVICE, READINGS
from hoi_retarget.clip.label_contacts import (
    FAR,
    PartObjectDistance,
    body_distances,
    label_contacts,
    part_object_distances,
)
from hoi_retarget.clip.read_options import Grasps, Labels
from hoi_retarget.clip.resting_contacts import resting_contacts
from hoi_retarget.errors import ClipError
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import speeds
from hoi_retarget.objects.track import MOVING_SPEED, ObjectTrack

_RIDING_SHARE = 0.5  # An object on another one moves against it with less than this share of its own speed.
_MIN_MOVING_FRAMES = 10  # An object's poses are judged from at least so many frames of moving.
MIN_HELD_SHARE, MIN_HELD_GAIN = 0.5, 0.3
"""Share of these frames with somebody at the object below which its poses are doubted, and the gain by inverted
rotations above which these are believed."""


def with_contacts(
    clip: Clip, labels: Labels = "auto", *, readings: Collection[str] = tuple(READINGS), grasps: Grasps = "refuse"
) -> Clip:
    """Return a clip with the contacts of its source, or where it has none, or others are requested, of geometry.

    `clip`: its floor is at z = 0; `labels`: `auto` keeps the source's contacts where it has any; `proximity` finds them
    anew; `readings`: those of `grasp_check.READINGS` that the clip's format leaves open; `grasps`: `warn` keeps a clip
    whose rotations seem inverted. Raises `ClipError`: objects move with nobody near, but not when their rotations are
    inverted, and `grasps` is `refuse`; `GeometryError`: an object's mesh cannot be read.
    """
    if not clip.objects:
        return clip
    if clip.contacts and labels == "auto":
        return _with_untouched(_with_seat(clip))
    near = part_object_distances(clip)
    unheld = _unheld(clip, near, inverse="inverse" in readings, grasps=grasps)
    contacts = (*label_contacts(clip, near=near), *_resting(clip))
    why = "as was asked for" if clip.contacts else "as the source labels none"
    note = f"Contacts are found from distances between body and object, {why}."
    found = replace(clip, contacts=contacts).with_note(note)
    return found.with_warnings("unheld_object", unheld) if unheld else _with_untouched(found)


def _resting(clip: Clip, *, seats_only: bool = False) -> tuple[ContactTrack, ...]:
    return resting_contacts(clip, [~is_moving(track, clip.fps) for track in clip.objects], seats_only=seats_only)


def _with_seat(clip: Clip) -> Clip:
    """Return a clip with contacts of people who sit, beside those of its source, which labels hands and feet alone."""
    found = _resting(clip, seats_only=True)
    if not found:
        return clip
    seats = sorted({(track.person, track.object) for track in found})
    names = " and ".join(dict.fromkeys(clip.objects[index].name for _, index in seats))
    note = f"Somebody sits on {names}, which is found from distances; the source labels no seats."
    return replace(clip, contacts=(*clip.contacts, *found)).with_note(note)


def _with_untouched(clip: Clip) -> Clip:
    """Return a clip with a note or a warning if objects move and no hand or foot ever touches anything."""
    frames = [int(is_moving(track, clip.fps).sum()) for track in clip.objects]
    moved = [index for index, moving in enumerate(frames) if moving >= _MIN_MOVING_FRAMES]
    if not moved or any(track.active.any() for track in clip.contacts):
        return clip
    listing = " and ".join(f"{clip.objects[index].name} moves in {frames[index]} frames" for index in moved)
    near = part_object_distances(clip)
    held, by_body = [_held(near, index, clip) for index in moved], _moved_by_somebody(clip)
    if max(held) < MIN_HELD_SHARE <= min(by_body[index] for index in moved):
        return clip.with_note(f"{listing}, by other parts of the body than hands and feet: none of them touches.")
    return clip.with_warnings(
        "untouched_object",
        (
            f"Nobody touches anything, although {listing}: see --labels, or add contacts with "
            "`hoi-retarget contacts --add` or in the editor.",
        ),
    )


def _unheld(clip: Clip, near: tuple[PartObjectDistance, ...], *, inverse: bool, grasps: Grasps) -> tuple[str, ...]:
    """Return a warning for each object that moves with nobody near; raises `ClipError` where rotations are inverted."""
    doubtful = [
        index
        for index, track in enumerate(clip.objects)
        if is_moving(track, clip.fps).sum() >= _MIN_MOVING_FRAMES and _held(near, index, clip) < MIN_HELD_SHARE
    ]
    by_body = _moved_by_somebody(clip) if doubtful else []
    texts: tuple[str, ...] = ()
    for index in doubtful:
        track, held = clip.objects[index], by_body[index]
        other = _held_inverted(clip, index) if inverse else 0.0
        if other > held + MIN_HELD_GAIN:
            fault = (
                f"the rotations of {track.name!r} are read wrongly: somebody is at it in {held:.0%} of the frames in "
                f"which it moves, with inverse rotations a hand or a foot in {other:.0%}. This copy of the data has "
                "another convention than its source."
            )
            if grasps == "refuse":
                raise ClipError(f"{clip.source.path or clip.name}: {fault} {ADVICE}")
            texts += (fault[0].upper() + fault[1:],)
        elif held < MIN_HELD_SHARE:
            texts += (
                f"{track.name} moves in {is_moving(track, clip.fps).sum()} frames, in {1 - held:.0%} of them with "
                "nobody within 10 cm of it or of an object that it rides on: its poses, its shape or the recording's "
                "alignment may be wrong.",
            )
    return texts


def _held_inverted(clip: Clip, index: int) -> float:
    """Return the result of `_held` for inverted rotations of an object."""
    track = clip.objects[index]
    inverted = replace(clip, objects=(replace(track, quats=se3.quat_conjugate(track.quats), joint=None),), contacts=())
    there = _at_hand(part_object_distances(inverted), 0)
    return float(there[is_moving(track, clip.fps)].mean())


def _held(near: tuple[PartObjectDistance, ...], index: int, clip: Clip) -> float:
    """Return the share of an object's moving frames with somebody's hand or foot near it."""
    return float(_at_hand(near, index)[is_moving(clip.objects[index], clip.fps)].mean())


def _at_hand(near: tuple[PartObjectDistance, ...], index: int) -> Bool[np.ndarray, "T"]:
    return np.any([np.isfinite(item.distances) for item in near if item.object == index], axis=0)


def _moved_by_somebody(clip: Clip) -> list[float]:
    """Return the share of each object's moving frames in which somebody may move it; 0 if it never moves."""
    flags = may_move_object(clip)
    moving = [is_moving(track, clip.fps) for track in clip.objects]
    return [float(there[when].mean()) if when.any() else 0.0 for there, when in zip(flags, moving, strict=True)]


def is_moving(track: ObjectTrack, fps: float) -> Bool[np.ndarray, "T"]:
    """Return when the middle of an object's box moves."""
    return speeds(track.corners.mean(axis=1), fps) > MOVING_SPEED


def may_move_object(clip: Clip) -> Bool[np.ndarray, "O T"]:
    """Return when any part of anybody's body is within `FAR` of each object, or of another that it rides on.

    Raises `GeometryError` where an object's mesh cannot be read.
    """
    found = np.stack([body_distances(clip, index) <= FAR for index in range(len(clip.objects))])
    pairs = [(i, j) for i, j in product(range(len(found)), repeat=2) if i != j]
    rides = {(i, j): _rides(clip.objects[i], clip.objects[j], clip.fps) for i, j in pairs}
    for _ in clip.objects:  # Objects on objects on objects.
        for (rider, carrier), flags in rides.items():
            found[rider] |= flags & found[carrier]
    return found


def _rides(rider: ObjectTrack, carrier: ObjectTrack, fps: float) -> Bool[np.ndarray, "T"]:
    """Return when an object is at another one and moves as this does."""
    corners, others = rider.corners, carrier.corners
    path = corners.mean(axis=1)
    along = speeds(carrier.to_object(path), fps) < np.maximum(MOVING_SPEED, _RIDING_SHARE * speeds(path, fps))
    above, below = corners.min(axis=1) <= others.max(axis=1) + FAR, others.min(axis=1) <= corners.max(axis=1) + FAR
    return along & (above & below).all(axis=1)
