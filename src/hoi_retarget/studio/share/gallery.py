"""The results of a gallery, and the page of all of them."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from hoi_retarget.evaluation import Score, mean_values
from hoi_retarget.evaluation.figure_table import COMPUTE_TIME, grouped_columns
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots.spec import RobotSpec
from hoi_retarget.studio.html import render

_MAX_NAME_LENGTH = 80


@dataclass(frozen=True, eq=False)
class GalleryEntry:
    """One result of a page."""

    motion: Motion
    spec: RobotSpec
    score: Score
    warnings: tuple[str, ...] = ()  # Warnings about it, a sentence each.
    command: str = ""  # The command that makes it again; empty where it is not known.


def file_name(title: str, taken: Iterable[str]) -> str:
    """Return a name that every file system takes and that none of the taken ones is, in capitals or not."""
    used = {name.casefold() for name in taken}
    name = plain = re.sub(r"[^A-Za-z0-9_-]+", "-", title).strip("-")[:_MAX_NAME_LENGTH] or "clip"
    number = 1
    while name.casefold() in used:
        number += 1
        name = f"{plain}-{number}"
    return name


@dataclass(frozen=True, eq=False)
class Card:
    """A card on the page of all results that leads to a page."""

    title: str
    entries: tuple[GalleryEntry, ...]  # The page's results.
    page: str  # The page's file.
    picture: str = ""  # The picture's file; empty where there is none.
    film: str = ""  # The same of the picture that moves.


def index_page(title: str, cards: Sequence[Card]) -> str:
    """Return the page of all results."""
    return render(
        "studio/share/page/index.html.j2",
        title=title,
        overview=_overview([entry.score for card in cards for entry in card.entries]),
        cards=[
            {
                "of": card,
                "summary": summary_of(card.entries),
                "figures": [*_lights(card.entries), *_on_card([entry.score for entry in card.entries])],
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
    message = [f"{name} {value}" for name, value in _on_card(scores, mean=True)]
    count = f"{len(scores)} motion{'s' if len(scores) != 1 else ''}"
    return f"{count}. Mean {', '.join(message)}." if len(scores) > 1 and message else f"{count}."


def _lights(entries: Sequence[GalleryEntry]) -> list[tuple[str, str]]:
    """Return the names of the lights of a card, and their levels."""
    judged = [entry.score.lights for entry in entries if entry.score.verdict is not None]
    return [(name, " / ".join(lights[name] for lights in judged)) for name in ("motion", "physics") if judged]


def _on_card(scores: Sequence[Score], *, mean: bool = False) -> list[tuple[str, str]]:
    """Return the titles of the few figures of a card, and their values, or their mean, with units."""
    values = [mean_values(scores)] if mean else [score.values() for score in scores]
    columns = next(iter(grouped_columns(scores, every=False).values()), ())
    return [
        (column.title, f"{' / '.join(column.text(each.get(column.name)) for each in values)} {column.unit}")
        for column in columns
        if column is not COMPUTE_TIME
    ]
