"""What was found in a file: what it claims, what its numbers say, what to do."""

from collections.abc import Generator, Iterable
from dataclasses import dataclass
from typing import Literal, TypeVar

from hoi_retarget.motion.check.change import Change

Level = Literal["ok", "note", "unknown", "contradiction"]
Spoils = Literal["poses", "rate", "velocities", "objects", "nothing"]


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    level: Level
    """Whether the numbers agree, want a remark, cannot tell, or contradict."""
    subject: str
    """What was looked at, such as 'quaternion order'."""
    claim: str
    """What the file says, or what its format demands."""
    numbers: str
    """What the numbers say, with how far apart the possibilities are."""
    advice: str = ""
    """What to do; empty where there is nothing to do."""
    spoils: Spoils = "nothing"
    """What cannot be used as it is."""
    mend: tuple[Change, ...] = ()
    """The advice for programs; empty where other numbers or a decision is needed."""
    follows: str = ""
    """Subject of the finding that this one follows from; empty for one of its own."""


T = TypeVar("T")
Check = Generator[Finding, None, T]
"""Yields what it finds, and returns what the checks after it need."""


def noted(check: Check[T], findings: list[Finding]) -> T:
    """Run a check, add all that it finds, and return its value."""
    while True:
        try:
            findings.append(next(check))
        except StopIteration as end:
            return end.value


def contradictions(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return those in which the numbers contradict the claim."""
    return tuple(finding for finding in findings if finding.level == "contradiction")
