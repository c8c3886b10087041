"""The figures of several clips as a table, JSON and CSV: per clip, their mean, and the worst of them."""

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

from hoi_retarget.evaluation.comparison import Figure
from hoi_retarget.evaluation.figures import FIGURES
from hoi_retarget.evaluation.physics_figures import PERFORMED

if TYPE_CHECKING:
    from hoi_retarget.evaluation.thresholds import Verdict

COMPUTE_TIME = Figure("compute_s", "time", "s", "CPU time of the complete run", digits=2)
COLUMNS: tuple[Figure, ...] = (*FIGURES, *PERFORMED, COMPUTE_TIME)
HEADLINE = (
    "touch_share",
    "palm_touch_share",
    "finger_touch_share",
    "penetration_max_m",
    "hand_slip_mps",
    "person_slip_mps",
    "trunk_deviation_deg",
    "body_jerk_mps3",
    "stance_slide_mps",
    "compute_s",
)
"""Names of the figures that are shown first; those that no column has are left out."""
PAPER = (
    "contact_gap_m",
    "contact_gap_p95_m",
    "contact_gap_max_m",
    "body_pose_deviation_deg",
    "link_velocity_direction_deg",
    "relative_hand_rotation_deg",
)
"""Names of the paper's figures, which are shown first for contacts at landmarks."""


@dataclass(frozen=True)
class Score:
    """The figures of one result, with its facts for a table."""

    name: str  # Name of the result: the clip's, with the person where there are several.
    figures: Mapping[str, float | None]
    frames: int
    compute_s: float | None = None  # Time of the complete run [s], from the motion's report.
    file: str = ""  # The result's file, which distinguishes results of one name.
    robot: str = ""
    root_scale: float | None = None
    object_scale: tuple[float, ...] = ()  # One for each object.
    object_surfaces: tuple[str, ...] = ()
    """Kind of each one's surface, where the report has it: `solid`, `shell` or `hull`."""
    verdict: "Verdict | None" = None  # None for other programs' motions.
    title: str = ""  # Its name in tables, where that is another one: a robot's among those of one clip.
    at_landmarks: bool = False  # Whether contacts are those of landmarks, not of surfaces.

    @property
    def lights(self) -> dict[str, str]:
        """The levels of the verdict's two lights by their names, a dash where there are none."""
        if self.verdict is None:
            return {"motion": "-", "physics": "-"}
        return {"motion": str(self.verdict.motion), "physics": str(self.verdict.physics)}

    def facts(self) -> dict[str, Any]:
        """Return the facts that distinguish this result, by name."""
        return {
            "name": self.name,
            "file": self.file,
            "robot": self.robot,
            "root_scale": self.root_scale,
            "object_scale": list(self.object_scale),
            "object_surfaces": list(self.object_surfaces),
            "frames": self.frames,
            **self.lights,
        }

    def values(self) -> dict[str, float | None]:
        """Return all numbers by column name, whose end is the unit."""
        return {**self.figures, "compute_s": self.compute_s}


def mean_values(scores: Sequence[Score]) -> dict[str, float | None]:
    """Return the mean of every column, in its unit, over the results that define it."""
    present = _present(scores)
    return {name: sum(values) / len(values) if values else None for name, values in present.items()}


def worst_values(scores: Sequence[Score]) -> dict[str, float | None]:
    """Return the worst of every column, in its unit: the largest, or the smallest where higher is better."""
    present = _present(scores)
    worst = {column.name: max if column.better == "lower" else min for column in COLUMNS}
    return {name: worst[name](values) if values else None for name, values in present.items()}


def grouped_columns(scores: Sequence[Score], *, every: bool = True) -> dict[str, tuple[Figure, ...]]:
    """Return the columns that results fill by tables' headings, in order.

    Without `every`, those are `HEADLINE`, and `PAPER` for contacts at landmarks.
    """
    present, by_name = _present(scores), {column.name: column for column in COLUMNS}

    def filled(names: Iterable[str]) -> tuple[Figure, ...]:
        return tuple(by_name[name] for name in names if present.get(name))

    at_landmarks = all(score.at_landmarks for score in scores)
    first, paper = {"figure": filled(HEADLINE)}, {"paper's figures": filled(PAPER)}
    further = {"further figures": filled(name for name in by_name if name not in (*HEADLINE, *PAPER))}
    groups = {**(paper if at_landmarks else {}), **first, **(further if every else {}), **(paper if every else {})}
    return {heading: columns for heading, columns in groups.items() if columns}


def table_rows(scores: Sequence[Score], columns: Sequence[Figure] = COLUMNS) -> tuple[tuple[str, ...], ...]:
    """Return the table as text: a header row, a row per result, and with two and more their mean and worst.

    Results are named by their files where several bear the same name.
    """
    header = ("clip", "robot", "object scale", "frames", "motion", "physics", *(column.header for column in columns))
    several = len({score.title or score.name for score in scores}) < len(scores)
    rows = [
        (
            score.title or (score.file if several and score.file else score.name),
            score.robot or "-",
            scales_text(score.object_scale, score.object_surfaces),
            str(score.frames),
            *score.lights.values(),
            *_texts(score.values(), columns),
        )
        for score in scores
    ]
    if len(scores) > 1:
        rows += [(name, *("",) * 5, *_texts(values, columns)) for name, values in _summaries(scores)]
    return (header, *rows)


def scales_text(scales: Iterable[float], surfaces: Iterable[str] = ()) -> str:
    """Return the scales of objects as text, each with the kind of its surface unless that is the object's own."""
    items = zip_longest((f"{scale:.3f}" for scale in scales), (surface.replace("solid", "") for surface in surfaces))
    return " ".join(" ".join(filter(None, item)) for item in items) or "-"


def to_json(scores: Sequence[Score]) -> str:
    """Return the results as JSON text: their number, mean, worst, and each one; null where a figure is undefined."""
    document = {
        "clips": len(scores),
        **dict(_summaries(scores)),
        "per_clip": [{**score.facts(), **score.values()} for score in scores],
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def to_csv(scores: Sequence[Score]) -> str:
    """Return the results as CSV text, full precision in stored units; empty where a figure is undefined.

    Several objects' scales stand in one cell. The last two rows, named `mean` and `worst`, are not clips:
    their file and their number of frames are empty.
    """
    names = [column.name for column in COLUMNS]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    facts = ["name", "file", "robot", "root_scale", "object_scale", "object_surfaces", "frames", "motion", "physics"]
    writer.writerow([*facts, *names])
    for score in scores:
        texts = {name: " ".join(map(str, getattr(score, name))) for name in ("object_scale", "object_surfaces")}
        values = {**score.facts(), **score.values(), **texts}
        writer.writerow([values.get(name) for name in (*facts, *names)])
    for label, values in _summaries(scores):
        writer.writerow([label, *[""] * (len(facts) - 1), *(values.get(name) for name in names)])
    return text.getvalue()


def _summaries(scores: Sequence[Score]) -> tuple[tuple[str, dict[str, float | None]], ...]:
    return ("mean", mean_values(scores)), ("worst", worst_values(scores))


def _present(scores: Sequence[Score]) -> dict[str, list[float]]:
    tables = [score.values() for score in scores]
    return {
        column.name: [value for table in tables if (value := table.get(column.name)) is not None] for column in COLUMNS
    }


def _texts(values: dict[str, float | None], columns: Sequence[Figure]) -> tuple[str, ...]:
    return tuple(column.text(values.get(column.name)) for column in columns)
