"""The human side of a clip: people, objects, contacts, pins, and the options of reading it; no robot anywhere.

World frame: z up, floor at z = 0, metres, seconds. All arrays are read-only copies. A pin is the place of a person's
part in one frame, set by hand.
"""

from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import ALL_PARTS, PARTS
from hoi_retarget.numerics.arrays import check_shape, describe_frames, frozen, runs
from hoi_retarget.objects.object_joint import parents_of
from hoi_retarget.objects.track import ObjectTrack

LOWEST_RATE, HIGHEST_RATE = 1.0, 1000.0  # [frames/s]; other rates are slips of the keyboard, or damage.
PELVIS = "pelvis"
PINNED_PARTS: tuple[str, ...] = (*PARTS, PELVIS)

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class PosePin:
    """A part of a person in one frame."""

    person: int
    part: str
    frame: int
    position: Vector  # In the world of the recording, at captured size [m].
    turn: Vector | None = None
    """Rotation vector in the world's axes, on top of the recorded part's rotation [degrees]; None leaves it free."""

    @property
    def key(self) -> tuple[int, int, int]:
        """The order of pins: by person, part and time."""
        return self.person, PINNED_PARTS.index(self.part), self.frame


def pinned_path(person: Person, part: str) -> Float[np.ndarray, "T 3"]:
    """Return the path of a part that can be pinned [m]."""
    return person.position(part) if part == PELVIS else person.part_position(part)


class Severity(Enum):
    """Severity of a warning."""

    WARNING = "warning"  # Look at it before using it.
    ERROR = "error"  # Do not use it.


@dataclass(frozen=True)
class QualityWarning:
    """A fault of a recording or a motion, for a program (the code) and for a person (the text)."""

    code: str  # Names the kind, such as `unreached_contact`.
    severity: Severity = Severity.WARNING
    text: str = ""  # A sentence.

    def __str__(self) -> str:
        return self.text


TOLD = "What is done: "  # Begins the note of a clip whose recording tells that in words.
MINIMUM_FRAMES = 4  # The jerk penalty is a third difference.


@dataclass(frozen=True, eq=False)
class ContactTrack:
    """When and where one part of one person touches one object."""

    person: int
    object: int
    part: str
    active: Bool[np.ndarray, "T"]
    contact_points: Float[np.ndarray, "T 3"]
    """Contact point in the object's frame at captured size [m]; NaN where inactive."""
    hold: int = 0  # Rank of the hold that a robot's hand takes, the best one first; another one is somebody's choice.
    turn: Vector = (0.0, 0.0, 0.0)
    """Rotation vector about the object's axes, by which somebody turned the person's hand [degrees]."""

    def __post_init__(self) -> None:
        owner = f"contact of {self.part!r}"
        if self.part not in ALL_PARTS:
            raise ClipError(f"{owner}: no such part. Parts: {', '.join(ALL_PARTS)}.")
        object.__setattr__(self, "active", frozen(self.active, bool))
        points = np.where(self.active[:, None], np.asarray(self.contact_points, dtype=float), np.nan)
        object.__setattr__(self, "contact_points", frozen(points))
        check_shape(owner, "contact_points", self.contact_points, (len(self.active), 3))
        missing = self.active & ~np.isfinite(self.contact_points).all(axis=1)
        if missing.any():
            raise ClipError(f"{owner}: active without a point in {describe_frames(np.flatnonzero(missing))}.")

    @property
    def segments(self) -> tuple[tuple[int, int], ...]:
        """Contiguous runs of active frames as (first, one past the last)."""
        return runs(self.active)


@dataclass(frozen=True)
class Augmentation:
    """Changes of a whole recording that make another clip of it; none by default."""

    mirrored: bool = False  # Left for right.
    speed: float = 1.0  # How many times as fast as recorded.

    def __post_init__(self) -> None:
        if not (np.isfinite(self.speed) and self.speed > 0):
            raise ArgumentError(f"The speed is {self.speed}; it must be a positive number.")


@dataclass(frozen=True)
class Source:
    """Origin of a clip."""

    path: str = ""
    sha256: str = ""
    format: str = ""
    licence: str = ""
    notes: tuple[str, ...] = field(default=())  # Findings and decisions of the reader, one sentence each.
    contact_edits: str = ""
    """Text of the contact edits that were applied to the contacts as recorded; empty where none were."""
    augmentation: Augmentation = Augmentation()  # Applied after the edits.
    warnings: tuple[QualityWarning, ...] = ()  # Doubts, and errors, with which a verdict fails.
    files: tuple[str, ...] = ()  # Other files that the clip was read from: companions and meshes; not the body models.


@dataclass(frozen=True, eq=False)
class Clip:
    """A recorded human-object interaction.

    Raises `ClipError` when arrays disagree in length, numbers are not finite, rotations are zero,
    or there are fewer than four frames.
    """

    name: str
    fps: float
    people: tuple[Person, ...]
    objects: tuple[ObjectTrack, ...]
    contacts: tuple[ContactTrack, ...]
    source: Source = Source()
    first_source_frame: int = 0  # How many leading frames of the source were dropped.
    pins: tuple[PosePin, ...] = ()  # Other places for parts than the recorded ones.
    recorded_contacts: tuple[ContactTrack, ...] = ()
    """The contacts as recorded, where `contacts` are edited ones; else none."""

    def __post_init__(self) -> None:
        if not LOWEST_RATE <= self.fps <= HIGHEST_RATE:
            raise ClipError(
                f"clip {self.name!r}: the rate is {self.fps} frames a second; it must be {LOWEST_RATE:g} to "
                f"{HIGHEST_RATE:g}."
            )
        if not self.people:
            raise ClipError(f"clip {self.name!r}: there is no person in it.")
        lengths = {f"person {person.name!r}": len(person.joint_positions) for person in self.people}
        lengths |= {f"object {track.name!r}": len(track.positions) for track in self.objects}
        lengths |= {
            f"contact of {track.part!r}": len(track.active) for track in (*self.contacts, *self.recorded_contacts)
        }
        if len(set(lengths.values())) > 1:
            listing = ", ".join(f"{owner}: {length}" for owner, length in lengths.items())
            raise ClipError(f"clip {self.name!r}: tracks differ in their number of frames ({listing}).")
        parents_of(self.objects)
        if self.frames < MINIMUM_FRAMES:
            raise ClipError(f"clip {self.name!r}: {self.frames} usable frame(s); at least {MINIMUM_FRAMES} are needed.")
        for track in self.contacts:
            if not (0 <= track.person < len(self.people) and 0 <= track.object < len(self.objects)):
                raise ClipError(f"clip {self.name!r}: a contact of {track.part!r} names an absent person or object.")
        for pin in self.pins:
            here = pin.part in PINNED_PARTS and 0 <= pin.person < len(self.people) and 0 <= pin.frame < self.frames
            if not here:
                raise ClipError(f"clip {self.name!r}: a pin of {pin.part!r} names an absent person, part or frame.")

    def __repr__(self) -> str:
        shown = (one.name for one in (*self.people, *self.objects))
        return f"<Clip {self.name}: {', '.join((f'{self.frames} frames at {self.fps:g} a second', *shown))}>"

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.people[0].joint_positions)

    def with_note(self, note: str) -> "Clip":
        """Return the clip with one more sentence in its source's notes."""
        return replace(self, source=replace(self.source, notes=(*self.source.notes, note)))

    def with_warnings(self, code: str, texts: tuple[str, ...], severity: Severity = Severity.WARNING) -> "Clip":
        """Return the clip with more warnings of one kind, a sentence each."""
        new = tuple(QualityWarning(code, severity, text) for text in texts)
        return replace(self, source=replace(self.source, warnings=(*self.source.warnings, *new))) if new else self
