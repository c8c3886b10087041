"""Bars of the contacts over time with ends to be dragged, and distances of contacts' points from their surfaces.

A contact's point is the middle of a hand, which lies some way off the touched surface, as in the recording. A point
much farther off is in thin air.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import viser

from hoi_retarget.clip.clip import Clip, PosePin
from hoi_retarget.clip.edits import Segment, part_text, segments_of, span_text
from hoi_retarget.evaluation.unreached_contacts import FARTHER_M, NEAR_SURFACE_M
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.studio.html import render
from hoi_retarget.studio.scene.curves import LEFT_INSET_PX, RIGHT_INSET_PX

ROW_HEIGHT_PX = 15
_COLOURS = {"left_hand": "#0072b2", "right_hand": "#d55e00", "left_foot": "#009e73", "right_foot": "#cc79a7"}
_PINS = (0, "pins")

Span = tuple[int, int]
"""First frame, and one past the last."""


class SegmentEnds:
    """Sliders over the ends of the bars, two for each contact; only their thumbs are seen."""

    def __init__(self, timeline: viser.GuiTabHandle, gui: viser.GuiApi, frames: int) -> None:
        self._timeline, self._gui, self._last = timeline, gui, max(1, frames - 1)
        self._sliders: list[viser.GuiSliderHandle[int]] = []

    def show(self, segments: Sequence[Segment], drag: Callable[[int, int, int], None]) -> None:
        """Lay the sliders over the contacts' ends; `drag` receives a contact's number, the end (0, 1) and its frame."""
        while len(self._sliders) > 2 * len(segments):
            self._sliders.pop().remove()
        with self._timeline:
            for number in range(len(self._sliders), 2 * len(segments)):
                self._sliders.append(self._add(*divmod(number, 2), drag))
        for number, segment in enumerate(segments):
            for slider, frame in zip(self._of(number), (segment.start, segment.stop - 1), strict=True):
                slider.value = frame

    def ids(self, number: int) -> tuple[str, ...]:
        """Return the page's identifiers of a contact's sliders."""
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
    """Return the frames of a contact after one end was dragged: at least one, and none of the part's other contacts.

    Args:
        segments: All contacts.
        number: Of the dragged one.
        end: The dragged end: 0 for the first frame, 1 for the last.
        frame: The frame to which it is dragged.
    """
    segment = segments[number]
    others = [item for item in segments if (item.person, item.part) == (segment.person, segment.part)]
    if end == 0:
        free = max((item.stop for item in others if item.stop <= segment.start), default=0)
        return min(max(frame, free), segment.stop - 1), segment.stop
    limit = min((item.start for item in others if item.start >= segment.stop), default=frame + 1)
    return segment.start, max(min(frame + 1, limit), segment.start + 1)


def strip_html(  # noqa: PLR0913 - options with defaults
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
        ends: Returns the page's identifiers of the sliders over a contact's ends.
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
        "studio/browser/page/strip.html.j2",
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
    """Return the height of all rows [px]."""
    return ROW_HEIGHT_PX * (len({(segment.person, segment.part) for segment in segments}) + bool(pins))


def dragged_text(segment: Segment, span: Span) -> str:
    """Return the frames of a dragged contact in words."""
    return f"{part_text(segment.person, segment.part).replace('_', ' ')}: {span_text(*span)}"


def _bar(span: Span, frames: int) -> dict[str, Any]:
    """Return a bar's left end and width [%]."""
    last = max(1, frames - 1)
    start, stop = span
    return {"left": 100 * start / last, "width": 100 * max(stop - 1 - start, 0.5) / last}


@dataclass(frozen=True)
class SurfaceGap:
    """Distance of a contact's point from its surface."""

    distance: float
    """From the surface, its mean over the frames, at captured size [m]."""
    in_thin_air: bool

    @property
    def text(self) -> str:
        """One sentence."""
        what = " It touches nothing there; To surface puts it back." if self.in_thin_air else ""
        return f"The point is {1e3 * self.distance:.0f} mm off the surface.{what}"


class SurfaceGaps:
    """Measures contacts of one recording while they are edited."""

    def __init__(self, recorded: Clip) -> None:
        self._surfaces = [surface_of(track.geometry) for track in recorded.objects]
        self._farthest: dict[tuple[int, str, int], float] = {}
        for segment in segments_of(recorded):
            key = (segment.person, segment.part, segment.object)
            self._farthest[key] = max(self._farthest.get(key, 0.0), self._distance(segment))

    def of(self, segments: Iterable[Segment]) -> Sequence[SurfaceGap]:
        """Return the distance of each contact's point."""
        gaps = []
        for segment in segments:
            distance = self._distance(segment)
            recorded = self._farthest.get((segment.person, segment.part, segment.object), 0.0)
            gaps.append(SurfaceGap(distance, distance > max(NEAR_SURFACE_M, recorded + FARTHER_M)))
        return gaps

    def _distance(self, segment: Segment) -> float:
        return float(self._surfaces[segment.object].distances(segment.points).mean())
