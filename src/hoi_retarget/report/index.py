"""A report as tables that programs read: a row a file, one column a figure, in stored units."""

import csv
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from hoi_retarget.evaluation.thresholds import THRESHOLDS, Level
from hoi_retarget.report.rows import Row

_COLUMNS: Mapping[str, tuple[type, Callable[[Row], Any]]] = {
    "file": (str, lambda row: row.file),
    "format": (str, lambda row: row.format),
    "robot": (str, lambda row: row.robot),
    "objects": (str, lambda row: "; ".join(row.objects)),
    "object_surfaces": (str, lambda row: "; ".join(row.object_surfaces.get(name, "") for name in row.objects)),
    "clip": (str, lambda row: row.clip),
    "licence": (str, lambda row: row.licence),
    "lineage": (str, lambda row: row.lineage),
    "level": (str, lambda row: str(row.level) if row.level is not None else ""),
    "reasons": (str, lambda row: "; ".join(map(str, row.verdict.reasons)) if row.verdict else ""),
    "contradictions": (str, lambda row: "; ".join(row.contradictions)),
    "not_judged": (str, lambda row: "; ".join(row.verdict.not_judged) if row.verdict else ""),
    "notes": (str, lambda row: "; ".join(row.notes)),
    "error": (str, lambda row: row.error),
    "frames": (int, lambda row: row.frames),
    "fps": (float, lambda row: row.fps),
    "root_scale": (float, lambda row: row.root_scale),
    "object_scale": (str, lambda row: "; ".join(map(repr, row.object_scale))),
}
"""The columns before the figures: type and content."""


def index_columns(rows: Sequence[Row]) -> dict[str, list[Any]]:
    """Return the columns by name; None where a file has no such number, and an empty text for a word.

    Several objects, scales, reasons and names stand in one cell, divided by semicolons.
    """
    extra = sorted({name for row in rows for name in row.figures} - {threshold.name for threshold in THRESHOLDS})
    figures = [*(threshold.name for threshold in THRESHOLDS), *extra]
    return {
        **{name: [content(row) for row in rows] for name, (_, content) in _COLUMNS.items()},
        **{name: [row.figures.get(name) for row in rows] for name in figures},
    }


def to_csv(rows: Sequence[Row]) -> bytes:
    """Return the table as CSV; empty where there is no number."""
    columns = index_columns(rows)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return text.getvalue().encode()


def to_parquet(rows: Sequence[Row]) -> bytes | None:
    """Return the same table in Parquet's format; None where pyarrow, of the extra `dataset`, is not installed."""
    try:
        import pyarrow  # noqa: PLC0415  # an extra
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError:
        return None
    types = {str: pyarrow.string(), int: pyarrow.int64(), float: pyarrow.float64()}
    table = pyarrow.table(
        {
            name: pyarrow.array(values, types[_COLUMNS[name][0] if name in _COLUMNS else float])
            for name, values in index_columns(rows).items()
        }
    )
    sink = io.BytesIO()
    parquet.write_table(table, sink)
    return sink.getvalue()


def to_json(rows: Sequence[Row]) -> bytes:
    """Return the verdicts as JSON: the thresholds, how many files are of each level, and each file."""
    judged = [row for row in rows if row.verdict is not None]
    document = {
        "counts": {
            **{str(level): sum(row.level is level for row in judged) for level in Level},
            "unread": len(rows) - len(judged),
        },
        "thresholds": [
            {
                "figure": threshold.name,
                "better": threshold.column.better,
                "warn": threshold.warn,
                "fail": threshold.fail,
                "why": threshold.why,
            }
            for threshold in THRESHOLDS
        ],
        "files": [_entry(row) for row in rows],
    }
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()


def _entry(row: Row) -> dict[str, Any]:
    if row.verdict is None:
        return {"file": row.file, "level": None, "error": row.error}
    figures = {name: value if value is None or math.isfinite(value) else None for name, value in row.figures.items()}
    verdict = {**row.verdict.as_json(), "contradictions": list(row.contradictions)}
    return {"file": row.file, **verdict, "figures": figures}
