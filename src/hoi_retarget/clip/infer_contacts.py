"""Contacts of a clip: those of its source, or where it has none, those that distances between body and object show.

Every decision becomes a note of the clip.
"""

from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.label_contacts import PROXIMITY, InterAct, Nearness, label_contacts, nearness
from hoi_retarget.errors import ClipError
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import speeds
from hoi_retarget.objects.track import MOVING_SPEED, ObjectTrack

Labels = Literal["auto", "proximity", "interact"]

LEAST_MOVING = 10
"""Frames of moving that an object's poses are judged from."""
LEAST_HELD, CLEARLY_HELD = 0.5, 0.3
"""Share of these frames with somebody at the object below which its poses are doubted, and how much better
inverted rotations must be to be believed."""


def with_contacts(clip: Clip, labels: Labels = "auto") -> Clip:
    """Return a clip whose contacts are those of its source, or where it has none, or others are asked for, geometry's.

    Args:
        clip: its floor is at z = 0.
        labels: `auto` keeps the source's contacts where it has any; `proximity` and `interact` find them anew by the
            rule of that name (`label_contacts.Proximity`, `label_contacts.InterAct`).

    Raises:
        ClipError: objects move with nobody near, but not when their rotations are inverted.
        GeometryError: an object's mesh cannot be read.
    """
    if not clip.objects:
        return clip
    if clip.contacts and labels == "auto":
        return clip.with_warnings("untouched_object", _untouched(clip))
    rule = InterAct() if labels == "interact" else PROXIMITY
    near = nearness(clip)
    unheld = _unheld(clip, near)
    contacts = label_contacts(clip, rule=rule, near=near)
    why = "as was asked for" if clip.contacts else "as the source labels none"
    note = f"Contacts are found from distances between body and object ({type(rule).__name__}'s rule), {why}."
    source = replace(clip.source, notes=(*clip.source.notes, note))
    found = replace(clip, contacts=contacts, source=source)
    if unheld:
        return found.with_warnings("unheld_object", unheld)
    return found.with_warnings("untouched_object", _untouched(found))


def _untouched(clip: Clip) -> tuple[str, ...]:
    """Return a warning where objects move and nothing is ever touched."""
    moving = {track.name: int(_moving(track, clip.fps).sum()) for track in clip.objects}
    moved = [f"{name} moves in {frames} frames" for name, frames in moving.items() if frames >= LEAST_MOVING]
    if not moved or any(track.active.any() for track in clip.contacts):
        return ()
    return (
        f"Nobody touches anything, although {' and '.join(moved)}: see --labels, or add contacts with "
        "`hoi-retarget contacts --add` or in the editor.",
    )


def _unheld(clip: Clip, near: tuple[Nearness, ...]) -> tuple[str, ...]:
    """Return a warning for each object that moves with nobody near; raises `ClipError` where rotations are inverted."""
    texts: tuple[str, ...] = ()
    for index, track in enumerate(clip.objects):
        moving = _moving(track, clip.fps)
        held = _held(near, index, moving)
        if moving.sum() < LEAST_MOVING or held >= LEAST_HELD:
            continue
        inverted = replace(clip, objects=(replace(track, quats=se3.quat_conjugate(track.quats)),), contacts=())
        other = _held(nearness(inverted), 0, moving)
        if other > held + CLEARLY_HELD:
            raise ClipError(
                f"{clip.source.path or clip.name}: the rotations of {track.name!r} are read wrongly: a hand or a foot "
                f"is at it in {held:.0%} of the frames in which it moves, with inverse rotations in {other:.0%}. "
                "This copy of the data has another convention than its source."
            )
        texts += (
            f"{track.name} moves in {moving.sum()} frames, in {1 - held:.0%} of them with no hand or foot within "
            "10 cm: its poses, its shape or the recording's alignment may be wrong.",
        )
    return texts


def _moving(track: ObjectTrack, fps: float) -> Bool[np.ndarray, "T"]:
    """Return when the middle of an object's box moves."""
    points = track.geometry.points
    middle: Float[np.ndarray, "3"] = 0.5 * (points.min(axis=0) + points.max(axis=0))
    path = track.positions + se3.rotate(track.quats, middle)
    return speeds(path, fps) > MOVING_SPEED


def _held(near: tuple[Nearness, ...], index: int, moving: Bool[np.ndarray, "T"]) -> float:
    """Return in which share of the frames in which an object moves somebody's part is near it."""
    there = np.any([np.isfinite(item.distances) for item in near if item.object == index], axis=0)
    return float(there[moving].mean()) if moving.any() else 1.0
