"""Who touches what when: a row of bars for each part, on the time axis of the curves."""

from collections.abc import Sequence
from html import escape

from hoi_retarget.clip.edits import Segment, part_text
from hoi_retarget.viewers.scene.curve_chart import LEFT_INSET_PX, RIGHT_INSET_PX

ROW_HEIGHT_PX = 15
_COLOURS = {"left_hand": "#0072b2", "right_hand": "#d55e00", "left_foot": "#009e73", "right_foot": "#cc79a7"}


def strip_html(segments: Sequence[Segment], frames: int, chosen: Segment | None) -> str:
    """Return the rows as HTML; the chosen segment is framed."""
    rows = dict.fromkeys((segment.person, segment.part) for segment in segments)
    drawn = []
    for person, part in rows:
        name = part_text(person, part).replace("_", " ")
        own = [segment for segment in segments if (segment.person, segment.part) == (person, part)]
        bars = "".join(_bar(segment, frames, chosen is segment) for segment in own)
        drawn.append(
            f'<div style="display:flex;height:{ROW_HEIGHT_PX}px;font:11px/{ROW_HEIGHT_PX}px system-ui,sans-serif">'
            f'<b style="width:{LEFT_INSET_PX}px;padding-left:8px;box-sizing:border-box">{escape(name)}</b>'
            f'<div style="position:relative;flex:1;margin-right:{RIGHT_INSET_PX}px">{bars}</div></div>'
        )
    return "".join(drawn)


def strip_height_px(segments: Sequence[Segment]) -> int:
    """Return how high the rows are."""
    return ROW_HEIGHT_PX * len({(segment.person, segment.part) for segment in segments})


def _bar(segment: Segment, frames: int, chosen: bool) -> str:
    last = max(1, frames - 1)
    left, width = 100 * segment.start / last, 100 * max(segment.frames - 1, 0.5) / last
    frame = "outline:2px solid #111;" if chosen else ""
    return (
        f'<div style="position:absolute;left:{left:.2f}%;width:{width:.2f}%;top:2px;bottom:2px;border-radius:2px;'
        f'{frame}background:{_COLOURS.get(segment.part, "#888")}"></div>'
    )
