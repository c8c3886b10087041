"""Contacts of a clip: those of its source, or where it has none, those that distances between body and object show.

Every decision becomes a note of the clip.
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from hoi_retarget.clip.carrying import carried, is_moving
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.grasp_check import READINGS, WAY_ON
from hoi_retarget.clip.label_contacts import PROXIMITY, InterAct, Nearness, label_contacts, nearness
from hoi_retarget.clip.read_options import Grasps, Labels
from hoi_retarget.errors import ClipError
from hoi_retarget.numerics import se3

LEAST_MOVING = 10
"""Frames of moving that an object's poses are judged from."""
LEAST_HELD, CLEARLY_HELD = 0.5, 0.3
"""Share of these frames with somebody at the object below which its poses are doubted, and how much better
inverted rotations must be to be believed."""


def with_contacts(
    clip: Clip,
    labels: Labels = "auto",
    *,
    readings: Collection[str] = tuple(READINGS),
    grasps: Grasps = "refuse",
) -> Clip:
    """Return a clip whose contacts are those of its source, or where it has none, or others are asked for, geometry's.

    Args:
        clip: its floor is at z = 0.
        labels: `auto` keeps the source's contacts where it has any; `proximity` and `interact` find them anew by the
            rule of that name (`label_contacts.Proximity`, `label_contacts.InterAct`).
        readings: those of `grasp_check.READINGS` that the clip's format leaves open.
        grasps: `warn` keeps a clip whose rotations seem inverted.

    Raises:
        ClipError: objects move with nobody near, but not when their rotations are inverted, and `grasps` is `refuse`.
        GeometryError: an object's mesh cannot be read.
    """
    if not clip.objects:
        return clip
    if clip.contacts and labels == "auto":
        return _with_untouched(clip)
    rule = InterAct() if labels == "interact" else PROXIMITY
    near = nearness(clip)
    unheld = _unheld(clip, near, inverse="inverse" in readings, grasps=grasps)
    contacts = label_contacts(clip, rule=rule, near=near)
    why = "as was asked for" if clip.contacts else "as the source labels none"
    note = f"Contacts are found from distances between body and object ({type(rule).__name__}'s rule), {why}."
    found = _with_note(replace(clip, contacts=contacts), note)
    return found.with_warnings("unheld_object", unheld) if unheld else _with_untouched(found)


def _with_note(clip: Clip, note: str) -> Clip:
    return replace(clip, source=replace(clip.source, notes=(*clip.source.notes, note)))


def _with_untouched(clip: Clip) -> Clip:
    """Return a clip that says where objects move and nothing is ever touched by a hand or a foot."""
    frames = [int(is_moving(track, clip.fps).sum()) for track in clip.objects]
    moved = [index for index, moving in enumerate(frames) if moving >= LEAST_MOVING]
    if not moved or any(track.active.any() for track in clip.contacts):
        return clip
    listing = " and ".join(f"{clip.objects[index].name} moves in {frames[index]} frames" for index in moved)
    near = nearness(clip)
    held, by_body = [_held(near, index, clip) for index in moved], _carried(clip)
    if max(held) < LEAST_HELD <= min(by_body[index] for index in moved):
        return _with_note(clip, f"{listing}, by other parts of the body than hands and feet: none of them touches.")
    return clip.with_warnings(
        "untouched_object",
        (
            f"Nobody touches anything, although {listing}: see --labels, or add contacts with "
            "`hoi-retarget contacts --add` or in the editor.",
        ),
    )


def _unheld(clip: Clip, near: tuple[Nearness, ...], *, inverse: bool, grasps: Grasps) -> tuple[str, ...]:
    """Return a warning for each object that moves with nobody near; raises `ClipError` where rotations are inverted."""
    doubtful = [
        index
        for index, track in enumerate(clip.objects)
        if is_moving(track, clip.fps).sum() >= LEAST_MOVING and _held(near, index, clip) < LEAST_HELD
    ]
    by_body = _carried(clip) if doubtful else []
    texts: tuple[str, ...] = ()
    for index in doubtful:
        track, held = clip.objects[index], by_body[index]
        other = _held_inverted(clip, index) if inverse else 0.0
        if other > held + CLEARLY_HELD:
            fault = (
                f"the rotations of {track.name!r} are read wrongly: somebody is at it in {held:.0%} of the frames in "
                f"which it moves, with inverse rotations a hand or a foot in {other:.0%}. This copy of the data has "
                "another convention than its source."
            )
            if grasps == "refuse":
                raise ClipError(f"{clip.source.path or clip.name}: {fault} {WAY_ON}")
            texts += (fault[0].upper() + fault[1:],)
        elif held < LEAST_HELD:
            texts += (
                f"{track.name} moves in {is_moving(track, clip.fps).sum()} frames, in {1 - held:.0%} of them with "
                "nobody within 10 cm of it or of an object that it rides on: its poses, its shape or the recording's "
                "alignment may be wrong.",
            )
    return texts


def _held_inverted(clip: Clip, index: int) -> float:
    """Return what `_held` would be if an object's rotations were inverted."""
    track = clip.objects[index]
    inverted = replace(clip, objects=(replace(track, quats=se3.quat_conjugate(track.quats)),), contacts=())
    there = _at_hand(nearness(inverted), 0)
    return float(there[is_moving(track, clip.fps)].mean())


def _held(near: tuple[Nearness, ...], index: int, clip: Clip) -> float:
    """Return in which share of the frames in which an object moves somebody's hand or foot is near it."""
    return float(_at_hand(near, index)[is_moving(clip.objects[index], clip.fps)].mean())


def _at_hand(near: tuple[Nearness, ...], index: int) -> Bool[np.ndarray, "T"]:
    return np.any([np.isfinite(item.distances) for item in near if item.object == index], axis=0)


def _carried(clip: Clip) -> list[float]:
    """Return in which share of the frames in which it moves somebody may move each object; 0 where it never does."""
    flags = carried(clip)
    moving = [is_moving(track, clip.fps) for track in clip.objects]
    return [float(there[when].mean()) if when.any() else 0.0 for there, when in zip(flags, moving, strict=True)]
