"""Findings about a robot for the user, and the user's hints, a small optional TOML file, where findings go wrong."""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import msgspec

from hoi_retarget.errors import ArgumentError, RobotError
from hoi_retarget.robots.spec import Motor

Level = Literal["ok", "warn", "error"]


@dataclass(frozen=True)
class RobotFinding:
    """One fact about a robot, or one fault of its description."""

    level: Level
    subject: str  # Part, joint, site, body or file, such as `left knee`.
    what: str  # The fact or the fault, with its numbers.
    hint: str = ""
    """The line of the hints file, the option or the correction that would change it; empty where none is needed."""


@dataclass(frozen=True)
class Record:
    """The findings and trials of a robot when it was added."""

    findings: tuple[RobotFinding, ...] = ()
    tried: tuple[str, ...] = ()  # Built-in clips.


def hint_of_site(site: str) -> str:
    """Return the line of the hints file that moves a site; that of the forward axis where none moves it alone."""
    side, _, place = site.rpartition("_")
    if "sole" in side or place in {"hip", "knee", "foot", "toe"}:
        return f'{side.split("_")[0] or "left"}.knee = "JOINT"'
    if place in {"shoulder", "elbow", "wrist", "palm"}:
        return f'{side or "left"}.elbow = "JOINT"'
    return 'ahead = "x"  # or -x, y, -y'


class UnsuitableRobotError(RobotError):
    """A description of a robot that cannot be retargeted to; its message says why."""


@dataclass(frozen=True)
class Limb:
    """Joints of one side, by name."""

    knee: str = ""
    elbow: str = ""


@dataclass(frozen=True)
class Hints:
    """Facts of a robot that the user states, in place of findings."""

    ahead: str = ""  # Forward axis in the zero pose: x, -x, y, -y.
    base: Literal["", "stays", "follows"] = ""
    """Motion of the base of a robot of which the upper body alone follows a person."""
    stature: float | None = None  # Human height times root scale [m].
    hand_roll: float = 0.0  # Rotation of the hands about the forearms, thumbs outwards [deg].
    fingers: bool = False  # Whether fingers move; else they are held as in the zero pose.
    lock: tuple[str, ...] = ()  # Joints that are held.
    left: Limb = Limb()
    right: Limb = Limb()
    range: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Ranges by joint, in place of those of the file [rad]."""
    speed: dict[str, float] = field(default_factory=dict)
    """Speed limits by joint [rad/s]; `default` is that of all others that have none."""
    motor: dict[str, Motor] = field(default_factory=dict)
    """Drives by joint: inertia of the rotor [kg m^2], torque [N m], gains [N m/rad, N m s/rad]."""


def read_hints(path: Path | None) -> Hints:
    """Return a file's hints, or none; raises `ArgumentError` for an unreadable file, unknown keys and wrong values."""
    if path is None:
        return Hints()
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        unknown = sorted(set(table) - set(Hints.__dataclass_fields__))
        if unknown:
            raise ValueError(f"unknown: {', '.join(unknown)}; known: {', '.join(Hints.__dataclass_fields__)}")
        hints = msgspec.convert(table, Hints)
    except OSError as error:
        raise ArgumentError(f"--hints {path}: cannot be read ({error.strerror or error}).") from error
    except (ValueError, msgspec.ValidationError) as error:
        raise ArgumentError(f"--hints {path}: {error}.") from error
    if hints.stature is not None and not 0.2 < hints.stature < 3.0:
        raise ArgumentError(f"--hints {path}: stature = {hints.stature}: it is in metres, 0.2 to 3.")
    if not all(0.0 < speed < 1000.0 for speed in hints.speed.values()):
        raise ArgumentError(f"--hints {path}: speeds are positive numbers [rad/s].")
    wrong = [joint for joint, (lower, upper) in hints.range.items() if not -10.0 < lower < upper < 10.0]
    if wrong:
        raise ArgumentError(f"--hints {path}: range.{wrong[0]}: a range is [lower, upper] [rad].")
    numbers = [
        number
        for motor in hints.motor.values()
        for number in (motor.armature, motor.torque, *(motor.gains or ()))
        if number is not None
    ]
    if not all(0.0 < number < 1e5 for number in numbers):
        raise ArgumentError(f"--hints {path}: inertias, torques and gains of motors are positive numbers.")
    return hints
