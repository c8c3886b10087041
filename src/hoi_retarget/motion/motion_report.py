"""The report of a result: its source and settings, the outcome of its solves, its figures, and its faults.

`Report.from_json` alone checks the values of files; everybody else reads typed fields.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any

import msgspec

from hoi_retarget.clip.clip import QualityWarning, Severity, Source
from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.human.rotation_jumps import RotationJump
from hoi_retarget.motion.performance import Performance

MISSED_M, MISSED_DEG = 0.005, 3.0  # A part farther off its pin [m], or turned more [degrees], is a warning.
UNREACHED_M = 0.02  # A link further from its target than this [m] does not reach it.
ELSEWHERE_M = 0.12
"""Surfaces that touch further than this [m] from the human's place, a palm's length, touch elsewhere."""


class Status(Enum):
    """The end of a solve."""

    SOLVED = "SOLVED"
    STALLED = "STALLED"
    MAX_ITERATIONS = "MAX_ITERATIONS"
    FAILED = "FAILED"

    @property
    def message(self) -> str:
        """The same in words."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.SOLVED: "solved to tolerance",
    Status.STALLED: "no step decreased the merit function; the best trajectory so far is returned",
    Status.MAX_ITERATIONS: "stopped at the iteration limit",
    Status.FAILED: "the problem has no finite cost at the start",
}


@dataclass(frozen=True)
class Optimality:
    """Residuals of the first-order conditions; all are zero at an optimum.

    `stationarity` is the decrease of the cost, relative to it, that the quadratic model of the Lagrangian
    promises for a free step; `complementarity` is relative to the cost too.
    """

    stationarity: float
    complementarity: float
    violation: float  # Largest excess over a joint range [rad] or a joint step [rad].


@dataclass(frozen=True)
class Window:
    """The outcome of solving the frames of one window, by its last pass."""

    start: int
    stop: int  # One past its last frame.
    status: Status
    iterations: int
    cost: float  # Weighted sum of squares of all terms.
    cost_by_term: Mapping[str, float]
    optimality: Optimality

    @property
    def frames(self) -> int:
        """Number of its frames."""
        return self.stop - self.start


@dataclass(frozen=True)
class EventKind:
    """One kind of event: its text, and its keys in the report's JSON."""

    text: str  # Of an event, before its frames.
    keys: Mapping[str, str]  # Fields of `Event` by their keys in JSON, beside `first_frame` and `last_frame`.
    severity: Severity = Severity.WARNING


EVENTS: Mapping[str, EventKind] = {
    "trunk_turn": EventKind(
        "the robot's trunk is turned by up to {0.value:.0f} degrees against the person's",
        {"largest_deg": "value"},
        Severity.ERROR,
    ),
    "unreached_contact": EventKind(
        "{0.subject} on {0.object!r}",
        {"link": "subject", "object": "object", "mean_residual_m": "mean", "max_residual_m": "value"},
    ),
    "thin_air_contact": EventKind(
        "contact asked in thin air: {0.subject} is to touch {0.object!r} up to {mm:.0f} mm off its surface",
        {"part": "subject", "object": "object", "max_distance_m": "value"},
    ),
    "sunk_link": EventKind(
        "{0.subject} is up to {mm:.0f} mm inside {0.object!r}",
        {"link": "subject", "object": "object", "max_depth_m": "value", "reason": "reason"},
    ),
    "inter_robot_penetration": EventKind(
        "{0.links[0]} of person {0.people[0]} and {0.links[1]} of person {0.people[1]} are up to {mm:.0f} mm inside "
        "each other",
        {"people": "people", "links": "links", "max_depth_m": "value"},
    ),
    "orientation_flip": EventKind(
        "{0.subject} is turned by up to {0.value:.0f} degrees against the human's",
        {"site": "subject", "largest_deg": "value", "reason": "reason"},
    ),
}
"""Kinds of events by the codes of their warnings, in the order of lists; `Report` has those of `code` as `<code>s`."""


@dataclass(frozen=True)
class Event:
    """A fault of a motion over a stretch of its frames.

    The kinds: the trunk turned over against the person's, a contact out of reach of its link, an edited contact off
    the object's surface, a link inside an object
    or inside another person's robot, and a site turned away from its target (the classic wrong optimum of inverse
    kinematics).
    """

    kind: str  # A key of `EVENTS`.
    first_frame: int
    last_frame: int  # Included.
    value: float  # The largest distance or depth [m] or angle [degrees].
    subject: str = ""  # The link, site or human part.
    object: str = ""
    mean: float = 0.0  # Mean distance of an unreached contact [m].
    reason: str = ""  # Its cause, where known.
    people: tuple[int, int] = (0, 0)
    links: tuple[str, str] = ("", "")  # Links of the robots of two people.

    @property
    def frames(self) -> int:
        """Number of its frames."""
        return self.last_frame - self.first_frame + 1

    @property
    def warning(self) -> QualityWarning:
        """The same for a report's reader."""
        prefix = "not reached: " if self.kind == "unreached_contact" else ""
        return QualityWarning(self.kind, EVENTS[self.kind].severity, f"{prefix}{self}.")

    def as_json(self) -> dict[str, Any]:
        """Return its keys in a report."""
        keys = EVENTS[self.kind].keys.items()
        values = {key: getattr(self, name) for key, name in keys}
        return {"first_frame": self.first_frame, "last_frame": self.last_frame, **values}

    def __str__(self) -> str:
        text = EVENTS[self.kind].text.format(self, mm=1e3 * self.value)
        reason = self.reason
        if self.kind == "unreached_contact":
            reason = f"{100 * self.mean:.1f} cm off its target on average, {100 * self.value:.1f} cm at most"
        return f"{text}, frames {self.first_frame} to {self.last_frame}{reason and f': {reason}'}"


@dataclass(frozen=True)
class PinnedPart:
    """A part that was pinned by hand in one frame, and its distance from the pin."""

    part: str
    frame: int
    off_m: float
    off_deg: float | None  # None where its rotation was left free.

    @property
    def missed(self) -> bool:
        """Whether it is visibly off."""
        return self.off_m > MISSED_M or (self.off_deg or 0.0) > MISSED_DEG

    def __str__(self) -> str:
        turned = "" if self.off_deg is None else f" and {self.off_deg:.1f} degrees"
        return f"{self.part} in frame {self.frame} is {1e3 * self.off_m:.0f} mm{turned} off its pin"


@dataclass(frozen=True)
class InterRobotHandError:
    """How two robots' hands on one object wander from each other against the people's."""

    people: tuple[int, int]
    links: tuple[str, str]
    object: str
    frames: int  # In which both touch it.
    mean_m: float
    """Mean change, within a contact of both, of the difference of the hands' offsets from their targets [m]."""
    max_m: float

    def __str__(self) -> str:
        first, second = (f"{link} of person {person}" for link, person in zip(self.links, self.people, strict=True))
        return (
            f"{first} and {second} on {self.object!r}, {self.frames} frames: they wander {100 * self.mean_m:.1f} cm "
            f"from each other on average, {100 * self.max_m:.1f} cm at most"
        )


@dataclass(frozen=True)
class HoldNote:
    """One hold of a hand on an object, against the person's hand."""

    part: str
    object: str
    first_frame: int
    last_frame: int  # Included.
    moved_m: float
    turned_deg: float
    touching_m2: float  # Area of palmar skin on the surface.
    score: float | None = None
    """Of the choice: touch less what distance from the person, depth and reach cost [cm2]; None in older results."""
    rank: int = 0
    ranks: int = 1  # Of the hold among those that differ, the best one first.
    kept: bool | None = None
    """Whether two free hands keep the object in simulation, all holds together; None where this was not tried."""

    def __str__(self) -> str:
        # What a simulation chose is not by score.
        choice = (
            ""
            if self.score is None or self.kept is not None
            else f" (hold {self.rank + 1} of {self.ranks}, score {self.score:.1f})"
        )
        free = "" if self.kept is None else f"; two free hands {'keep' if self.kept else 'lose'} the object"
        return (
            f"{self.part} on {self.object!r}, frames {self.first_frame} to {self.last_frame}: "
            f"{100 * self.moved_m:.1f} cm and {self.turned_deg:.0f} degrees from the person's, "
            f"{1e4 * self.touching_m2:.1f} cm2 touch{choice}{free}"
        )


@dataclass(frozen=True)
class ObjectShift:
    """An object's path that gave way to arms that could not reach its holds."""

    object: str
    first_frame: int
    last_frame: int  # Included.
    moved_m: float  # At most,
    turned_deg: float  # likewise.

    def __str__(self) -> str:
        return (
            f"{self.object!r} gives way in frames {self.first_frame} to {self.last_frame}, by at most "
            f"{100 * self.moved_m:.1f} cm and {self.turned_deg:.1f} degrees: arms cannot reach its holds"
        )


_WARNINGS = (
    *("trunk_turn", "unreached_contact", "thin_air_contact", "missed_pin", "sunk_link"),
    *("inter_robot_hand_error", "inter_robot_penetration", "orientation_flip", "rotation_jump"),
)
"""Codes of a report's warnings, in the order in which they are listed."""


@dataclass(frozen=True)
class Report:
    """The report of one robot's motion; unknown fields, as of other programs' motions, are None or empty."""

    clip: str = ""  # Name of the clip.
    person: int = 0  # Index of the clip's person that the robot follows.
    source: Source = Source()
    robot_file: str = ""  # Name of the source file of an added robot; empty for the robots of this package.
    robot_sha256: str = ""  # Digest of that file.
    root_scale: float | None = None  # Human size to robot size, as it came out.
    config: Mapping[str, Any] = field(default_factory=dict)
    """The whole configuration (`retarget.config.Config.as_json`)."""
    command: Mapping[str, Any] = field(default_factory=dict)  # How the clip was called and read.
    versions: Mapping[str, str] = field(default_factory=dict)  # Of this package and of those that compute.
    figures: Mapping[str, float | None] = field(default_factory=dict)
    """By name, in the unit in the name; None where a figure is undefined."""
    object_surfaces: Mapping[str, str] = field(default_factory=dict)
    """The kind of each object's surface: `solid`, `shell` or `hull`."""
    unreached_contacts: tuple[Event, ...] | None = None
    thin_air_contacts: tuple[Event, ...] | None = None
    sunk_links: tuple[Event, ...] = ()
    pins: tuple[PinnedPart, ...] = ()  # All parts that were pinned by hand.
    holds: tuple[HoldNote, ...] = ()  # Of hands, in surface contact.
    object_shift: ObjectShift | None = None  # None where its path is that of the recording.
    orientation_flips: tuple[Event, ...] | None = None
    trunk_turns: tuple[Event, ...] = ()
    rotation_jumps: tuple[RotationJump, ...] = ()  # Of the recording, which the robot does not follow.
    inter_robot_hand_errors: tuple[InterRobotHandError, ...] = ()
    inter_robot_penetrations: tuple[Event, ...] = ()
    cpu_seconds: Mapping[str, float] = field(default_factory=dict)  # CPU time by stage [s].
    performance: Performance | None = None  # How a simulated robot performed it; None where none has.

    def as_json(self) -> dict[str, Any]:
        """Return plain JSON values, which `from_json` reads again."""
        events = {f"{kind}s": getattr(self, f"{kind}s") for kind in EVENTS}
        return asdict(self) | {name: items and [item.as_json() for item in items] for name, items in events.items()}

    @classmethod
    def from_json(cls, values: Any) -> "Report":
        """Return the report that plain JSON values hold, without keys of later versions; raises `ReadError`."""
        return _typed(cls, _with_events(values))

    @property
    def is_foreign(self) -> bool:
        """Whether it is of another program's motion: it has a format, but no recording."""
        return bool(self.source.format) and not self.source.path

    @property
    def touches_with_surfaces(self) -> bool:
        """Whether contacts are between surfaces, not landmarks."""
        return self.config.get("contact") == "surface"

    @property
    def events(self) -> tuple[Event, ...]:
        """All events, kind by kind in the order of `EVENTS`."""
        return tuple(event for kind in EVENTS for event in getattr(self, f"{kind}s") or ())

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """Faults of trunk, contacts, links in objects, two robots, and the recording."""
        errors = self.inter_robot_hand_errors
        texts = [("missed_pin", f"{pin}: out of reach, or in the way of something.") for pin in self.pins if pin.missed]
        texts += [("inter_robot_hand_error", f"{item}.") for item in errors if item.max_m > UNREACHED_M]
        texts += [("rotation_jump", f"{item}.") for item in self.rotation_jumps]
        others = (QualityWarning(code, Severity.WARNING, text) for code, text in texts)
        found = (*(event.warning for event in self.events), *others)
        return tuple(sorted(found, key=lambda warning: _WARNINGS.index(warning.code)))


def windows_from_json(values: Any) -> dict[str, tuple[Window, ...]]:
    """Return the windows of every stage by its name, as a report's JSON holds them; raises `ReadError`."""
    if not isinstance(values, Mapping):
        raise ReadError("report is no JSON object.")
    return _typed(dict[str, tuple[Window, ...]], values.get("stages", {}))


def _with_events(values: Any) -> Any:
    """Return a report's JSON with events by the fields of `Event`."""
    if not isinstance(values, Mapping):
        return values
    renamed = dict(values)
    for kind in EVENTS:
        items = renamed.get(f"{kind}s")
        if isinstance(items, list):
            renamed[f"{kind}s"] = [_event_fields(kind, item) for item in items]
    return renamed


def _event_fields(kind: str, item: Any) -> Any:
    """Return an event of a report's JSON by the fields of `Event`; raises `ReadError` where a key is missing."""
    if not isinstance(item, Mapping):
        return item
    fields = {"first_frame": "first_frame", "last_frame": "last_frame", **EVENTS[kind].keys}
    missing = sorted(fields.keys() - {*item, "reason"})
    if missing:
        raise ReadError(f"its report is damaged: an entry of {kind}s lacks {', '.join(missing)}")
    return {"kind": kind, **{name: item[key] for key, name in fields.items() if key in item}}


def _typed(kind: Any, values: Any) -> Any:
    try:
        return msgspec.convert(values, kind)
    except (msgspec.ValidationError, ArgumentError, OverflowError, RecursionError) as error:
        raise ReadError(f"its report is damaged: {error}") from error
