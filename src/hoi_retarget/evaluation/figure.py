"""A figure of merit: its name, how it is shown, and the function that measures it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from hoi_retarget.evaluation.view import Comparison


@dataclass(frozen=True)
class Figure:
    """One figure; `docs/metrics.md` gives every formula."""

    name: str
    """Name, which ends in the unit of the stored number."""
    title: str
    unit: str
    """Unit in which it is shown."""
    scale: float
    """Shown number over stored number."""
    digits: int
    """Digits after the point."""
    better: Literal["lower", "higher"]
    measure: Callable[[Comparison], float | None] | None = None
    """Its value in stored units, None where it is undefined; no function where it is known from elsewhere."""
    in_paper: bool = False
    """Whether the paper's table of metrics defines it."""

    @property
    def header(self) -> str:
        """Title and unit."""
        return f"{self.title} [{self.unit}]"

    def text(self, value: float | None) -> str:
        """Return a stored number as it is shown; a dash where there is none."""
        return "-" if value is None else f"{value * self.scale:.{self.digits}f}"
