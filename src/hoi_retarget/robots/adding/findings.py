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


class Refused(RobotError):
    """A description that no robot for retargeting can be made of; its message says why."""
