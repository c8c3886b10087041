"""The figures of several clips as a table, JSON and CSV: per clip, their mean, and the worst of them.

Nothing is printed here; the command line does.
"""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Literal

from hoi_retarget.metrics.figures import Figures


@dataclass(frozen=True)
class Column:
    """One figure as it is shown."""

    name: str
    """Name of the field of `Figures`, which ends in the unit of the stored number."""
    title: str
    unit: str
    """Unit in which it is shown."""
    scale: float
    """Shown number over stored number."""
    digits: int
    """Digits after the point."""
    better: Literal["lower", "higher"]
    in_paper: bool = False
    """Whether the paper's table of metrics defines it."""

    @property
    def header(self) -> str:
        """Title and unit."""
        return f"{self.title} [{self.unit}]"

    def text(self, value: float | None) -> str:
        """Return a stored number as it is shown; a dash where there is none."""
        return "-" if value is None else f"{value * self.scale:.{self.digits}f}"


COLUMNS: tuple[Column, ...] = (
    Column("contact_gap_m", "contact gap", "mm", 1e3, 1, "lower", in_paper=True),
    Column("contact_gap_p95_m", "gap p95", "mm", 1e3, 1, "lower"),
    Column("contact_gap_max_m", "gap max", "mm", 1e3, 1, "lower"),
    Column("body_pose_deviation_deg", "pose", "deg", 1.0, 1, "lower", in_paper=True),
    Column("link_velocity_direction_deg", "velocity direction", "deg", 1.0, 1, "lower", in_paper=True),
    Column("relative_hand_rotation_deg", "hand rotation", "deg", 1.0, 1, "lower", in_paper=True),
    Column("body_jerk_mps3", "jerk", "m/s^3", 1.0, 1, "lower", in_paper=True),
    Column("body_jerk_max_mps3", "jerk max", "m/s^3", 1.0, 0, "lower"),
    Column("stance_slide_mps", "foot slide", "cm/s", 1e2, 1, "lower"),
    Column("stance_sole_height_abs_m", "sole height", "mm", 1e3, 1, "lower"),
    Column("stance_float_m", "foot float", "mm", 1e3, 1, "lower"),
    Column("floor_penetration_max_m", "floor penetration", "mm", 1e3, 1, "lower"),
    Column("object_below_floor_m", "object below floor", "mm", 1e3, 1, "lower"),
    Column("object_path_error_m", "object path", "cm", 1e2, 1, "lower", in_paper=True),
    Column("joint_range_margin_rad", "range margin", "rad", 1.0, 3, "higher"),
    Column("joint_speed_margin_radps", "speed margin", "rad/s", 1.0, 2, "higher"),
    Column("compute_s", "time", "s", 1.0, 2, "lower", in_paper=True),
)


@dataclass(frozen=True)
class Score:
    """The figures of one result, with what a table needs besides."""

    name: str
    """Name of the result: the clip's, with the person where there are several."""
    figures: Figures
    frames: int
    compute_s: float | None = None
    """Time of the complete run [s], from the motion's report."""

    def values(self) -> dict[str, float | None]:
        """Return all numbers by column name."""
        return {**asdict(self.figures), "compute_s": self.compute_s}


def mean_values(scores: Sequence[Score]) -> dict[str, float | None]:
    """Return the mean of every column over the results that define it."""
    present = _present(scores)
    return {name: sum(values) / len(values) if values else None for name, values in present.items()}


def worst_values(scores: Sequence[Score]) -> dict[str, float | None]:
    """Return the worst of every column: the largest, or the smallest where higher is better."""
    present = _present(scores)
    worst = {column.name: max if column.better == "lower" else min for column in COLUMNS}
    return {name: worst[name](values) if values else None for name, values in present.items()}


def table_rows(scores: Sequence[Score], columns: Sequence[Column] = COLUMNS) -> tuple[tuple[str, ...], ...]:
    """Return the table as text: a header row, a row per result, and with two and more their mean and worst."""
    header = ("clip", "frames", *(column.header for column in columns))
    rows = [(score.name, str(score.frames), *_texts(score.values(), columns)) for score in scores]
    if len(scores) > 1:
        rows += [(name, "", *_texts(values, columns)) for name, values in _summaries(scores)]
    return (header, *rows)


def to_json(scores: Sequence[Score]) -> str:
    """Return the results as JSON text: how many, mean, worst, and each one; null where a figure is undefined."""
    document = {
        "clips": len(scores),
        **dict(_summaries(scores)),
        "per_clip": [{"name": score.name, "frames": score.frames, **score.values()} for score in scores],
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def to_csv(scores: Sequence[Score]) -> str:
    """Return the results as CSV text, full precision in stored units; empty where a figure is undefined.

    The last two rows, named `mean` and `worst`, are not clips: their number of frames is empty.
    """
    names = [column.name for column in COLUMNS]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["name", "frames", *names])
    for score in scores:
        values = score.values()
        writer.writerow([score.name, score.frames, *(values[name] for name in names)])
    for label, values in _summaries(scores):
        writer.writerow([label, "", *(values[name] for name in names)])
    return text.getvalue()


def _summaries(scores: Sequence[Score]) -> tuple[tuple[str, dict[str, float | None]], ...]:
    return ("mean", mean_values(scores)), ("worst", worst_values(scores))


def _present(scores: Sequence[Score]) -> dict[str, list[float]]:
    tables = [score.values() for score in scores]
    return {column.name: [value for table in tables if (value := table[column.name]) is not None] for column in COLUMNS}


def _texts(values: dict[str, float | None], columns: Sequence[Column]) -> tuple[str, ...]:
    return tuple(column.text(values[column.name]) for column in columns)
