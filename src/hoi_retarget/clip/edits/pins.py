"""Operations on pins: a part is put somewhere in one frame by hand, or let go again."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits.operation import Operation, Point
from hoi_retarget.clip.edits.segments import check_frames, check_person, part_text
from hoi_retarget.clip.pin import PINNED_PARTS, PosePin, pinned_path
from hoi_retarget.errors import ClipError

LARGEST_DISTANCE = 1.0
"""[m] from where the part is in the recording: nobody gets farther within the fraction of a second around a pin."""

Pins = tuple[PosePin, ...]


class PinOperation(Operation):
    """An operation on the pins of a clip."""

    parts: ClassVar[tuple[str, ...]] = PINNED_PARTS
    what_parts_do: ClassVar[str] = "be pinned"

    def on_pins(self, clip: Clip, pins: Pins) -> Pins:
        """Return the pins after the operation.

        Raises:
            ClipError: there is no such person, frame or pin, or the place is out of reach.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class Pin(PinOperation):
    """Put a part somewhere in one frame, in the place of an earlier pin there."""

    part: str
    frame: int
    position: Point
    """In the world of the recording, at captured size [m]."""
    turn: Point | None = None
    """Rotation vector in the world's axes, on top of the recorded part's [degrees]; None leaves the rotation free."""
    person: int = field(default=0, kw_only=True)

    def on_pins(self, clip: Clip, pins: Pins) -> Pins:
        """Return the pins after the operation, by person, part and time."""
        check_person(clip, self.person)
        check_frames(clip, self.frame, self.frame + 1)
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
