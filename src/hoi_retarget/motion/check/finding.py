"""What was found in a file: what it claims, what its numbers say, what to do."""

from collections.abc import Generator, Iterable
from dataclasses import dataclass, replace
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

    def __str__(self) -> str:
        return f"{self.subject}: {self.numbers}"


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


_CAUSES = (("linear velocities of ", "angular velocities of "), ("jump", "repeated frames"), ("joint speed", "jump"))
"""Beginnings of subjects: the first follows from the second where the rest is the same and both contradict a claim.

Velocities of links are made of the root's turning, a movement goes on far off after a stop, and a jump is fast.
"""


def with_causes(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings that tell from which others they follow."""
    found = tuple(findings)
    wrong = {finding.subject for finding in contradictions(found)}

    def cause(finding: Finding) -> str:
        possible = (
            cause + finding.subject.removeprefix(effect)
            for effect, cause in _CAUSES
            if finding.subject.startswith(effect)
        )
        return next((subject for subject in possible if subject in wrong), "")

    return tuple(
        replace(item, follows=cause(item)) if item.level in {"contradiction", "note"} else item for item in found
    )


def contradictions(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return those in which the numbers contradict the claim."""
    return tuple(finding for finding in findings if finding.level == "contradiction")
