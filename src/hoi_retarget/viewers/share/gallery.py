"""The pages of a gallery: text that comes from files is escaped, and paths are cut to their last name."""

import base64
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from html import escape
from importlib.resources import files
from pathlib import PureWindowsPath
from string import Template

from hoi_retarget import __version__
from hoi_retarget.evaluate import COLUMNS, Score, mean_values
from hoi_retarget.evaluate.table import scales_text
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots.spec import RobotSpec
from hoi_retarget.viewers.scene.curve_chart import LEFT_INSET_PX, RIGHT_INSET_PX
from hoi_retarget.viewers.share.packed_scene import stride_of

_ON_CARDS = (
    "contact_gap_m",
    "contact_gap_p95_m",
    "body_pose_deviation_deg",
    "body_jerk_mps3",
    "stance_slide_mps",
    "floor_penetration_max_m",
)
_LONGEST_NAME = 80


@dataclass(frozen=True, eq=False)
class GalleryEntry:
    """One result as the gallery tells of it."""

    title: str
    motion: Motion
    spec: RobotSpec
    score: Score
    warnings: tuple[str, ...] = ()
    """What is not right with it, a sentence each."""
    command: str = ""
    """How to make it again; empty where nobody knows."""


def file_name(title: str, taken: Iterable[str]) -> str:
    """Return a name that every file system takes and that none of the taken ones is, in capitals or not."""
    used = {name.casefold() for name in taken}
    name = plain = re.sub(r"[^A-Za-z0-9_-]+", "-", title).strip("-")[:_LONGEST_NAME] or "clip"
    number = 1
    while name.casefold() in used:
        number += 1
        name = f"{plain}-{number}"
    return name


def clip_page(entry: GalleryEntry, *, scene: str, curves: str, gallery: str) -> str:
    """Return the page of one result.

    Args:
        entry: What is told of it.
        scene: Of `packed_scene.pack`.
        curves: Of `curve_chart.chart_html`.
        gallery: The gallery's title.
    """
    script = _template("player.js")
    digest = base64.b64encode(sha256(script.encode()).digest()).decode("ascii")
    warnings = "".join(f"<li>{escape(warning)}</li>" for warning in entry.warnings)
    command = f"<h2>Made by</h2><pre>{escape(entry.command)}</pre>" if entry.command else ""
    return Template(_template("clip.html")).substitute(
        title=escape(entry.title),
        gallery=escape(gallery),
        subtitle=escape(_summary(entry)),
        style=_template("page.css"),
        script=script,
        # Nothing else may run in the page, or be loaded by it, whatever the files' names are.
        script_hash=f"sha256-{digest}",
        scene=scene,
        curves=curves,
        left=LEFT_INSET_PX,
        right=RIGHT_INSET_PX,
        warnings=f'<h2>Warnings</h2><ul class="warnings">{warnings}</ul>' if warnings else "",
        figures=_figures(entry.score),
        facts=_facts(entry),
        command=command,
        footer=_footer(),
    )


def index_page(title: str, entries: Sequence[tuple[GalleryEntry, str, str]]) -> str:
    """Return the page of all results: of each its entry, and the names of its page and of its picture."""
    return Template(_template("index.html")).substitute(
        title=escape(title),
        subtitle=escape(_overview([entry.score for entry, _, _ in entries])),
        style=_template("page.css"),
        cards="\n".join(_card(entry, page, picture) for entry, page, picture in entries),
        footer=_footer(),
    )


def _card(entry: GalleryEntry, page: str, picture: str) -> str:
    values = entry.score.values()
    figures = "".join(
        # A card is narrow.
        f"<dt>{escape(column.title.removeprefix('floor '))}</dt>"
        f"<dd>{column.text(values[column.name])} {escape(_unit(column.unit))}</dd>"
        for column in COLUMNS
        if column.name in _ON_CARDS
    )
    licence = entry.motion.report.source.licence
    return (
        f'<a class="card" href="{escape(page)}"><img src="{escape(picture)}" alt="">'
        f'<div><h2>{escape(entry.title)}</h2><p class="soft">{escape(_summary(entry))}</p><dl>{figures}</dl>'
        + (f'<p class="licence">Source: {escape(licence)}</p>' if licence else "")
        + "</div></a>"
    )


def _summary(entry: GalleryEntry) -> str:
    motion = entry.motion
    objects = ", ".join(motion.object_names) or "no object"
    return f"{entry.spec.title} · {objects} · {motion.frames} frames, {motion.frames / motion.fps:.1f} s"


def _overview(scores: Sequence[Score]) -> str:
    means = mean_values(scores)
    told = [
        f"{column.title} {column.text(means[column.name])} {_unit(column.unit)}"
        for column in COLUMNS
        if column.name in _ON_CARDS and means[column.name] is not None
    ]
    count = f"{len(scores)} motion{'s' if len(scores) != 1 else ''}"
    return f"{count}. Mean {', '.join(told)}." if len(scores) > 1 and told else f"{count}."


def _figures(score: Score) -> str:
    values = score.values()
    rows = [
        f'<tr><th>{escape(column.title)}</th><td class="number">{column.text(values[column.name])}</td>'
        f'<td class="unit">{escape(_unit(column.unit))}</td></tr>'
        for column in COLUMNS
    ]
    return f"<table>{''.join(rows)}</table>"


def _facts(entry: GalleryEntry) -> str:
    motion, score = entry.motion, entry.score
    stride = stride_of(motion.frames)
    facts = {
        "robot": entry.spec.title,
        "recording": _last_name(motion.report.source.path),
        "format": motion.report.source.format,
        "licence": motion.report.source.licence,
        "contacts": "edited" if motion.report.source.contact_edits else "",
        "objects": ", ".join(motion.object_names),
        "object scale": scales_text(motion.object_scale) if motion.object_names else "",
        "root scale": f"{score.root_scale:.3f}" if score.root_scale is not None else "",
        "human height": f"{motion.human_height:.2f} m",
        "frames": f"{motion.frames} at {motion.fps:g} a second",
        "played": f"one frame in {stride}; what lies between is interpolated" if stride > 1 else "",
    }
    rows = [f'<tr><th class="soft">{name}</th><td>{escape(text)}</td></tr>' for name, text in facts.items() if text]
    return f"<table>{''.join(rows)}</table>"


def _last_name(path: str) -> str:
    # Knows both kinds of slashes, whichever machine the result comes from.
    return PureWindowsPath(path).name or path


def _unit(unit: str) -> str:
    return unit.replace("^3", "³")


def _footer() -> str:
    return f"Made with hoi-retarget {escape(__version__)}."


@cache
def _template(name: str) -> str:
    return (files("hoi_retarget.viewers.share") / "page" / name).read_text(encoding="utf-8")
