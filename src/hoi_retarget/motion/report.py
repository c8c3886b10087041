"""The report of a result: what it was made from and with, how its solves went, its figures, and what is wrong with it.

`Report.from_json` is the only place that doubts what a file says; everybody else reads typed fields.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any

import msgspec

from hoi_retarget.clip.clip import Source
from hoi_retarget.clip.quality_warning import QualityWarning, Severity
from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.human.rotation_jumps import RotationJump
from hoi_retarget.motion.performance import Performance

MISSED_M, MISSED_DEG = 0.005, 3.0
"""A part farther off its pin [m], or turned more [degrees], is told."""
UNREACHED_M = 0.02
"""A link further from its target than this [m] does not reach it."""
ELSEWHERE_M = 0.12
"""Surfaces that touch further than this [m] from the human's place, a palm's length, touch elsewhere."""


class Status(Enum):
    """How a solve ended."""

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
    violation: float
    """Largest excess over a joint range [rad] or a joint step [rad]."""


@dataclass(frozen=True)
class Window:
    """How the frames of one window were solved."""

    start: int
    stop: int
    """One past its last frame."""
    status: Status
    iterations: int
    cost: float
    """Weighted sum of squares of all terms."""
    cost_by_term: Mapping[str, float]
    optimality: Optimality

    @property
    def frames(self) -> int:
        """Number of its frames."""
        return self.stop - self.start


@dataclass(frozen=True)
class UnreachedContact:
    """A stretch of a contact in which the link stayed away from its target."""

    link: str
    """The contact link, as the motion names it."""
    object: str
    first_frame: int
    """First such frame of the motion."""
    last_frame: int
    """Last such frame, included."""
    mean_residual_m: float
    """Mean distance between link and target [m]."""
    max_residual_m: float
    """Largest such distance [m]."""

    def __str__(self) -> str:
        return (
            f"{self.link} on {self.object!r}, frames {self.first_frame} to {self.last_frame}: "
            f"{100 * self.mean_residual_m:.1f} cm off its target on average, "
            f"{100 * self.max_residual_m:.1f} cm at most"
        )


@dataclass(frozen=True)
class PinnedPart:
    """A part that was pinned by hand in one frame, and how far off it came to be."""

    part: str
    frame: int
    off_m: float
    off_deg: float | None
    """None where its rotation was left free."""

    @property
    def missed(self) -> bool:
        """Whether it is off by more than shows."""
        return self.off_m > MISSED_M or (self.off_deg or 0.0) > MISSED_DEG

    def __str__(self) -> str:
        turned = "" if self.off_deg is None else f" and {self.off_deg:.1f} degrees"
        return f"{self.part} in frame {self.frame} is {1e3 * self.off_m:.0f} mm{turned} off its pin"


@dataclass(frozen=True)
class SunkLink:
    """A stretch in which a link is inside an object."""

    link: str
    object: str
    first_frame: int
    last_frame: int
    """Included."""
    max_depth_m: float
    reason: str
    """Why it is there."""

    def __str__(self) -> str:
        return (
            f"{self.link} is up to {1e3 * self.max_depth_m:.0f} mm inside {self.object!r}, "
            f"frames {self.first_frame} to {self.last_frame}: {self.reason}"
        )


@dataclass(frozen=True)
class OrientationFlip:
    """A stretch in which a site points away from its target, the classic wrong optimum of inverse kinematics."""

    site: str
    first_frame: int
    last_frame: int
    """Included."""
    largest_deg: float
    reason: str = ""
    """Why it is there; empty in files of earlier versions."""

    @property
    def frames(self) -> int:
        """Number of its frames."""
        return self.last_frame - self.first_frame + 1

    def __str__(self) -> str:
        return (
            f"{self.site} is turned by up to {self.largest_deg:.0f} degrees against the human's, "
            f"frames {self.first_frame} to {self.last_frame}{self.reason and f': {self.reason}'}"
        )


@dataclass(frozen=True)
class TrunkTurn:
    """A stretch in which the robot's trunk is turned over against the person's."""

    first_frame: int
    last_frame: int
    """Included."""
    largest_deg: float

    def __str__(self) -> str:
        return (
            f"the robot's trunk is turned by up to {self.largest_deg:.0f} degrees against the person's, "
            f"frames {self.first_frame} to {self.last_frame}"
        )


@dataclass(frozen=True)
class InterRobotHandError:
    """How far two robots' hands on one object are from where they should be, seen from each other."""

    people: tuple[int, int]
    links: tuple[str, str]
    object: str
    frames: int
    """In which both touch it."""
    mean_m: float
    """Mean length of the difference between the hands' offset on the object and that of their targets [m]."""
    max_m: float

    def __str__(self) -> str:
        first, second = (f"{link} of person {person}" for link, person in zip(self.links, self.people, strict=True))
        return (
            f"{first} and {second} on {self.object!r}, {self.frames} frames: {100 * self.mean_m:.1f} cm from their "
            f"place relative to each other on average, {100 * self.max_m:.1f} cm at most"
        )


@dataclass(frozen=True)
class InterRobotPenetration:
    """A stretch in which a link of one person's robot is inside a link of another's."""

    people: tuple[int, int]
    links: tuple[str, str]
    first_frame: int
    last_frame: int
    """Included."""
    max_depth_m: float

    def __str__(self) -> str:
        first, second = (f"{link} of person {person}" for link, person in zip(self.links, self.people, strict=True))
        return (
            f"{first} and {second} are up to {1e3 * self.max_depth_m:.0f} mm inside each other, "
            f"frames {self.first_frame} to {self.last_frame}"
        )


@dataclass(frozen=True)
class Report:
    """The report of one robot's motion; what a foreign motion's does not tell is None or empty."""

    clip: str = ""
    """Name of the clip."""
    person: int = 0
    """Index of the clip's person that the robot follows."""
    source: Source = Source()
    robot_file: str = ""
    """Name of the maker's file that an added robot was made from; empty for the robots of this package."""
    robot_sha256: str = ""
    """Digest of that file."""
    root_scale: float | None = None
    """Human size to robot size, as it came out."""
    config: Mapping[str, Any] = field(default_factory=dict)
    """The whole configuration (`retarget.config.Config.as_json`)."""
    command: Mapping[str, Any] = field(default_factory=dict)
    """How the clip was called and read."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Of this package and of those that compute."""
    figures: Mapping[str, float | None] = field(default_factory=dict)
    """By name, in the unit in the name; None where a figure is undefined."""
    object_surfaces: Mapping[str, str] = field(default_factory=dict)
    """What stands for the surface of each object: `solid`, `shell` or `hull`; empty in files of earlier versions."""
    unreached_contacts: tuple[UnreachedContact, ...] | None = None
    sunk_links: tuple[SunkLink, ...] = ()
    pins: tuple[PinnedPart, ...] = ()
    """All parts that were pinned by hand."""
    orientation_flips: tuple[OrientationFlip, ...] | None = None
    trunk_turns: tuple[TrunkTurn, ...] = ()
    rotation_jumps: tuple[RotationJump, ...] = ()
    """Of the recording, which the robot does not follow."""
    inter_robot_hand_errors: tuple[InterRobotHandError, ...] = ()
    inter_robot_penetrations: tuple[InterRobotPenetration, ...] = ()
    cpu_seconds: Mapping[str, float] = field(default_factory=dict)
    """CPU time by stage [s]."""
    performance: Performance | None = None
    """How a simulated robot performed it; None where none has."""

    def as_json(self) -> dict[str, Any]:
        """Return plain JSON values, which `from_json` reads again."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Any) -> "Report":
        """Return the report that plain JSON values hold; keys of later versions are left out.

        Raises:
            ReadError: A value is not of its field's type.
        """
        return _typed(cls, _renamed(values))

    @property
    def is_foreign(self) -> bool:
        """Whether it is of another program's motion: it has a format, but no recording."""
        return bool(self.source.format) and not self.source.path

    @property
    def touches_with_surfaces(self) -> bool:
        """Whether contacts asked for surfaces that touch; results of earlier versions asked for landmarks."""
        return self.config.get("contact") == "surface"

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """What went wrong with trunk, contacts, links in objects, two robots, or the recording."""
        turned = tuple(QualityWarning("trunk_turn", Severity.ERROR, f"{item}.") for item in self.trunk_turns)
        unreached = [("unreached_contact", f"not reached: {item}.") for item in self.unreached_contacts or ()]
        sunk = [("sunk_link", f"{item}.") for item in self.sunk_links]
        missed = [
            ("missed_pin", f"{item}: out of reach, or in the way of something.") for item in self.pins if item.missed
        ]
        limit = ELSEWHERE_M if self.touches_with_surfaces else UNREACHED_M
        misplaced = [
            ("inter_robot_hand_error", f"{item}.") for item in self.inter_robot_hand_errors if item.max_m > limit
        ]
        flipped = [("orientation_flip", f"{item}.") for item in self.orientation_flips or ()]
        jumped = [("rotation_jump", f"{item}.") for item in self.rotation_jumps]
        met = [("inter_robot_penetration", f"{item}.") for item in self.inter_robot_penetrations]
        found = (*unreached, *missed, *sunk, *misplaced, *met, *flipped, *jumped)
        return (*turned, *(QualityWarning(code, Severity.WARNING, text) for code, text in found))


def windows_from_json(values: Any) -> dict[str, tuple[Window, ...]]:
    """Return the windows of every stage by its name, as a report's JSON holds them; raises `ReadError`."""
    if not isinstance(values, Mapping):
        raise ReadError("report is no JSON object.")
    stages = values.get("stages", {name: values[key] for name, key in _STAGES_BEFORE.items() if key in values})
    return _typed(dict[str, tuple[Window, ...]], stages)


# Names in files of earlier versions.
_STAGES_BEFORE = {"ik": "ik_windows", "trajectory": "windows"}
_CONFIG_BEFORE = {"contact": "landmark"}  # All that there was, so that files did not say it.
_KEYS_BEFORE = {"turned_over": "orientation_flips", "hand_to_hand": "inter_robot_hand_errors"}


def _renamed(values: Any) -> Any:
    if not isinstance(values, Mapping):
        return values
    renamed = {_KEYS_BEFORE.get(key, key): value for key, value in values.items()}
    source = renamed.get("source")
    if isinstance(source, Mapping) and "doubts" in source:
        doubts = source["doubts"]
        texts = doubts if isinstance(doubts, list) else [doubts]
        renamed["source"] = {**source, "warnings": [{"code": "recording", "text": text} for text in texts]}
    config = renamed.get("config")
    if isinstance(config, Mapping) and config:
        renamed["config"] = {**_CONFIG_BEFORE, **config}
    return renamed


def _typed(kind: Any, values: Any) -> Any:
    try:
        return msgspec.convert(values, kind)
    except (msgspec.ValidationError, ArgumentError, OverflowError, RecursionError) as error:
        raise ReadError(f"its report is damaged: {error}") from error
