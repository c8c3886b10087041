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
    """One result of a page."""

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


@dataclass(frozen=True, eq=False)
class Card:
    """What leads to a page, from the page of all results."""

    title: str
    entries: tuple[GalleryEntry, ...]
    """The page's results."""
    page: str
    """The page's file."""
    picture: str = ""
    """The picture's file; empty where there is none."""
    film: str = ""
    """The same of the picture that moves."""


def index_page(title: str, cards: Sequence[Card]) -> str:
    """Return the page of all results."""
    return render(
        "viewers/share/page/index.html.j2",
        title=title,
        overview=_overview([entry.score for card in cards for entry in card.entries]),
        cards=[
            {
                "of": card,
                "summary": summary_of(card.entries),
                # A card is narrow.
                "figures": [(name.removeprefix("floor "), value) for name, value in _on_card(_values(card.entries))],
                "licence": ", ".join(dict.fromkeys(entry.motion.report.source.licence for entry in card.entries)),
            }
            for card in cards
        ],
    )


def summary_of(entries: Sequence[GalleryEntry]) -> str:
    """Return robots, objects and length of results that are shown together in a line."""
    motion = entries[0].motion
    robots = " and ".join(entry.spec.title for entry in entries)
    objects = ", ".join(motion.object_names) or "no object"
    return f"{robots} · {objects} · {motion.frames} frames, {motion.frames / motion.fps:.1f} s"


def _overview(scores: Sequence[Score]) -> str:
    means = mean_values(scores)
    told = [f"{name} {value}" for name, value in _on_card({name: [v] for name, v in means.items() if v is not None})]
    count = f"{len(scores)} motion{'s' if len(scores) != 1 else ''}"
    return f"{count}. Mean {', '.join(told)}." if len(scores) > 1 and told else f"{count}."


def _values(entries: Sequence[GalleryEntry]) -> dict[str, list[float | None]]:
    """Return the figures that a result has, each of all results."""
    names = entries[0].score.values()
    return {name: [entry.score.values().get(name) for entry in entries] for name in names}


def _on_card(values: Mapping[str, Sequence[float | None]]) -> list[tuple[str, str]]:
    """Return the titles of the few figures of a card, and their values with units."""
    return [
        (column.title, f"{' / '.join(map(column.text, values[column.name]))} {column.unit}")
        for column in COLUMNS
        if column.name in _ON_CARDS and column.name in values
    ]
