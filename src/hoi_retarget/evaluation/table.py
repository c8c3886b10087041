"""The figures of several clips as a table, JSON and CSV: per clip, their mean, and the worst of them.

Nothing is printed here; the command line does.
"""

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.evaluation.figures import FIGURES
from hoi_retarget.evaluation.performed import PERFORMED

COMPUTE_TIME = Figure("compute_s", "time", "s", 1.0, 2, "lower", in_paper=True)
COLUMNS: tuple[Figure, ...] = (*FIGURES, *PERFORMED, COMPUTE_TIME)


@dataclass(frozen=True)
class Score:
    """The figures of one result, with what a table needs besides."""

    name: str
    """Name of the result: the clip's, with the person where there are several."""
    figures: Mapping[str, float | None]
    frames: int
    compute_s: float | None = None
    """Time of the complete run [s], from the motion's report."""
    file: str = ""
    """The result's file; tells results of one name apart."""
    robot: str = ""
    root_scale: float | None = None
    object_scale: tuple[float, ...] = ()
    """One for each object."""
    object_surfaces: tuple[str, ...] = ()
    """What stands for the surface of each, where the report says it: `solid`, `shell` or `hull`."""

    def facts(self) -> dict[str, Any]:
        """Return what tells this result from others, by name."""
        return {
            **{"name": self.name, "file": self.file, "robot": self.robot, "root_scale": self.root_scale},
            "object_scale": list(self.object_scale),
            "object_surfaces": list(self.object_surfaces),
            "frames": self.frames,
        }

    def values(self) -> dict[str, float | None]:
        """Return all numbers by column name."""
        return {**self.figures, "compute_s": self.compute_s}


def mean_values(scores: Sequence[Score]) -> dict[str, float | None]:
    """Return the mean of every column over the results that define it."""
    present = _present(scores)
    return {name: sum(values) / len(values) if values else None for name, values in present.items()}


def worst_values(scores: Sequence[Score]) -> dict[str, float | None]:
    """Return the worst of every column: the largest, or the smallest where higher is better."""
    present = _present(scores)
    worst = {column.name: max if column.better == "lower" else min for column in COLUMNS}
    return {name: worst[name](values) if values else None for name, values in present.items()}


def shown_columns(scores: Sequence[Score]) -> tuple[Figure, ...]:
    """Return the columns that results fill: those of performed motions only where there are such."""
    present = _present(scores)
    return tuple(column for column in COLUMNS if column not in PERFORMED or present[column.name])


def table_rows(scores: Sequence[Score], columns: Sequence[Figure] = COLUMNS) -> tuple[tuple[str, ...], ...]:
    """Return the table as text: a header row, a row per result, and with two and more their mean and worst.

    Results are named by their files where several bear the same name.
    """
    header = ("clip", "robot", "object scale", "frames", *(column.header for column in columns))
    several = len({score.name for score in scores}) < len(scores)
    rows = [
        (
            *(
                score.file if several and score.file else score.name,
                score.robot or "-",
                scales_text(score.object_scale, score.object_surfaces),
            ),
            *(str(score.frames), *_texts(score.values(), columns)),
        )
        for score in scores
    ]
    if len(scores) > 1:
        rows += [(name, "", "", "", *_texts(values, columns)) for name, values in _summaries(scores)]
    return (header, *rows)


def scales_text(scales: Iterable[float], surfaces: Iterable[str] = ()) -> str:
    """Return the scales of objects as they are shown, with what stands for a surface that is not the object's own."""
    told = zip_longest((f"{scale:.3f}" for scale in scales), (surface.replace("solid", "") for surface in surfaces))
    return " ".join(" ".join(filter(None, item)) for item in told) or "-"


def to_json(scores: Sequence[Score]) -> str:
    """Return the results as JSON text: how many, mean, worst, and each one; null where a figure is undefined."""
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
    facts = ["name", "file", "robot", "root_scale", "object_scale", "object_surfaces", "frames"]
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
