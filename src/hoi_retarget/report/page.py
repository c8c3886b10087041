"""The page of a report: one file that opens from anywhere, without a server or the internet."""

import base64
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hoi_retarget.evaluation import Figure
from hoi_retarget.evaluation.thresholds import THRESHOLDS, Level, Threshold
from hoi_retarget.report.histogram import histogram
from hoi_retarget.report.rows import Row, worst_first
from hoi_retarget.viewers.html import render, with_exponents

_IN_TABLE = (
    "contact_gap_m",
    "contact_gap_max_m",
    "touch_share",
    "touch_gap_p95_m",
    "touch_place_m",
    "contact_slip_mps",
    "unreached_share",
    "relative_hand_rotation_deg",
    "penetration_p95_m",
    "penetration_max_m",
    "self_penetration_max_m",
    "floor_penetration_max_m",
    "link_below_floor_m",
    "object_below_floor_m",
    "object_float_m",
    "stance_float_m",
    "stance_slide_mps",
    "sole_tilt_deg",
    "body_jerk_mps3",
    "body_jerk_max_mps3",
    "joint_range_margin_rad",
    "joint_speed_margin_radps",
)
_DRAWN = tuple(name for name in _IN_TABLE if name != "joint_range_margin_rad")  # At its limit by design.
_IN_GROUPS = (
    "contact_gap_m",
    "touch_share",
    "penetration_p95_m",
    "floor_penetration_max_m",
    "stance_slide_mps",
    "body_jerk_mps3",
)


@dataclass(frozen=True)
class Table:
    """A table of the page."""

    title: str
    heads: Mapping[str, str]
    """Name of each column, and what its cells are: `number`, `soft` or nothing of these."""
    rows: Sequence[Sequence[Any]]
    """Contents of the cells."""


def report_page(title: str, rows: Sequence[Row], pictures: Mapping[str, bytes]) -> str:
    """Return the page.

    Args:
        title: Of the report.
        rows: Its files.
        pictures: Of the motions that are shown one by one, in their order: file to PNG.
    """
    judged = worst_first(rows)
    unread = [row for row in rows if row.verdict is None]
    thresholds = [threshold for threshold in _chosen(_IN_TABLE) if _values(judged, threshold.name)]
    shown = [row for row in judged if row.file in pictures]
    return render(
        "report/page/report.html.j2",
        title=title,
        files=len(rows),
        robots={row.robot for row in judged},
        objects={name for row in judged for name in row.objects},
        seconds=sum(row.seconds or 0.0 for row in judged),
        counts={**{str(level): sum(row.level is level for row in rows) for level in Level}, "unread": len(unread)},
        unread=Table("Without a motion", {"file": "", "reason": ""}, [(row.file, row.error) for row in unread]),
        reasons=_reasons(judged),
        histograms=[
            _histogram(threshold, judged)
            for threshold in _chosen(_DRAWN)
            if _values(judged, threshold.name, judged=True)
        ],
        cards_title="Nearest to a threshold" if all(row.level is Level.PASS for row in shown) else "Worst motions",
        cards=[(row, base64.b64encode(pictures[row.file]).decode("ascii")) for row in shown],
        groups=_groups(judged),
        levels=list(Level),
        motion_heads={
            **dict.fromkeys(("verdict", "motion", "format", "robot", "object"), ""),
            **dict.fromkeys(("scale", "seconds", *(threshold.column.header for threshold in thresholds)), "number"),
            "why": "",
        },
        motions=[(row, [_figure(row, threshold) for threshold in thresholds]) for row in judged],
        licences=_licences(judged),
        not_judged=_not_judged(judged),
        thresholds=_thresholds(),
    )


def _reasons(rows: Sequence[Row]) -> Table:
    found = Counter(
        (reason.threshold.name, reason.level) for row in rows if row.verdict for reason in row.verdict.reasons
    )
    heads = {"figure": "", "warnings": "number", "failures": "number", "why it is judged": "soft"}
    lines = [
        (threshold.column.title, warn or "", fail or "", threshold.why)
        for threshold in THRESHOLDS
        if (warn := found[threshold.name, Level.WARN]) + (fail := found[threshold.name, Level.FAIL])
    ]
    return Table("What does not pass", heads, lines)


def _histogram(threshold: Threshold, rows: Sequence[Row]) -> dict[str, str]:
    column, values = threshold.column, _values(rows, threshold.name, judged=True)
    worst = max(values) if column.better == "lower" else min(values)
    told = f"median {column.text(float(np.median(values)))}, worst {column.text(worst)} {column.unit}"
    return {"title": column.title, "told": told, "svg": histogram(threshold, values)}


def _groups(rows: Sequence[Row]) -> list[Table]:
    tables = [
        _group("robot", rows, lambda row: row.robot or "-"),
        _group("format", rows, lambda row: row.format or "-"),
        _group("object", rows, lambda row: ", ".join(row.object_titles) or "none"),
    ]
    return [table for table in tables if len(table.rows) > 1 or "format" not in table.heads]


def _group(head: str, rows: Sequence[Row], of: Callable[[Row], str]) -> Table:
    groups: dict[str, list[Row]] = {}
    for row in sorted(rows, key=of):
        groups.setdefault(of(row), []).append(row)
    columns = [threshold.column for threshold in _chosen(_IN_GROUPS)]
    numbers = ["files", *map(str, Level), *(column.header for column in columns)]
    lines = []
    for name, members in groups.items():
        levels = [sum(row.level is level for row in members) for level in Level]
        lines.append(
            (name, len(members), *levels, *(_mean(column, _values(members, column.name)) for column in columns))
        )
    return Table(f"By {head}, with mean figures", {head: "", **dict.fromkeys(numbers, "number")}, lines)


def _figure(row: Row, threshold: Threshold) -> tuple[str, str, str]:
    """Return a figure as it is shown, the number that it is sorted by, and its level where it is not good."""
    value = row.figures.get(threshold.name)
    levels = {reason.threshold.name: str(reason.level) for reason in row.verdict.reasons} if row.verdict else {}
    sorted_by = "" if value is None or not np.isfinite(value) else repr(float(value))
    return threshold.column.text(value), sorted_by, levels.get(threshold.name, "")


def _licences(rows: Sequence[Row]) -> Table:
    counts = Counter(row.licence for row in rows)
    lines = [(licence or "not stated in the file", count) for licence, count in sorted(counts.items())]
    return Table("Licences of the recordings", {"licence": "", "files": "number"}, lines)


def _not_judged(rows: Sequence[Row]) -> Table:
    counts = Counter(name for row in rows if row.verdict for name in row.verdict.not_judged)
    lines = [
        (threshold.column.title, f"{counts[threshold.name]} of {len(rows)}")
        for threshold in THRESHOLDS
        if counts[threshold.name]
    ]
    return Table("Not judged, because the figure is not there", {"figure": "", "files": "number"}, lines)


def _thresholds() -> Table:
    lines = [
        (
            with_exponents(threshold.column.header),
            _limit(threshold, threshold.warn),
            _limit(threshold, threshold.fail),
            threshold.why,
        )
        for threshold in THRESHOLDS
    ]
    return Table("Thresholds", {"figure": "", "warn": "number", "fail": "number", "why": "soft"}, lines)


def _limit(threshold: Threshold, limit: float | None) -> str:
    if limit is None:
        return ""
    return f"{'>' if threshold.column.better == 'lower' else '<'} {threshold.column.scale * limit:g}"


def _mean(column: Figure, values: Sequence[float]) -> str:
    return column.text(float(np.mean(values)) if values else None)


def _values(rows: Sequence[Row], name: str, *, judged: bool = False) -> list[float]:
    found = ((row.judged if judged else row.figures).get(name) for row in rows)
    return [value for value in found if value is not None and np.isfinite(value)]


def _chosen(names: Sequence[str]) -> list[Threshold]:
    return [threshold for threshold in THRESHOLDS if threshold.name in names]
