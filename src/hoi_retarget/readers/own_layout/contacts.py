"""The contacts of a clip: for each frame, or by segments."""

import difflib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.errors import ClipError
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import PARTS
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.readers.own_layout.arrays import Arrays
from hoi_retarget.readers.own_layout.layout import FLAGS, INTEGERS, NUMBERS, TEXT

_POINTS_NOTE = "Contact points are where the parts are, as the clip names none."


@dataclass(frozen=True)
class _Touch:
    """Who touches what."""

    person: int
    object: int
    part: str


def contacts_of(
    arrays: Arrays, people: tuple[Person, ...], tracks: tuple[ObjectTrack, ...]
) -> tuple[tuple[ContactTrack, ...], tuple[str, ...]]:
    """Return the contacts, none where the clip has none, and notes of what was derived; raises `ClipError`."""
    if "contact_part" in arrays and "segment_part" in arrays:
        raise ClipError(f"{arrays.path}: there are contact_part and segment_part. Give contacts in one way.")
    if "contact_part" in arrays:
        return _frame_contacts(arrays, people, tracks)
    if "segment_part" in arrays:
        return _segment_contacts(arrays, people, tracks)
    return (), ()


def _touches(arrays: Arrays, prefix: str, people: int, objects: int) -> Iterator[_Touch]:
    parts = arrays.array(f"{prefix}_part", TEXT, ("C",), "the parts that touch").tolist()
    columns = {}
    for what, count in (("person", people), ("object", objects)):
        name = f"{prefix}_{what}"
        if name in arrays or (what == "object" and objects != 1):
            columns[what] = arrays.array(name, INTEGERS, (len(parts),), f"the index of the {what}")
        else:
            columns[what] = np.zeros(len(parts), dtype=int)
        bad = (columns[what] < 0) | (columns[what] >= count)
        if bad.any():
            raise ClipError(f"{arrays.path}: {name} has {columns[what][bad][0]}; there are {count}, counted from 0.")
    for part, person, thing in zip(parts, columns["person"], columns["object"], strict=True):
        if part not in PARTS:
            close = difflib.get_close_matches(part, PARTS, n=1)
            hint = f"Did you mean {close[0]!r}? " if close else ""
            raise ClipError(
                f"{arrays.path}: {prefix}_part has {part[:40]!r}, which is no part. {hint}Parts: {', '.join(PARTS)}."
            )
        yield _Touch(int(person), int(thing), part)


def _part_points(touch: _Touch, people: tuple[Person, ...], tracks: tuple[ObjectTrack, ...]) -> np.ndarray:
    return tracks[touch.object].to_object(people[touch.person].part_position(touch.part))


def _frame_contacts(
    arrays: Arrays, people: tuple[Person, ...], tracks: tuple[ObjectTrack, ...]
) -> tuple[tuple[ContactTrack, ...], tuple[str, ...]]:
    touches = tuple(_touches(arrays, "contact", len(people), len(tracks)))
    shape = (len(people[0].joint_positions), len(touches))
    flags = arrays.array("contact_flags", FLAGS, shape, "when the parts touch")
    if "contact_points" not in arrays:
        made = (_part_points(touch, people, tracks) for touch in touches)
        points, notes = np.stack(list(made), axis=1) if touches else np.zeros((*shape, 3)), (_POINTS_NOTE,)
    else:
        points, notes = arrays.array("contact_points", NUMBERS, (*shape, 3), "where, in the object's frame [m]"), ()
        bad = np.argwhere(flags & ~np.isfinite(points).all(axis=2))
        if len(bad):
            raise ClipError(
                f"{arrays.path}: contact_points{bad[0].tolist()} is not finite, although contact_flags says that "
                f"{touches[bad[0][1]].part} touches there. Name the point, or leave contact_points out."
            )
    return tuple(
        ContactTrack(touch.person, touch.object, touch.part, flags[:, index], points[:, index])
        for index, touch in enumerate(touches)
    ), notes


def _segment_contacts(
    arrays: Arrays, people: tuple[Person, ...], tracks: tuple[ObjectTrack, ...]
) -> tuple[tuple[ContactTrack, ...], tuple[str, ...]]:
    touches = tuple(_touches(arrays, "segment", len(people), len(tracks)))
    frames = len(people[0].joint_positions)
    bounds = arrays.array("segment_frames", INTEGERS, (len(touches), 2), "first frame and one past the last")
    fixed = None
    if "segment_points" in arrays:
        fixed = arrays.array("segment_points", NUMBERS, (len(touches), 3), "where, in the object's frame [m]")
    active = {touch: np.zeros(frames, dtype=bool) for touch in touches}
    points = {touch: _part_points(touch, people, tracks).copy() for touch in touches}
    for index, (touch, (start, stop)) in enumerate(zip(touches, bounds.tolist(), strict=True)):
        if not 0 <= start < stop <= frames:
            raise ClipError(
                f"{arrays.path}: segment_frames[{index}] is {start} to {stop}, expected the first frame and one past "
                f"the last, within 0 and {frames}."
            )
        if active[touch][start:stop].any():
            raise ClipError(
                f"{arrays.path}: segment_frames[{index}] overlaps another segment of {touch.part} on "
                f"{tracks[touch.object].name!r}. Join them or cut one."
            )
        active[touch][start:stop] = True
        if fixed is not None:
            points[touch][start:stop] = fixed[index]
    made = tuple(ContactTrack(it.person, it.object, it.part, active[it], points[it]) for it in active)
    return made, (_POINTS_NOTE,) if fixed is None else ()
