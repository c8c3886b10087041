"""Operations on the contact segments and the pins of a clip: their fields, checked when made, and their effects.

An operation names a segment by its part, its person, and any frame in it: one part touches one object at a time, so no
more is needed. Points and offsets are in the object's frame at captured size.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any, ClassVar, get_args

import numpy as np

from hoi_retarget.clip.clip import PINNED_PARTS, Clip, PosePin, pinned_path
from hoi_retarget.clip.edits.segments import Segment, Segments, in_order, part_text, span_text
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.human.skeleton import ALL_PARTS, HANDS
from hoi_retarget.objects.mesh import surface_of

Point = tuple[float | int, float | int, float | int]

_LARGEST_COORDINATE = 100.0  # [m]; points farther from an object's origin are another unit or a slip.
_LARGEST_TURN = 180.0  # [degrees]
_SHOWN = 6  # Segments that a message names.


class Operation:
    """An operation on a clip; its fields are checked, and numbers made plain, when it is made."""

    parts: ClassVar[tuple[str, ...]] = tuple(ALL_PARTS)  # That it can name.
    verb: ClassVar[str] = "touch"  # Of these parts, for messages.

    def __post_init__(self) -> None:
        for item in fields_of(type(self)):
            value = getattr(self, item.name)
            if value is not None or item.default is not None:
                object.__setattr__(self, item.name, self.plain(item.name, value))

    @classmethod
    def plain(cls, name: str, value: Any) -> str | int | tuple[float, ...]:
        """Return the value of a field as a plain one, in its unit; raises `ArgumentError` where it means nothing."""
        if name == "part":
            if isinstance(value, str) and value in cls.parts:
                return value
            raise ArgumentError(f"part is {value!r}; parts that can {cls.verb}: {', '.join(cls.parts)}.")
        if name in _VECTORS:
            largest, unit = _VECTORS[name]
            numbers = list(value) if isinstance(value, Iterable) and not isinstance(value, str | bytes) else []
            if len(numbers) == 3 and all(_is_real(number) and abs(number) <= largest for number in numbers):
                return tuple(float(number) for number in numbers)
            expected = f"three numbers in {unit}, none beyond {largest:g}"
        elif name == "object":
            if isinstance(value, str):
                return value
            expected = "a name"
        else:
            if _is_real(value) and isinstance(value, int | np.integer) and value >= 0:
                return int(value)
            expected = "a whole number from 0 on"
        raise ArgumentError(f"{name} is {value!r}; expected {expected}.")


def fields_of(kind: type[Operation]) -> list["Field[Any]"]:
    """Return the fields of an operation in the order in which files have them: the person last."""
    return sorted(fields(kind), key=lambda item: bool(item.kw_only))  # pyright: ignore[reportArgumentType]  # a dataclass


_VECTORS = {
    **dict.fromkeys(("offset", "point", "position"), (_LARGEST_COORDINATE, "metres")),
    "turn": (_LARGEST_TURN, "degrees"),
}


def _is_real(number: Any) -> bool:
    return isinstance(number, int | float | np.integer | np.floating) and not isinstance(number, bool)


LARGEST_DISTANCE = 1.0
"""[m] from where the part is in the recording: nobody gets farther within the fraction of a second around a pin."""

Pins = tuple[PosePin, ...]


class PinOperation(Operation):
    """An operation on the pins of a clip."""

    parts: ClassVar[tuple[str, ...]] = PINNED_PARTS
    verb: ClassVar[str] = "be pinned"

    def on_pins(self, clip: Clip, pins: Pins) -> Pins:
        """Return the pins after the operation; raises `ClipError` for an absent person, frame or pin, or no reach."""
        raise NotImplementedError


@dataclass(frozen=True)
class Pin(PinOperation):
    """Put a part somewhere in one frame, in the place of an earlier pin there."""

    part: str
    frame: int
    position: Point  # In the world of the recording, at captured size [m].
    turn: Point | None = None
    """Rotation vector in the world's axes, on top of the recorded part's [degrees]; None leaves the rotation free."""
    person: int = field(default=0, kw_only=True)

    def on_pins(self, clip: Clip, pins: Pins) -> Pins:
        """Return the pins after the operation, by person, part and time."""
        _check_clip_has(clip, self.person, self.frame, self.frame + 1)
        recorded = pinned_path(clip.people[self.person], self.part)[self.frame]
        away = float(np.linalg.norm(recorded - self.position))
        if away > LARGEST_DISTANCE:
            place = ", ".join(f"{number:.3f}" for number in recorded)
            raise ClipError(
                f"out of reach: {away:.2f} m from where {part_text(self.person, self.part)} is in frame {self.frame} "
                f"of the recording, ({place}). A pin may be {LARGEST_DISTANCE:g} m away."
            )
        pin = PosePin(self.person, self.part, self.frame, self.position, self.turn)
        return tuple(sorted((*_without(pins, self), pin), key=lambda item: item.key))


@dataclass(frozen=True)
class Unpin(PinOperation):
    """Remove a pin."""

    part: str
    frame: int
    person: int = field(default=0, kw_only=True)

    def on_pins(self, clip: Clip, pins: Pins) -> Pins:
        """Return the pins after the operation."""
        left = _without(pins, self)
        if len(left) == len(pins):
            listing = ", ".join(f"{part_text(pin.person, pin.part)} in frame {pin.frame}" for pin in pins)
            raise ClipError(
                f"{part_text(self.person, self.part)} is not pinned in frame {self.frame}. Pinned: {listing or 'none'}."
            )
        return left


def _without(pins: Pins, operation: Pin | Unpin) -> Pins:
    named = (operation.person, operation.part, operation.frame)
    return tuple(pin for pin in pins if (pin.person, pin.part, pin.frame) != named)


class ContactOperation(Operation):
    """An operation on the segments of a clip."""

    def on(self, clip: Clip, segments: Segments) -> Segments:
        """Return the segments after the operation.

        Raises `ClipError` for an absent segment, or a new one that overlaps another or leaves the clip, and
        `GeometryError` where the object's surface is needed and cannot be had.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class SegmentOperation(ContactOperation):
    """An operation that replaces one segment."""

    part: str
    frame: int  # Any frame of the segment as it is now.
    person: int = field(default=0, kw_only=True)

    def on(self, clip: Clip, segments: Segments) -> Segments:
        """Return the segments after the operation."""
        segment = self._segment(clip, self._own(clip, segments))
        return _exchanged(clip, segments, [segment], self._replacements(clip, segment))

    def _own(self, clip: Clip, segments: Segments) -> Segments:
        """Return the segments of the person's part."""
        _check_clip_has(clip, self.person)
        return tuple(item for item in segments if (item.person, item.part) == (self.person, self.part))

    def _segment(self, clip: Clip, own: Segments) -> Segment:
        """Return the segment that holds the frame; raises `ClipError`, which names the nearest ones."""
        near = sorted(own, key=lambda item: max(item.start - self.frame, self.frame - item.stop + 1))[:_SHOWN]
        if near and near[0].holds(self.frame):
            return near[0]
        texts = ", ".join(f"{clip.objects[item.object].name!r} in {item}" for item in in_order(near))
        more = f" and {len(own) - len(near)} more" if len(own) > len(near) else ""
        touched = f"{texts}{more}" if own else "nothing in the whole clip"
        named = part_text(self.person, self.part)
        raise ClipError(f"{named} touches nothing in frame {self.frame}. It touches {touched}.")

    def _replacements(self, clip: Clip, segment: Segment) -> Sequence[Segment]:
        raise NotImplementedError


@dataclass(frozen=True)
class Move(SegmentOperation):
    """Shift all points of a segment alike."""

    offset: Point  # [m]

    def _replacements(self, clip: Clip, segment: Segment) -> Sequence[Segment]:
        return [replace(segment, points=segment.points + self.offset)]


@dataclass(frozen=True)
class ChooseHold(SegmentOperation):
    """Choose another of the holds that a robot's hand could take in a segment; after the last one comes the first."""

    parts: ClassVar[tuple[str, ...]] = HANDS
    verb: ClassVar[str] = "hold"
    rank: int  # 1 for the best hold.

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rank < 1:
            raise ArgumentError("rank is 0; holds are counted from 1, the best one.")

    def _replacements(self, clip: Clip, segment: Segment) -> Sequence[Segment]:
        return [replace(segment, hold=self.rank - 1)]


@dataclass(frozen=True)
class TurnHand(SegmentOperation):
    """Turn the hand of a segment on its object."""

    parts: ClassVar[tuple[str, ...]] = HANDS
    verb: ClassVar[str] = "be turned"
    turn: Point  # Rotation vector about the object's axes, from the recorded hand [degrees].

    def _replacements(self, clip: Clip, segment: Segment) -> Sequence[Segment]:
        return [replace(segment, turn=self.turn)]


@dataclass(frozen=True)
class Retime(SegmentOperation):
    """Let a segment begin and end elsewhere: it is cut, or held with the nearest of its points."""

    start: int  # Its new first frame.
    stop: int  # One past its new last frame.

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_span(self.start, self.stop)

    def _replacements(self, clip: Clip, segment: Segment) -> Sequence[Segment]:
        _check_clip_has(clip, self.person, self.start, self.stop)
        nearest = np.clip(np.arange(self.start, self.stop), segment.start, segment.stop - 1)
        return [replace(segment, start=self.start, stop=self.stop, points=segment.points[nearest - segment.start])]


@dataclass(frozen=True)
class Split(SegmentOperation):
    """Make two segments of one."""

    at: int  # First frame of the second of the two.

    def _replacements(self, clip: Clip, segment: Segment) -> Sequence[Segment]:
        if not segment.start < self.at < segment.stop:
            choice = f"Choose one of frames {segment.start + 1} to {segment.stop - 1}." if segment.frames > 1 else ""
            raise ClipError(
                f"the segment is {segment}: splitting it at {self.at} leaves nothing on one side. {choice}".rstrip()
            )
        length = self.at - segment.start
        return [
            replace(segment, stop=self.at, points=segment.points[:length]),
            replace(segment, start=self.at, points=segment.points[length:]),
        ]


@dataclass(frozen=True)
class Merge(SegmentOperation):
    """Make one segment of this and the part's next one on the same object; points between are interpolated."""

    def on(self, clip: Clip, segments: Segments) -> Segments:
        """Return the segments after the operation: one in the place of two."""
        own = self._own(clip, segments)
        segment = self._segment(clip, own)
        later = [item for item in own if item.start >= segment.stop and item.object == segment.object]
        if not later:
            name = clip.objects[segment.object].name
            raise ClipError(f"after {segment}, {part_text(self.person, self.part)} does not touch {name!r} again.")
        following = later[0]
        gap = following.start - segment.stop
        fraction = np.arange(1, gap + 1)[:, None] / (gap + 1)
        between = segment.points[-1] + fraction * (following.points[0] - segment.points[-1])
        points = np.concatenate([segment.points, between, following.points])
        merged = replace(segment, stop=following.stop, points=points)
        return _exchanged(clip, segments, [segment, following], [merged])


@dataclass(frozen=True)
class Delete(SegmentOperation):
    """Remove a segment: the part no longer touches the object there."""

    def _replacements(self, clip: Clip, segment: Segment) -> Sequence[Segment]:
        return []


@dataclass(frozen=True)
class Add(ContactOperation):
    """Make a new segment with one fixed point."""

    part: str
    start: int  # Its first frame.
    stop: int  # One past its last frame.
    point: Point  # [m]
    object: str | None = None  # The object's name; may be left out where the clip has one object.
    person: int = field(default=0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_span(self.start, self.stop)

    def on(self, clip: Clip, segments: Segments) -> Segments:
        """Return the segments after the operation."""
        _check_clip_has(clip, self.person, self.start, self.stop)
        points = np.tile(self.point, (self.stop - self.start, 1))
        added = Segment(self.person, self.part, self._object_index(clip), self.start, self.stop, points)
        return _exchanged(clip, segments, [], [added])

    def _object_index(self, clip: Clip) -> int:
        names = [track.name for track in clip.objects]
        if self.object is None and len(names) == 1:
            return 0
        if self.object in names:
            return names.index(self.object)
        listing = f"Objects of the clip: {', '.join(names)}." if names else "The clip has no objects."
        what = "which object is touched must be said" if self.object is None else f"there is no object {self.object!r}"
        raise ClipError(f"{what}. {listing}")


@dataclass(frozen=True)
class Fix(SegmentOperation):
    """Give a segment one point for all of its frames, so that the hand does not slip (paper Sec. III-C)."""

    point: Point | None = None  # [m]; the mean of the segment's points where none is given.

    def _replacements(self, clip: Clip, segment: Segment) -> Sequence[Segment]:
        return [_fixed(segment, self.point)]


@dataclass(frozen=True)
class FixAll(ContactOperation):
    """Give every segment of the clip one point, the mean of its own."""

    def on(self, clip: Clip, segments: Segments) -> Segments:
        """Return the segments after the operation."""
        return tuple(_fixed(segment, None) for segment in segments)


@dataclass(frozen=True)
class Snap(SegmentOperation):
    """Move every point of a segment to the nearest point of the object's surface."""

    def _replacements(self, clip: Clip, segment: Segment) -> Sequence[Segment]:
        return [_snapped(clip, segment)]


@dataclass(frozen=True)
class SnapAll(ContactOperation):
    """Move every point of every segment of the clip to the nearest point of the object's surface."""

    def on(self, clip: Clip, segments: Segments) -> Segments:
        """Return the segments after the operation."""
        return tuple(_snapped(clip, segment) for segment in segments)


Edit = (
    Move | ChooseHold | TurnHand | Retime | Split | Merge | Delete | Add | Fix | FixAll | Snap | SnapAll | Pin | Unpin
)


def operation_name(kind: type[Operation]) -> str:
    """Return the name of a kind of edits in `OPERATIONS`."""
    return re.sub("(?<=[a-z])(?=[A-Z])", "_", kind.__name__).lower()


OPERATIONS: Mapping[str, type[Edit]] = MappingProxyType({operation_name(kind): kind for kind in get_args(Edit)})
"""The operations by their names in files: `move`, ..., `snap_all`."""


def describe(edit: Edit) -> str:
    """Return an edit in a few words, such as `split, left_hand, frame 50, at 60`."""
    name = operation_name(type(edit))
    if isinstance(edit, FixAll | SnapAll):
        return name
    words = [name, part_text(edit.person, edit.part)]
    if not isinstance(edit, Add):
        words.append(f"frame {edit.frame}")
    if isinstance(edit, Add | Retime):
        words.append(f"{'to ' if isinstance(edit, Retime) else ''}{span_text(edit.start, edit.stop)}")
    if isinstance(edit, Split):
        words.append(f"at {edit.at}")
    if isinstance(edit, ChooseHold):
        words.append(f"number {edit.rank}")
    if isinstance(edit, TurnHand):
        words.append("by " + " ".join(f"{number:.1f}" for number in edit.turn))
    if isinstance(edit, Pin):
        words.append("to " + " ".join(f"{number:.3f}" for number in edit.position))
    return ", ".join(words)


def _check_clip_has(clip: Clip, person: int, start: int = 0, stop: int = 0) -> None:
    """Raise `ClipError` unless the clip has this person, and frames `start` to the one before `stop`."""
    if person >= len(clip.people):
        last = len(clip.people) - 1
        raise ClipError(f"there is no person {person}; the clip has {f'persons 0 to {last}' if last else 'person 0'}.")
    if stop > clip.frames:
        raise ClipError(f"the clip has frames 0 to {clip.frames - 1}; asked for: {span_text(start, stop)}.")


def _exchanged(clip: Clip, segments: Segments, old: Sequence[Segment], new: Sequence[Segment]) -> Segments:
    """Return the segments with `new` in the place of `old`; raises `ClipError` where two of one part overlap."""
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


def _check_span(start: int, stop: int) -> None:
    if start >= stop:
        raise ArgumentError(f"start is {start} and stop {stop}: no frame is left. Stop is one past the last frame.")


def _fixed(segment: Segment, point: Point | None) -> Segment:
    points = segment.points
    # The mean of equal points differs from them by rounding: fixing again must change nothing.
    mean = points[0] if (points == points[0]).all() else points.mean(axis=0)
    return replace(segment, points=np.tile(mean if point is None else np.array(point), (segment.frames, 1)))


def _snapped(clip: Clip, segment: Segment) -> Segment:
    surface = surface_of(clip.objects[segment.object].geometry)
    return replace(segment, points=surface.closest_points(segment.points))
