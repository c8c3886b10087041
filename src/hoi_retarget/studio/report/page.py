"""The page of a report: one file that opens from anywhere, with a histogram of each figure over all motions."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hoi_retarget.evaluation import COLUMNS
from hoi_retarget.evaluation.thresholds import THRESHOLDS, Level, Threshold
from hoi_retarget.studio.html import render, with_exponents
from hoi_retarget.studio.report.motion_pages import MotionPage
from hoi_retarget.studio.report.rows import LIGHTS, STATES, Row, worst_first
from hoi_retarget.studio.scene.legend_texts import in_words, legend_of_figure

WIDTH, HEIGHT = 264, 124  # [px]
_LEFT, _RIGHT, _TOP, _BOTTOM = 6, 6, 18, 18  # Around the bars [px].
_BINS = 24
_MAX_FAIL_RATIO = 4.0  # Fail thresholds; what lies beyond is counted in the last bin.
_ROOM = 1.04  # Between the last value and the edge.


def histogram(threshold: Threshold, values: Sequence[float]) -> str:
    """Return an SVG histogram of at least one value, in stored units; colours of bars tell how good the values are."""
    sign = 1.0 if threshold.column.better == "lower" else -1.0
    low, high, labels = _axis(threshold, sign, values)

    def share(value: float) -> float:
        return float(np.clip((sign * value - low) / (high - low), 0.0, 1.0))

    bins = [min(_BINS - 1, int(share(value) * _BINS)) for value in values]
    counts = np.zeros((_BINS, len(Level)), dtype=int)
    np.add.at(counts, (bins, [threshold.level(value) for value in values]), 1)
    limits = {Level.WARN: threshold.warn, Level.FAIL: threshold.fail}
    shares = {level: share(limit) for level, limit in limits.items() if limit is not None}
    return render(
        "studio/report/page/histogram.svg.j2",
        header=threshold.column.header,
        **{"width": WIDTH, "height": HEIGHT, "top": _TOP, "base": HEIGHT - _BOTTOM},
        **{"left": _LEFT, "right": WIDTH - _RIGHT, "low": labels[0], "high": labels[1]},
        **{"figure": threshold.name, "better": threshold.column.better},
        bars=_bars(counts, lambda number: sign * (low + number / _BINS * (high - low))),
        marks=[
            {"level": level, "x": _x(along), "side": "end" if along > 0.5 else ""}
            for level, along in shares.items()
            if along < 1.0
        ],
    )


def _axis(threshold: Threshold, sign: float, values: Sequence[float]) -> tuple[float, float, tuple[str, str]]:
    """Return the ends of the axis, good values at the left, and their labels; the bad end may be cut."""
    worse = sign * np.array(values)
    warn, fail = sign * threshold.warn, threshold.fail
    low, high = min(float(worse.min()), warn, 0.0), max(float(worse.max()), warn)
    beyond = ""
    if fail is not None and high > warn:
        cut = _MAX_FAIL_RATIO * sign * fail
        beyond = " and beyond" if high > cut > 0 else ""
        high = cut if beyond else max(high, sign * fail)
    high = low + _ROOM * (high - low) if high > low else low + 1.0
    first, last = (f"{float(f'{threshold.column.scale * sign * end + 0.0:.3g}'):g}" for end in (low, high))
    return low, high, (first, last + beyond)


def _x(share: float) -> float:
    return _LEFT + share * (WIDTH - _LEFT - _RIGHT)


def _bars(counts: np.ndarray, value: Callable[[int], float]) -> Iterator[dict[str, Any]]:
    step = (_x(1.0) - _x(0.0)) / _BINS
    room, tallest = HEIGHT - _TOP - _BOTTOM, counts.sum(axis=1).max()
    for number, of_levels in enumerate(counts):
        base = float(HEIGHT - _BOTTOM)
        # The first bin and the last one hold all that is beyond them.
        ends = (value(number) if number else None, value(number + 1) if number + 1 < _BINS else None)
        for level in Level:
            if of_levels[level]:
                height = max(2.0, room * of_levels[level] / tallest)
                base -= height
                yield {
                    "level": level,
                    "x": _x(0.0) + number * step,
                    "y": base,
                    "width": step - 1,
                    "height": height,
                    "ends": ends,
                }


_IN_TABLE = (
    "touch_share",
    "palm_touch_share",
    "finger_touch_share",
    "touch_gap_p95_m",
    "touch_place_m",
    "hand_slip_mps",
    "contact_gap_m",
    "contact_gap_max_m",
    "unreached_share",
    "relative_hand_rotation_deg",
    "trunk_deviation_deg",
    "penetration_p95_m",
    "penetration_max_m",
    "self_penetration_max_m",
    "floor_penetration_max_m",
    "link_below_floor_m",
    "object_below_floor_m",
    "object_float_m",
    "support_height_error_m",
    "stance_float_m",
    "stance_slide_mps",
    "sole_tilt_deg",
    "body_jerk_mps3",
    "body_jerk_max_mps3",
    "joint_range_margin_rad",
    "joint_speed_margin_radps",
)
_DRAWN = tuple(name for name in _IN_TABLE if name != "joint_range_margin_rad")  # At its limit by design.
_CARDS, _PASSING_CARDS = 6, 3
_AT_FIRST = 100  # Rows of the table that a page shows before anybody scrolls.
_IN_GROUPS = (
    "touch_share",
    "hand_slip_mps",
    "person_slip_mps",
    "penetration_p95_m",
    "penetration_max_m",
    "stance_slide_mps",
    "body_jerk_mps3",
)


@dataclass(frozen=True)
class Table:
    """A table of the page."""

    title: str
    heads: Mapping[str, str]  # Name of each column, and what its cells are: `number`, `soft` or nothing of these.
    rows: Sequence[Sequence[Any]]  # Contents of the cells.
    filters: str = ""
    """What the table of all motions is filtered by at a click on a row's first cell; empty for nothing."""


def report_page(title: str, rows: Sequence[Row], pages: Mapping[str, MotionPage]) -> str:
    """Return the page of a report's rows; `pages` are those that play motions, by the motions' files."""
    judged = worst_first(rows)
    unread = [row for row in rows if row.verdict is None]
    thresholds = [threshold for threshold in _chosen(_IN_TABLE) if _values(judged, threshold.name)]
    # The worst of the motions that do not pass; where all do, those nearest to a threshold.
    shown = [row for row in judged if row.level is not Level.PASS][:_CARDS] or judged[:_PASSING_CARDS]
    return render(
        "studio/report/page/report.html.j2",
        title=title,
        files=len(rows),
        robots={row.robot for row in judged},
        objects={name for row in judged for name in row.objects},
        seconds=sum(row.seconds or 0.0 for row in judged),
        counts={state: sum(row.state == state for row in rows) for state in STATES},
        physics={light: sum(row.physics == light for row in judged) for light in LIGHTS},
        unread=Table("Without a motion", {"file": "", "reason": ""}, [(row.file, row.error) for row in unread]),
        reasons=[_reasons(judged, "motion"), _reasons(judged, "physics")],
        histograms=[
            _histogram(threshold, judged)
            for threshold in _chosen(_DRAWN)
            if _values(judged, threshold.name, judged=True)
        ],
        cards_title="Nearest to a threshold" if all(row.level is Level.PASS for row in shown) else "Worst motions",
        cards=[(row, pages[row.file]) for row in shown if row.file in pages],
        groups=_groups(judged),
        states=[state for state in STATES if state != "unread"],
        choices={
            "robot": sorted({row.robot for row in judged if row.robot}),
            "object": sorted({title for row in judged for title in row.object_titles}),
        },
        warned={threshold.name: threshold.column.title for threshold in THRESHOLDS if _is_warned(threshold, judged)},
        heads=_heads(thresholds, judged),
        motions=[(row, pages.get(row.file), [_figure(row, threshold) for threshold in thresholds]) for row in judged],
        at_first=_AT_FIRST,
        in_words=in_words,
        licences=_licences(judged),
        not_judged=_not_judged(judged),
        thresholds=_thresholds(),
    )


def _heads(thresholds: Sequence[Threshold], rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the columns of the table of all motions; at first those are shown that tell motions apart."""
    words = ("motion", "verdict", "physics", "why", "robot", "object", "format")
    formats = {row.format for row in rows}
    return [
        *({"name": name, "shown": name != "format" or len(formats) > 1} for name in words),
        *({"name": name, "kind": "number", "shown": name == "seconds"} for name in ("scale", "seconds")),
        *(
            {
                "name": threshold.column.header,
                "kind": "number",
                "figure": threshold.name,
                "meaning": legend_of_figure(threshold.column),
                "shown": _is_warned(threshold, rows),
            }
            for threshold in thresholds
        ),
    ]


def _is_warned(threshold: Threshold, rows: Sequence[Row]) -> bool:
    return any(row.verdict and threshold in [reason.threshold for reason in row.verdict.reasons] for row in rows)


def _reasons(rows: Sequence[Row], light: str) -> Table:
    """Return the thresholds of a light that motions do not pass, the worst first."""
    found = Counter(
        (reason.threshold.name, reason.level) for row in rows if row.verdict for reason in row.verdict.reasons
    )
    heads = {"figure": "", "warnings": "number", "failures": "number", "why it is judged": "soft"}
    lines = [
        (threshold.column.title, warn or "", fail or "", threshold.why)
        for threshold in THRESHOLDS
        if threshold.light == light
        and (warn := found[threshold.name, Level.WARN]) + (fail := found[threshold.name, Level.FAIL])
    ]
    worst = sorted(lines, key=lambda line: (line[2] or 0, line[1] or 0), reverse=True)
    title = {"motion": "What does not pass", "physics": "What physics warns of"}[light]
    return Table(title, heads, worst, filters="warning")


def _histogram(threshold: Threshold, rows: Sequence[Row]) -> dict[str, str]:
    column, values = threshold.column, _values(rows, threshold.name, judged=True)
    worst = max(values) if column.better == "lower" else min(values)
    message = f"median {column.text(float(np.median(values)))}, worst {column.text(worst)} {column.unit}"
    return {"title": column.title, "told": message, "svg": histogram(threshold, values)}


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
    columns = [column for column in COLUMNS if column.name in _IN_GROUPS]
    numbers = ["files", *map(str, Level), *(column.header for column in columns)]
    lines = []
    for name, members in groups.items():
        levels = [sum(row.level is level for row in members) for level in Level]
        values = [_values(members, column.name) for column in columns]
        means = [column.text(float(np.mean(own)) if own else None) for column, own in zip(columns, values, strict=True)]
        lines.append((name, len(members), *levels, *means))
    heads = {head: "", **dict.fromkeys(numbers, "number")}
    return Table(f"By {head}, with mean figures", heads, lines, filters="" if head == "format" else head)


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
    found = [threshold for threshold in THRESHOLDS if counts[threshold.name]]
    lines = [(threshold.column.title, f"{counts[threshold.name]} of {len(rows)}") for threshold in found]
    title = "Not judged: the figure is not there, or the motion was not asked for it"
    return Table(title, {"figure": "", "files": "number"}, lines)


def _thresholds() -> Table:
    lines = [
        (
            with_exponents(threshold.column.header),
            _limit(threshold, threshold.warn),
            _limit(threshold, threshold.fail),
            f"{threshold.light}{', fatal' if threshold.fatal else ''}",
            threshold.why,
        )
        for threshold in THRESHOLDS
    ]
    return Table("Thresholds", {"figure": "", "warn": "number", "fail": "number", "light": "", "why": "soft"}, lines)


def _limit(threshold: Threshold, limit: float | None) -> str:
    if limit is None:
        return ""
    return f"{'>' if threshold.column.better == 'lower' else '<'} {threshold.column.scale * limit:g}"


def _values(rows: Sequence[Row], name: str, *, judged: bool = False) -> list[float]:
    found = ((row.judged if judged else row.figures).get(name) for row in rows)
    return [value for value in found if value is not None and np.isfinite(value)]


def _chosen(names: Sequence[str]) -> list[Threshold]:
    by_name = {threshold.name: threshold for threshold in THRESHOLDS}
    return [by_name[name] for name in names]
