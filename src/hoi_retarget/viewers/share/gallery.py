"""The results of a gallery, and the page of all of them."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from hoi_retarget.evaluation import COLUMNS, Score, mean_values
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots.spec import RobotSpec
from hoi_retarget.viewers.html import render

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
    """One result of a gallery."""

    title: str
    motion: Motion
    spec: RobotSpec
    score: Score
    warnings: tuple[str, ...] = ()
    """Warnings about it, a sentence each."""
    command: str = ""
    """The command that makes it again; empty where it is not known."""


def file_name(title: str, taken: Iterable[str]) -> str:
    """Return a name that every file system takes and that none of the taken ones is, in capitals or not."""
    used = {name.casefold() for name in taken}
    name = plain = re.sub(r"[^A-Za-z0-9_-]+", "-", title).strip("-")[:_LONGEST_NAME] or "clip"
    number = 1
    while name.casefold() in used:
        number += 1
        name = f"{plain}-{number}"
    return name


def index_page(title: str, entries: Sequence[tuple[GalleryEntry, str, str | None]]) -> str:
    """Return the page of all results: of each its entry, its page's name, and its picture's where there is one."""
    return render(
        "viewers/share/page/index.html.j2",
        title=title,
        overview=_overview([entry.score for entry, _, _ in entries]),
        cards=[
            {
                "page": page,
                "picture": picture,
                "title": entry.title,
                "summary": summary_of(entry),
                # A card is narrow.
                "figures": [(name.removeprefix("floor "), value) for name, value in _on_card(entry.score.values())],
                "licence": entry.motion.report.source.licence,
            }
            for entry, page, picture in entries
        ],
    )


def summary_of(entry: GalleryEntry) -> str:
    """Return robot, objects and length of a result in a line."""
    motion = entry.motion
    objects = ", ".join(motion.object_names) or "no object"
    return f"{entry.spec.title} · {objects} · {motion.frames} frames, {motion.frames / motion.fps:.1f} s"


def _overview(scores: Sequence[Score]) -> str:
    means = mean_values(scores)
    told = [f"{name} {value}" for name, value in _on_card({name: v for name, v in means.items() if v is not None})]
    count = f"{len(scores)} motion{'s' if len(scores) != 1 else ''}"
    return f"{count}. Mean {', '.join(told)}." if len(scores) > 1 and told else f"{count}."


def _on_card(values: Mapping[str, float | None]) -> list[tuple[str, str]]:
    """Return the titles of the few figures of a card, and their values with units."""
    return [
        (column.title, f"{column.text(values[column.name])} {column.unit}")
        for column in COLUMNS
        if column.name in _ON_CARDS and column.name in values
    ]
