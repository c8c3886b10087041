"""A report as tables that programs read: a row a file, one column a figure, in stored units."""

import csv
import io
import json
import math
from collections.abc import Sequence
from typing import Any

from hoi_retarget.evaluate.thresholds import THRESHOLDS, Level
from hoi_retarget.report.rows import Row

_WORDS = (
    "file",
    "format",
    "robot",
    "objects",
    "clip",
    "licence",
    "lineage",
    "level",
    "reasons",
    "not_judged",
    "notes",
    "error",
)
_NUMBERS = ("frames", "fps", "root_scale", "object_scale")


def index_columns(rows: Sequence[Row]) -> dict[str, list[Any]]:
    """Return the columns by name; None where a file has no such number, and an empty text for a word.

    Several objects, scales, reasons and names stand in one cell, divided by semicolons.
    """
    extra = sorted({name for row in rows for name in row.figures} - {threshold.name for threshold in THRESHOLDS})
    figures = [*(threshold.name for threshold in THRESHOLDS), *extra]
    records = [_record(row) | {name: row.figures.get(name) for name in figures} for row in rows]
    return {name: [record[name] for record in records] for name in (*_WORDS, *_NUMBERS, *figures)}


def _record(row: Row) -> dict[str, Any]:
    verdict = row.verdict
    return {
        "file": row.file,
        "format": row.format,
        "robot": row.robot,
        "objects": "; ".join(row.objects),
        "clip": row.clip,
        "licence": row.licence,
        "lineage": row.lineage,
        "level": str(row.level) if row.level is not None else "",
        "reasons": "; ".join(map(str, verdict.reasons)) if verdict else "",
        "not_judged": "; ".join(verdict.not_judged) if verdict else "",
        "notes": "; ".join(row.notes),
        "error": row.error,
        "frames": row.frames,
        "fps": row.fps,
        "root_scale": row.root_scale,
        "object_scale": "; ".join(map(repr, row.object_scale)),
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
    words = {*_WORDS, "object_scale"}
    types = {name: pyarrow.string() if name in words else pyarrow.float64() for name in index_columns(rows)}
    table = pyarrow.table(
        {
            name: pyarrow.array(values, pyarrow.int64() if name == "frames" else types[name])
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
    return {"file": row.file, **row.verdict.as_json(), "figures": figures}
