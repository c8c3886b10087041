"""Bars of the contacts over time: a row for each part, on the time axis of the curves."""

from collections.abc import Sequence
from typing import Any

from hoi_retarget.clip.edits import Segment, part_text
from hoi_retarget.viewers.html import render

ROW_HEIGHT_PX = 15
_COLOURS = {"left_hand": "#0072b2", "right_hand": "#d55e00", "left_foot": "#009e73", "right_foot": "#cc79a7"}


def strip_html(segments: Sequence[Segment], frames: int, chosen: Segment | None) -> str:
    """Return the rows as HTML; the chosen segment is framed."""
    rows: dict[tuple[int, str], list[Segment]] = {}
    for segment in segments:
        rows.setdefault((segment.person, segment.part), []).append(segment)
    return render(
        "viewers/browser/page/strip.html.j2",
        height_px=ROW_HEIGHT_PX,
        rows=[
            {
                "name": part_text(person, part).replace("_", " "),
                "colour": _COLOURS.get(part, "#888"),
                "bars": [_bar(segment, frames, chosen is segment) for segment in own],
            }
            for (person, part), own in rows.items()
        ],
    )


def strip_height_px(segments: Sequence[Segment]) -> int:
    """Return how high the rows are."""
    return ROW_HEIGHT_PX * len({(segment.person, segment.part) for segment in segments})


def _bar(segment: Segment, frames: int, chosen: bool) -> dict[str, Any]:
    """Return where a bar begins and how wide it is [%]."""
    last = max(1, frames - 1)
    return {"left": 100 * segment.start / last, "width": 100 * max(segment.frames - 1, 0.5) / last, "chosen": chosen}
