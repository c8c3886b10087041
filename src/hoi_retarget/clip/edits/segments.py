"""Segments: the contacts of a clip one by one, each with its frames and a point for every one of them."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import Clip, ContactTrack, Vector
from hoi_retarget.human.skeleton import ALL_PARTS
from hoi_retarget.numerics.arrays import check_finite, check_shape, frozen, runs

_PART_ORDER = {part: index for index, part in enumerate(ALL_PARTS)}


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
    hold: int = 0
    turn: Vector = (0.0, 0.0, 0.0)  # As those of the contact's track.

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
            owner = track.person, track.part, track.object
            found.append(Segment(*owner, start, stop, points, track.hold, track.turn))
    return in_order(found)


def tracks_of(segments: Iterable[Segment], frames: int) -> tuple[ContactTrack, ...]:
    """Return one contact track per segment, so that neighbours stay apart, over `frames` frames."""
    tracks = []
    for segment in segments:
        active, points = np.zeros(frames, dtype=bool), np.full((frames, 3), np.nan)
        active[segment.start : segment.stop] = True
        points[segment.start : segment.stop] = segment.points
        owner = segment.person, segment.object, segment.part
        tracks.append(ContactTrack(*owner, active, points, segment.hold, segment.turn))
    return tuple(tracks)


def in_order(segments: Iterable[Segment]) -> Segments:
    """Return segments by person, part and time."""
    return tuple(sorted(segments, key=lambda item: (item.person, _PART_ORDER[item.part], item.start)))


def part_text(person: int, part: str) -> str:
    """Return the text for a person's part: `left_hand`, or `p1.left_hand` for the second person."""
    return f"p{person}.{part}" if person else part


def span_text(start: int, stop: int) -> str:
    """Return the frames from `start` to `stop`, the last one not included, as words."""
    return f"frame {start}" if stop - start == 1 else f"frames {start} to {stop - 1}"
