"""Segments: the contacts of a clip one by one, each with its frames and a point for every one of them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.errors import ClipError
from hoi_retarget.human.skeleton import PARTS
from hoi_retarget.numerics.arrays import check_finite, check_shape, frozen, runs

_SHOWN = 6  # Segments that a message names.
_PART_ORDER = {part: index for index, part in enumerate(PARTS)}


@dataclass(frozen=True, eq=False)
class Segment:
    """One contact: a part of a person touches an object from frame `start` to the one before `stop`."""

    person: int
    part: str
    object: int
    start: int
    stop: int
    points: Float[np.ndarray, "F 3"]
    """A point for each of its F = stop - start frames, in the object's frame at captured size [m]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points))
        check_shape(f"segment of {self.part!r}", "points", self.points, (self.frames, 3))
        check_finite(f"segment of {self.part!r}", {"points": self.points})

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return self.stop - self.start

    @property
    def spread(self) -> float:
        """Largest distance of a point from the mean of them all [m]: 0 for a fixed point."""
        return float(np.linalg.norm(self.points - self.points.mean(axis=0), axis=1).max())

    def holds(self, frame: int) -> bool:
        """Return whether a frame is one of its own."""
        return self.start <= frame < self.stop

    def __str__(self) -> str:
        return span_text(self.start, self.stop)


Segments = tuple[Segment, ...]


def segments_of(clip: Clip) -> Segments:
    """Return a clip's contacts by person, part and time.

    Where a clip names several contacts of one part in one frame, the first one holds, as it does for the robot.
    """
    taken: dict[tuple[int, str], np.ndarray] = {}
    found = []
    for track in clip.contacts:
        before = taken.setdefault((track.person, track.part), np.zeros(clip.frames, dtype=bool))
        own = track.active & ~before
        before |= own
        for start, stop in runs(own):
            points = track.contact_points[start:stop]
            found.append(Segment(track.person, track.part, track.object, start, stop, points))
    return in_order(found)


def tracks_of(segments: Iterable[Segment], frames: int) -> tuple[ContactTrack, ...]:
    """Return one contact track per segment, so that neighbours stay apart, over `frames` frames."""
    tracks = []
    for segment in segments:
        active, points = np.zeros(frames, dtype=bool), np.full((frames, 3), np.nan)
        active[segment.start : segment.stop] = True
        points[segment.start : segment.stop] = segment.points
        tracks.append(ContactTrack(segment.person, segment.object, segment.part, active, points))
    return tuple(tracks)


def in_order(segments: Iterable[Segment]) -> Segments:
    """Return segments by person, part and time."""
    return tuple(sorted(segments, key=lambda item: (item.person, _PART_ORDER[item.part], item.start)))


def segment_at(clip: Clip, segments: Segments, person: int, part: str, frame: int) -> Segment:
    """Return the segment of a person's part that holds a frame; raises `ClipError`, which names the nearest ones.

    Args:
        clip: Of the segments, for messages.
        segments: All of the clip.
        person: Index of the person.
        part: One of `PARTS`.
        frame: Any frame of the segment.
    """
    own = of_part(clip, segments, person, part)
    for segment in own:
        if segment.holds(frame):
            return segment
    raise ClipError(f"{part_text(person, part)} touches nothing in frame {frame}. {_listing(clip, own, frame)}")


def of_part(clip: Clip, segments: Segments, person: int, part: str) -> Segments:
    """Return the segments of a person's part; raises `ClipError` where there is no such person.

    Args:
        clip: Of the segments.
        segments: All of the clip.
        person: Index of the person.
        part: One of `PARTS`.
    """
    check_person(clip, person)
    return tuple(segment for segment in segments if (segment.person, segment.part) == (person, part))


def check_person(clip: Clip, person: int) -> None:
    """Raise `ClipError` unless the clip has this person."""
    if person >= len(clip.people):
        last = len(clip.people) - 1
        raise ClipError(f"there is no person {person}; the clip has {f'persons 0 to {last}' if last else 'person 0'}.")


def check_frames(clip: Clip, start: int, stop: int) -> None:
    """Raise `ClipError` unless the clip has frames `start` to the one before `stop`."""
    if stop > clip.frames:
        raise ClipError(f"the clip has frames 0 to {clip.frames - 1}; asked for: {span_text(start, stop)}.")


def exchanged(clip: Clip, segments: Segments, old: Sequence[Segment], new: Sequence[Segment]) -> Segments:
    """Return the segments with `new` in the place of `old`; raises `ClipError` where two of one part overlap.

    Args:
        clip: Of the segments, for messages.
        segments: All of the clip.
        old: Some of them.
        new: Any number of others.
    """
    result = [segment for segment in segments if not any(segment is item for item in old)]
    for segment in new:
        for other in result:
            same = (other.person, other.part) == (segment.person, segment.part)
            start, stop = max(segment.start, other.start), min(segment.stop, other.stop)
            if same and start < stop:
                raise ClipError(
                    f"{part_text(segment.person, segment.part)} touches {clip.objects[other.object].name!r} in {other} "
                    f"already, and one part touches one thing at a time: {span_text(start, stop)} would be in both. "
                    "Cut or delete one of them first."
                )
        result.append(segment)
    return in_order(result)


def part_text(person: int, part: str) -> str:
    """Return the text for a person's part: `left_hand`, or `p1.left_hand` for the second person."""
    return f"p{person}.{part}" if person else part


def span_text(start: int, stop: int) -> str:
    """Return frames `start` to the one before `stop` as words."""
    return f"frame {start}" if stop - start == 1 else f"frames {start} to {stop - 1}"


def _listing(clip: Clip, own: Sequence[Segment], frame: int) -> str:
    if not own:
        return "It touches nothing in the whole clip."
    near = sorted(own, key=lambda item: max(item.start - frame, frame - item.stop + 1))[:_SHOWN]
    texts = [f"{clip.objects[item.object].name!r} in {item}" for item in in_order(near)]
    more = f" and {len(own) - len(near)} more" if len(own) > len(near) else ""
    return f"It touches {', '.join(texts)}{more}."
