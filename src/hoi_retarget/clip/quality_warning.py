"""One way to say that something is not right with a recording or a motion: a code, a severity, a text."""

from dataclasses import dataclass
from enum import Enum


class Severity(Enum):
    """How bad it is."""

    WARNING = "warning"
    """Look at it before using it."""
    ERROR = "error"
    """Do not use it."""


@dataclass(frozen=True)
class QualityWarning:
    """One thing that is not right, for a program (the code) and for a person (the text)."""

    code: str
    """Names the kind, such as `unreached_contact`."""
    severity: Severity = Severity.WARNING
    text: str = ""
    """A sentence."""

    def __str__(self) -> str:
        return self.text
