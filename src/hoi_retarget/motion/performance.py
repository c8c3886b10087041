"""A simulated robot's performance of a motion, to the end, a fall or the loss of its object, with its certificate."""

from dataclasses import dataclass

MAX_OBJECT_DISTANCE_M, MAX_BASE_DISTANCE_M = 0.1, 0.15
"""Bounds of the distance of objects and base from the performed motion in a replay that keeps to it."""
STRICT_SHARE = 0.95  # Of the touched time, in which an object that is held strictly is near its path.


@dataclass(frozen=True)
class Replay:
    """A performed motion simulated again, with its feedback, in other physics."""

    name: str  # The change, such as `mass +20 %`.
    seconds: float  # How long the robot stood [s].
    fell: bool
    object_m: float | None  # Largest distance of an object from the performed motion [m]; None without objects.
    base_m: float  # The same of the robot's base.

    @property
    def kept(self) -> bool:
        """Whether it stood, and stayed near the performed motion."""
        return not self.fell and (self.object_m or 0.0) <= MAX_OBJECT_DISTANCE_M and self.base_m <= MAX_BASE_DISTANCE_M

    def __str__(self) -> str:
        if self.fell:
            return f"{self.name} falls at {self.seconds:.1f} s"
        apart = [f"base {100 * self.base_m:.0f} cm"]
        if self.object_m is not None:
            apart.append(f"object {100 * self.object_m:.0f} cm")
        return f"{self.name} stands ({', '.join(apart)} off at most)"


@dataclass(frozen=True)
class Certificate:
    """The outcome of simulating a wholly performed motion again."""

    repeats: bool  # Whether its targets alone, without feedback, give it to the bit.
    replays: tuple[Replay, ...]

    @property
    def kept(self) -> int:
        """Number of replays that keep to it."""
        return sum(replay.kept for replay in self.replays)

    @property
    def passed(self) -> bool:
        """Whether it repeats, and all replays keep to it."""
        return self.repeats and self.kept == len(self.replays)

    def __str__(self) -> str:
        lost = [str(replay) for replay in self.replays if not replay.kept]
        parts = [f"{self.kept} of {len(self.replays)} replays keep to the motion"]
        parts += [] if self.repeats else ["its targets alone do not repeat it"]
        return "; ".join([*parts, *lost])


@dataclass(frozen=True)
class Performance:
    """The performance of a motion: its length, and the fall or the loss of an object if there was one."""

    seconds: float  # How long the robot stood, with its object at hand [s].
    fell: bool
    cause: str = ""  # Why it fell or lost its object, as far as known.
    certificate: Certificate | None = None
    lost: bool = False
    kept_share: float | None = None
    """Share of the touched time in which objects are near their paths; None where none is touched."""

    @property
    def whole(self) -> bool:
        """Whether the robot stood to the end and lost no object."""
        return not self.fell and not self.lost

    @property
    def outcome(self) -> str:
        """In words: held, held strictly, stood (where nothing is touched), lost or fell, and when."""
        if not self.whole:
            return f"{'fell' if self.fell else 'lost'} at {self.seconds:.1f} s"
        if self.kept_share is None:
            return "stood"
        return "held strictly" if self.kept_share >= STRICT_SHARE else "held"

    @property
    def robustness(self) -> str:
        """The certificate in words."""
        if self.certificate is not None:
            return str(self.certificate)
        if self.whole:
            return "none"
        return "none, as the robot falls" if self.fell else "none, as the object is lost"
