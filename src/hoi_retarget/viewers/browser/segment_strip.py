"""Bars of the contacts over time, a row for each part, on the time axis of the curves; their ends can be dragged."""

from collections.abc import Callable, Sequence
from typing import Any

import viser

from hoi_retarget.clip.edits import Segment, part_text, span_text
from hoi_retarget.clip.pin import PosePin
from hoi_retarget.viewers.html import render
from hoi_retarget.viewers.scene.curve_chart import LEFT_INSET_PX, RIGHT_INSET_PX

ROW_HEIGHT_PX = 15
_COLOURS = {"left_hand": "#0072b2", "right_hand": "#d55e00", "left_foot": "#009e73", "right_foot": "#cc79a7"}
_PINS = (0, "pins")

Span = tuple[int, int]
"""First frame, and one past the last."""


class SegmentEnds:
    """Sliders over the ends of the bars, two for each contact; only what is dragged of them is seen."""

    def __init__(self, timeline: viser.GuiTabHandle, gui: viser.GuiApi, frames: int) -> None:
        self._timeline, self._gui, self._last = timeline, gui, max(1, frames - 1)
        self._sliders: list[viser.GuiSliderHandle[int]] = []

    def show(self, segments: Sequence[Segment], drag: Callable[[int, int, int], None]) -> None:
        """Lay the sliders over these contacts' ends.

        Args:
            segments: The contacts.
            drag: Is told the number of a contact, which end of it (0, 1) is dragged, and to which frame.
        """
        while len(self._sliders) > 2 * len(segments):
            self._sliders.pop().remove()
        with self._timeline:
            for number in range(len(self._sliders), 2 * len(segments)):
                self._sliders.append(self._add(*divmod(number, 2), drag))
        for number, segment in enumerate(segments):
            for slider, frame in zip(self._of(number), (segment.start, segment.stop - 1), strict=True):
                slider.value = frame

    def ids(self, number: int) -> tuple[str, ...]:
        """Return what a page calls the sliders of a contact."""
        return tuple(slider._impl.uuid for slider in self._of(number))

    def _of(self, number: int) -> list[viser.GuiSliderHandle[int]]:
        return self._sliders[2 * number : 2 * number + 2]

    def _add(self, number: int, end: int, drag: Callable[[int, int, int], None]) -> viser.GuiSliderHandle[int]:
        label = f"{('First', 'Last')[end]} frame of contact {number + 1}"
        slider = self._gui.add_slider(label, 0, self._last, 1, 0, order=1)

        # Asynchronous, so that Viser calls it in the order of what happened.
        @slider.on_update
        async def _(event: viser.GuiEvent[viser.GuiSliderHandle[int]]) -> None:
            if event.client is not None:
                drag(number, end, int(event.target.value))

        return slider


def dragged(segments: Sequence[Segment], number: int, end: int, frame: int) -> Span:
    """Return the frames of a contact after one end of it was dragged to a frame, or as far as it goes.

    One frame stays, and the part's contacts before and after stay as they are.
    """
    segment = segments[number]
    others = [item for item in segments if (item.person, item.part) == (segment.person, segment.part)]
    if end == 0:
        free = max((item.stop for item in others if item.stop <= segment.start), default=0)
        return min(max(frame, free), segment.stop - 1), segment.stop
    limit = min((item.start for item in others if item.start >= segment.stop), default=frame + 1)
    return segment.start, max(min(frame + 1, limit), segment.start + 1)


def strip_html(  # noqa: PLR0913
    segments: Sequence[Segment],
    frames: int,
    chosen: int | None,
    *,
    pins: Sequence[PosePin] = (),
    moved: tuple[int, Span] | None = None,
    ends: Callable[[int], Sequence[str]] = lambda _: (),
) -> str:
    """Return the rows as HTML.

    Args:
        segments: The contacts, a bar each.
        frames: Of the clip.
        chosen: Number of the contact that is framed.
        pins: Parts that are pinned, a mark each in a row of their own.
        moved: Number of a contact that is being dragged, and its frames now.
        ends: Returns what the page calls the sliders over the ends of a contact.
    """
    rows: dict[tuple[int, str], list[dict[str, Any]]] = {}
    for number, segment in enumerate(segments):
        span = moved[1] if moved and moved[0] == number else (segment.start, segment.stop)
        bar = {**_bar(span, frames), "chosen": chosen == number, "ends": ends(number)}
        rows.setdefault((segment.person, segment.part), []).append(bar)
    marks = [{**_bar((pin.frame, pin.frame + 1), frames), "chosen": False, "ends": ()} for pin in pins]
    if marks:
        rows[_PINS] = marks
    return render(
        "viewers/browser/page/strip.html.j2",
        **{"left_px": LEFT_INSET_PX, "right_px": RIGHT_INSET_PX, "row_px": ROW_HEIGHT_PX},
        rows=[
            {
                "number": number,
                "name": part if (person, part) == _PINS else part_text(person, part).replace("_", " "),
                "colour": _COLOURS.get(part, "#888"),
                "bars": bars,
            }
            for number, ((person, part), bars) in enumerate(rows.items())
        ],
    )


def strip_height_px(segments: Sequence[Segment], pins: Sequence[PosePin] = ()) -> int:
    """Return how high the rows are."""
    return ROW_HEIGHT_PX * (len({(segment.person, segment.part) for segment in segments}) + bool(pins))


def dragged_text(segment: Segment, span: Span) -> str:
    """Return in words which frames a contact is dragged to."""
    return f"{part_text(segment.person, segment.part).replace('_', ' ')}: {span_text(*span)}"


def _bar(span: Span, frames: int) -> dict[str, Any]:
    """Return where a bar begins and how wide it is [%]."""
    last = max(1, frames - 1)
    start, stop = span
    return {"left": 100 * start / last, "width": 100 * max(stop - 1 - start, 0.5) / last}
