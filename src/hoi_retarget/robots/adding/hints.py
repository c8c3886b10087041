"""What a user says of a robot where finding it would go wrong: a small TOML file, all of it optional."""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import msgspec

from hoi_retarget.errors import ArgumentError


@dataclass(frozen=True)
class Limb:
    """Joints of one side, by name."""

    knee: str = ""
    elbow: str = ""


@dataclass(frozen=True)
class Hints:
    """What is known of a robot."""

    ahead: str = ""
    """The axis of the zero pose that it looks along: x, -x, y, -y."""
    base: Literal["", "stays", "follows"] = ""
    """Of a robot whose upper body alone follows a person: what its base does."""
    stature: float | None = None
    """Human height times root scale [m]."""
    hand_roll: float = 0.0
    """By which hands are turned about the forearm, thumbs outwards [deg]."""
    lock: tuple[str, ...] = ()
    """Joints that are held."""
    left: Limb = Limb()
    right: Limb = Limb()
    range: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Ranges by joint, in place of those of the file [rad]."""
    speed: dict[str, float] = field(default_factory=dict)
    """Speed limits by joint [rad/s]; `default` is that of all others that have none."""


def read_hints(path: Path | None) -> Hints:
    """Return the hints in a file, or none; raises `ArgumentError` where it cannot be read or says anything else."""
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
    return hints
