"""What was found about a description, for the user: what it was taken for, and what would change that."""

from dataclasses import dataclass
from typing import Literal

from hoi_retarget.errors import RobotError

Level = Literal["ok", "warn", "error"]


@dataclass(frozen=True)
class Finding:
    """One line of the table."""

    level: Level
    subject: str
    """Such as `left knee`."""
    what: str
    """What was found, with its numbers."""
    hint: str = ""
    """The line of the hints file, or the option, that would change it."""


@dataclass(frozen=True)
class Record:
    """How a robot was added, to be told again."""

    findings: tuple[Finding, ...] = ()
    tried: tuple[str, ...] = ()
    """Built-in clips."""


def hint_of_site(site: str) -> str:
    """Return the line of the hints file that moves a site, as far as one does."""
    side, _, place = site.rpartition("_")
    if "sole" in side or place in {"hip", "knee", "foot", "toe"}:
        return f'{side.split("_")[0] or "left"}.knee = "JOINT"'
    if place in {"shoulder", "elbow", "wrist", "palm"}:
        return f'{side or "left"}.elbow = "JOINT"'
    return 'ahead = "x"  # or -x, y, -y'


class Refused(RobotError):
    """A description that no robot for retargeting can be made of; its message says why."""
