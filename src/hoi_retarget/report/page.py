"""The page of a report: one file that opens from anywhere, without a server or the internet."""

import base64
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from hashlib import sha256
from html import escape
from importlib.resources import files
from string import Template

import numpy as np

from hoi_retarget import __version__
from hoi_retarget.evaluate import Column
from hoi_retarget.evaluate.thresholds import THRESHOLDS, Level, Threshold
from hoi_retarget.report.histogram import histogram
from hoi_retarget.report.rows import Row, worst_first

_IN_TABLE = (
    "contact_gap_m",
    "contact_gap_max_m",
    "contact_slip_mps",
    "unreached_share",
    "relative_hand_rotation_deg",
    "floor_penetration_max_m",
    "object_below_floor_m",
    "stance_float_m",
    "stance_slide_mps",
    "sole_tilt_deg",
    "body_jerk_mps3",
    "body_jerk_max_mps3",
    "joint_range_margin_rad",
    "joint_speed_margin_radps",
)
_DRAWN = tuple(name for name in _IN_TABLE if name != "joint_range_margin_rad")  # At its limit by design.
_IN_GROUPS = (*_IN_TABLE[:3], "floor_penetration_max_m", "stance_slide_mps", "body_jerk_mps3")
_PICTURE_TYPES = {".png": "image/png", ".svg": "image/svg+xml"}
Picture = tuple[str, bytes]
"""The ending of a picture's file name, and its content."""


def report_page(title: str, rows: Sequence[Row], pictures: Mapping[str, Picture]) -> str:
    """Return the page.

    Args:
        title: Of the report.
        rows: Its files.
        pictures: Of the motions that are shown one by one, in their order: file to picture.
    """
    judged = worst_first(rows)
    unread = [row for row in rows if row.verdict is None]
    script = _asset("report", "report.js")
    digest = base64.b64encode(sha256(script.encode()).digest()).decode("ascii")
    sections = (
        _counts(rows),
        _unread(unread),
        _reasons(judged),
        _histograms(judged),
        _cards(judged, pictures),
        _groups("By robot", "robot", judged, lambda row: row.robot or "-"),
        _groups("By format", "format", judged, lambda row: row.format or "-"),
        _groups("By object", "object", judged, lambda row: ", ".join(row.objects) or "none"),
        _motions(judged),
        _licences(judged),
        _not_judged(judged),
        _thresholds(),
    )
    return Template(_asset("report", "report.html")).substitute(
        title=escape(title),
        subtitle=escape(_subtitle(judged, unread)),
        style=_asset("viewers.share", "page.css") + _asset("report", "report.css"),
        script=script,
        script_hash=f"sha256-{digest}",  # Nothing else may run in the page, whatever the files' names are.
        sections="\n".join(section for section in sections if section),
        footer=f"Made with hoi-retarget {escape(__version__)}.",
    )


def _subtitle(judged: Sequence[Row], unread: Sequence[Row]) -> str:
    robots = {row.robot for row in judged}
    objects = {name for row in judged for name in row.objects}
    seconds = sum(row.seconds or 0.0 for row in judged)
    told = [
        _plural(len(judged) + len(unread), "file"),
        _plural(len(robots), "robot"),
        _plural(len(objects), "object"),
        f"{seconds / 60:.1f} minutes of motion" if seconds >= 120 else f"{seconds:.0f} seconds of motion",
    ]
    return " · ".join(told)


def _counts(rows: Sequence[Row]) -> str:
    counts = {str(level): sum(row.level is level for row in rows) for level in Level}
    counts["unread"] = sum(row.level is None for row in rows)
    there = {name: count for name, count in counts.items() if count}
    bar = "".join(f'<i class="{name}" style="flex:{count}"></i>' for name, count in there.items())
    told = "".join(
        f'<span><b>{count}</b><span class="level {name}">{name}</span></span>'
        for name, count in counts.items()
        if count or name != "unread"
    )
    return f'<div class="share">{bar}</div><div class="counts">{told}</div>'


def _unread(rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    lines = [f"<tr><td>{escape(row.file)}</td><td>{escape(row.error)}</td></tr>" for row in rows]
    return _table("Without a motion", ("file", "reason"), lines)


def _reasons(rows: Sequence[Row]) -> str:
    found = Counter(
        (reason.threshold.name, reason.level) for row in rows if row.verdict for reason in row.verdict.reasons
    )
    lines = [
        f'<tr><td>{escape(threshold.column.title)}</td><td class="number">{warn or ""}</td>'
        f'<td class="number">{fail or ""}</td><td class="soft">{escape(threshold.why)}</td></tr>'
        for threshold in THRESHOLDS
        if (warn := found[threshold.name, Level.WARN]) + (fail := found[threshold.name, Level.FAIL])
    ]
    heads = ("figure", "*warnings", "*failures", "why it is judged")
    return _table("What does not pass", heads, lines) if lines else ""


def _histograms(rows: Sequence[Row]) -> str:
    drawn = []
    for threshold in _chosen(_DRAWN):
        values = _values(rows, threshold.name)
        if not values:
            continue
        column = threshold.column
        worst = max(values) if column.better == "lower" else min(values)
        told = f"median {column.text(float(np.median(values)))}, worst {column.text(worst)} {_unit(column)}"
        drawn.append(
            f"<figure><figcaption>{escape(column.title)} <span class=soft>{escape(told)}</span></figcaption>"
            f"{histogram(threshold, values)}</figure>"
        )
    return f'<h2>Distributions</h2><div class="histograms">{"".join(drawn)}</div>' if drawn else ""


def _cards(rows: Sequence[Row], pictures: Mapping[str, Picture]) -> str:
    shown = [row for row in rows if row.file in pictures]
    if not shown:
        return ""
    title = "Nearest to a threshold" if all(row.level is Level.PASS for row in shown) else "Worst motions"
    return f'<h2>{title}</h2><div class="cards">{"".join(_card(row, *pictures[row.file]) for row in shown)}</div>'


def _card(row: Row, ending: str, picture: bytes) -> str:
    assert row.verdict is not None
    data = f"data:{_PICTURE_TYPES[ending]};base64,{base64.b64encode(picture).decode('ascii')}"
    reasons = "".join(f"<li>{escape(_with_units(str(reason)))}</li>" for reason in row.verdict.reasons)
    facts = " · ".join((row.robot, ", ".join(row.objects) or "no object", f"{row.seconds or 0.0:.1f} s"))
    return (
        f'<div class="card"><img src="{data}" alt=""><div><h2>{escape(row.name)} {_badge(row)}</h2>'
        f'<p class="soft">{escape(facts)}</p><ul>{reasons}</ul></div></div>'
    )


def _groups(title: str, head: str, rows: Sequence[Row], of: Callable[[Row], str]) -> str:
    groups: dict[str, list[Row]] = {}
    for row in sorted(rows, key=of):
        groups.setdefault(of(row), []).append(row)
    columns = [threshold.column for threshold in _chosen(_IN_GROUPS)]
    lines = []
    for name, members in groups.items():
        levels = [sum(row.level is level for row in members) for level in Level]
        means = [_mean(column, _values(members, column.name)) for column in columns]
        cells = "".join(f'<td class="number">{escape(str(text))}</td>' for text in (len(members), *levels, *means))
        lines.append(f"<tr><td>{escape(name)}</td>{cells}</tr>")
    if len(groups) == 1 and head == "format":
        return ""
    heads = (head, "*files", *(f"*{level}" for level in Level), *(f"*{_head(column)}" for column in columns))
    return _table(f"{title}, with mean figures", heads, lines) if lines else ""


def _motions(rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    thresholds = [threshold for threshold in _chosen(_IN_TABLE) if _values(rows, threshold.name)]
    heads = ("verdict", "motion", "format", "robot", "object", "*scale", "*seconds")
    heads += (*(f"*{_head(threshold.column)}" for threshold in thresholds), "why")
    lines = [_motion(row, thresholds) for row in rows]
    options = "".join(f"<option>{level}</option>" for level in Level)
    return (
        '<h2>All motions</h2><div class="find" id="find" hidden><label>Find <input type="search"></label>'
        f'<label>Verdict <select><option value="">all</option>{options}</select></label><output></output></div>'
        f'<div class="wide"><table id="motions">{_header(heads)}<tbody>{"".join(lines)}</tbody></table></div>'
    )


def _motion(row: Row, thresholds: Sequence[Threshold]) -> str:
    assert row.verdict is not None
    levels = {reason.threshold.name: reason.level for reason in row.verdict.reasons}
    cells = [
        f'<td data-value="{int(row.verdict.level)}">{_badge(row)}</td>',
        *(f"<td>{escape(text)}</td>" for text in (row.file, row.format, row.robot, ", ".join(row.objects) or "-")),
        _cell(row.object_scale[0] if row.object_scale else None, " ".join(f"{s:.3f}" for s in row.object_scale) or "-"),
        _cell(row.seconds, "-" if row.seconds is None else f"{row.seconds:.1f}"),
    ]
    for threshold in thresholds:
        value = row.figures.get(threshold.name)
        level = levels.get(threshold.name, "")
        cells.append(_cell(value, threshold.column.text(value), str(level)))
    reasons = _with_units("; ".join((*map(str, row.verdict.reasons), *row.notes)))
    return f'<tr>{"".join(cells)}<td class="reasons">{escape(reasons)}</td></tr>'


def _cell(value: float | None, text: str, level: str = "") -> str:
    sorted_by = "" if value is None or not np.isfinite(value) else repr(float(value))
    return f'<td class="number {level}" data-value="{sorted_by}">{escape(text)}</td>'


def _licences(rows: Sequence[Row]) -> str:
    counts = Counter(row.licence for row in rows)
    lines = [
        f'<tr><td>{escape(licence or "not stated in the file")}</td><td class="number">{count}</td></tr>'
        for licence, count in sorted(counts.items())
    ]
    return _table("Licences of the recordings", ("licence", "*files"), lines) if lines else ""


def _not_judged(rows: Sequence[Row]) -> str:
    counts = Counter(name for row in rows if row.verdict for name in row.verdict.not_judged)
    lines = [
        f"<tr><td>{escape(threshold.column.title)}</td>"
        f'<td class="number">{counts[threshold.name]} of {len(rows)}</td></tr>'
        for threshold in THRESHOLDS
        if counts[threshold.name]
    ]
    return _table("Not judged, because the figure is not there", ("figure", "*files"), lines) if lines else ""


def _thresholds() -> str:
    lines = [
        f"<tr><td>{escape(_head(column))}</td>"
        f'<td class="number">{"&gt;" if column.better == "lower" else "&lt;"} {column.scale * threshold.warn:g}</td>'
        f'<td class="number">{_limit(threshold)}</td><td class="soft">{escape(threshold.why)}</td></tr>'
        for threshold in THRESHOLDS
        for column in (threshold.column,)
    ]
    table = f"<table>{_header(('figure', '*warn', '*fail', 'why'))}<tbody>{''.join(lines)}</tbody></table>"
    return f'<details><summary>Thresholds</summary><div class="scroll">{table}</div></details>'


def _limit(threshold: Threshold) -> str:
    if threshold.fail is None:
        return ""
    side = "&gt;" if threshold.column.better == "lower" else "&lt;"
    return f"{side} {threshold.column.scale * threshold.fail:g}"


def _table(title: str, heads: Sequence[str], lines: Sequence[str]) -> str:
    table = f"<table>{_header(heads)}<tbody>{''.join(lines)}</tbody></table>"
    return f'<h2>{escape(title)}</h2><div class="scroll">{table}</div>'


def _header(heads: Sequence[str]) -> str:
    """Return a header row; columns whose head begins with a star are numbers."""
    cells = (
        f'<th class="number">{escape(head[1:])}</th>' if head.startswith("*") else f"<th>{escape(head)}</th>"
        for head in heads
    )
    return f"<thead><tr>{''.join(cells)}</tr></thead>"


def _badge(row: Row) -> str:
    return f'<span class="level {row.level}">{row.level}</span>'


def _head(column: Column) -> str:
    return f"{column.title} [{_unit(column)}]"


def _unit(column: Column) -> str:
    return column.unit.replace("^3", "³")


def _with_units(text: str) -> str:
    return text.replace("m/s^3", "m/s³")


def _mean(column: Column, values: Sequence[float]) -> str:
    return column.text(float(np.mean(values)) if values else None)


def _values(rows: Sequence[Row], name: str) -> list[float]:
    found = (row.figures.get(name) for row in rows)
    return [value for value in found if value is not None and np.isfinite(value)]


def _chosen(names: Sequence[str]) -> list[Threshold]:
    return [threshold for threshold in THRESHOLDS if threshold.name in names]


def _plural(count: int, word: str) -> str:
    return f"{count} {word}{'s' if count != 1 else ''}"


def _asset(package: str, name: str) -> str:
    return (files(f"hoi_retarget.{package}") / "page" / name).read_text(encoding="utf-8")
