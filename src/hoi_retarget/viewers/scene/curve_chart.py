"""A timeline as a fragment of HTML: bars and small charts of curves above each other that share the time axis.

The plotting area begins `LEFT_INSET_PX` from the fragment's left edge and ends `RIGHT_INSET_PX` from its
right one, however wide the page: frame 0 lies on the one, the last frame on the other.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.numerics.arrays import runs
from hoi_retarget.viewers.html import render, with_exponents
from hoi_retarget.viewers.scene.bars import Bar, BarRow
from hoi_retarget.viewers.scene.curves import Curve
from hoi_retarget.viewers.scene.meanings import BARS, CURVES, badness, worst_frame

LEFT_INSET_PX = 164
RIGHT_INSET_PX = 160
CHART_HEIGHT_PX = 20
CHART_STEP_PX = CHART_HEIGHT_PX + 3
"""From one chart to the next."""
BAR_ROW_HEIGHT_PX = 15
TITLES_HEIGHT_PX = 19
"""Of the line that names several results."""
LARGEST_POINTS = 1500
"""Points of one curve; of longer ones the smallest and the largest number of every stretch is drawn."""

_WIDTH, _HEIGHT = 20_000, 4000  # Units of the drawings, which are stretched to the page.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
_DASHES = ("", "5 3", "1.5 2.5", "7 2.5 1.5 2.5")
_ROUND_NUMBERS = np.array([1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
_ROUND_STEPS = np.array([1.0, 2.0, 5.0, 10.0])
_LARGEST_TICKS = 12


@dataclass(frozen=True)
class _Look:
    """Colour and dashes of a curve."""

    colour: str
    dash: str = ""


def chart_html(  # noqa: PLR0913
    subjects: Sequence[tuple[str, tuple[Curve, ...]]],
    fps: float,
    *,
    rows: Sequence[BarRow] = (),
    chart_height_px: int = CHART_HEIGHT_PX,
    largest_points: int = LARGEST_POINTS,
    operable: bool = False,
) -> str:
    """Return the charts of one or several results: a chart a group, curves of all results in it.

    One result's curves differ in colour. Of several results each has a colour, and its curves differ in
    their dashes. Frames that a figure counts are drawn bold, where it counts only some.

    Args:
        subjects: Each result's title and curves.
        fps: Rate of the frames that the time axis is divided into: `Scene.fps` where a scene plays beside it.
        rows: Bars above the charts.
        chart_height_px: Of one chart [px].
        largest_points: Points of one curve.
        operable: Whether a script of the page (`share/page/timeline.js`) makes it answer to the pointer.
    """
    seconds = max(((len(curve.values) - 1) / curve.fps for _, curves in subjects for curve in curves), default=0.0)
    # The last frame of the scene, as `Scene.frames` counts.
    seconds = max(round(seconds * fps), 1) / fps
    groups: dict[str, list[tuple[int, Curve]]] = {}
    for index, (_, curves) in enumerate(subjects):
        for curve in curves:
            groups.setdefault(curve.group, []).append((index, curve))
    several = len(subjects) > 1
    return render(
        "viewers/scene/page/chart.html.j2",
        **{"left_px": LEFT_INSET_PX, "right_px": RIGHT_INSET_PX, "chart_height_px": chart_height_px},
        **{"width": _WIDTH, "height": _HEIGHT},
        **{"bar_height_px": BAR_ROW_HEIGHT_PX, "operable": operable, "seconds": seconds},
        rows=[
            {"name": row.name, "meaning": BARS[row.bars[0].kind], "bars": [_bar(bar, seconds, fps) for bar in row.bars]}
            for row in rows
        ],
        titles=[(title, _Look(_colour(index))) for index, (title, _) in enumerate(subjects)] if several else [],
        ticks=[
            {"x": _x(tick, seconds), "left": f"{100 * tick / seconds:.3f}", "text": f"{tick:g}"}
            for tick in _ticks(seconds)
        ],
        charts=[
            _chart(group, curves, seconds, several, largest_points)
            for group, curves in groups.items()
            if any(np.isfinite(curve.values).any() for _, curve in curves)
        ],
    )


def _bar(bar: Bar, seconds: float, fps: float) -> dict[str, Any]:
    """Return a bar's place as shares of the time axis; it is as wide as one frame at least."""
    when = f"{bar.start:.2f} to {bar.stop:.2f} s" if bar.stop > bar.start else f"{bar.start:.2f} s"
    share = max(bar.stop - bar.start, 0.5 / fps) / seconds
    return {"at": bar.start / seconds, "share": share, "kind": bar.kind, "text": f"{bar.text}, {when}"}


def _chart(
    group: str, curves: Sequence[tuple[int, Curve]], seconds: float, several: bool, largest_points: int
) -> dict[str, Any]:
    """Return what the template draws of a group of curves, each with the number of its result."""
    names = list(dict.fromkeys(curve.name for _, curve in curves))
    low, high = _range([curve.values for _, curve in curves])

    def look(name: str, colour: str) -> _Look:
        number = names.index(name)
        return _Look(colour, _DASHES[number % len(_DASHES)]) if several else _Look(_colour(number))

    drawn = [
        {
            "d": _path(values, curve.fps, seconds, low, high, largest_points),
            "look": look(curve.name, _colour(index)),
            "width": width,
            # Of a curve that is drawn twice, the first time tells all its values.
            "name": f"{curve.name.replace('_', ' ')} {index}" if number == 0 else "",
        }
        for index, curve in curves
        for number, (values, width) in enumerate(_passes(curve))
    ]
    return {
        "group": group,
        "meaning": CURVES[group][0] if group in CURVES else "",
        "worst": _worst(group, [curve for _, curve in curves]),
        "unit": curves[0][1].unit,
        "low": f"{low:g}",
        "high": f"{high:g}",
        "zero": f"{_HEIGHT * high / (high - low):.0f}",
        "paths": [stroke for stroke in drawn if stroke["d"]],
        # Of several results, the legend tells the dashes; the colours stand above all charts.
        "legend": {name.replace("_", " "): look(name, "#444") for name in names},
        "indices": list(dict.fromkeys(index for index, _ in curves)),
    }


def _worst(group: str, curves: Sequence[Curve]) -> dict[str, Any] | None:
    """Return the moment in which the worst of some curves is at its worst, in words too."""
    found = []
    for curve in curves:
        frame = worst_frame(group, curve.values, curve.counted)
        if frame is not None:
            found.append((float(badness(group, curve.values[frame : frame + 1])[0]), frame, curve))
    if not found:
        return None
    _, frame, curve = max(found, key=lambda item: item[0])
    second = frame / curve.fps
    text = f"{curve.name.replace('_', ' ')} {curve.values[frame]:.3g} {with_exponents(curve.unit)} at {second:.2f} s"
    return {"second": f"{second:.4f}", "text": text}


def _colour(number: int) -> str:
    return _COLOURS[number % len(_COLOURS)]


def _passes(curve: Curve) -> Iterator[tuple[Float[np.ndarray, "T"], float]]:
    """Yield the strokes of a curve and their widths [px]: counted frames are drawn over it once more."""
    if curve.counted is None:
        yield curve.values, 1.4
    else:
        yield curve.values, 0.7
        yield np.where(curve.counted, curve.values, np.nan), 2.0


def _path(  # noqa: PLR0913, PLR0917 - a curve and its axes
    values: Float[np.ndarray, "T"], fps: float, seconds: float, low: float, high: float, largest_points: int
) -> str:
    """Return a curve as the commands of an SVG path."""
    strokes = []
    for frames in _strokes(values, largest_points):
        heights = _HEIGHT * (high - values[frames]) / (high - low)
        points = [f"{_x(frame / fps, seconds)} {height:.0f}" for frame, height in zip(frames, heights, strict=True)]
        # A number alone is a stroke of no length, which round ends make a dot.
        strokes.append(f"M{points[0]}{'h0' if len(points) == 1 else 'L'}{' '.join(points[1:])}")
    return "".join(strokes)


def _strokes(values: Float[np.ndarray, "T"], largest_points: int) -> Iterator[Int[np.ndarray, "_"]]:
    """Yield the frames that are joined: runs of numbers, or the extremes of equal stretches of a long curve."""
    there = np.isfinite(values)
    if len(values) <= largest_points:
        yield from (np.arange(first, stop) for first, stop in runs(there))
        return
    stretches = np.array_split(np.arange(len(values)), largest_points // 2)
    inhabited = [stretch[there[stretch]] for stretch in stretches]
    for first, stop in runs(np.array([len(frames) > 0 for frames in inhabited])):
        extremes = [
            (frames[values[frames].argmin()], frames[values[frames].argmax()]) for frames in inhabited[first:stop]
        ]
        yield np.unique(extremes)


def _range(values: Sequence[Float[np.ndarray, "_"]]) -> tuple[float, float]:
    """Return round numbers around all values and zero."""
    everything = np.concatenate([each[np.isfinite(each)] for each in values])
    low, high = 0.0 - _round_up(-everything.min(), _ROUND_NUMBERS), _round_up(everything.max(), _ROUND_NUMBERS)
    return (low, high) if high > low else (low, 1.0)


def _round_up(number: float, mantissas: Float[np.ndarray, "_"]) -> float:
    if number <= 0.0:
        return 0.0
    power = 10.0 ** np.floor(np.log10(number))
    # Ten times the power itself is always enough, but for rounding.
    return float(power * mantissas[min(np.searchsorted(mantissas, number / power), len(mantissas) - 1)])


def _ticks(seconds: float) -> tuple[float, ...]:
    step = _round_up(seconds / _LARGEST_TICKS, _ROUND_STEPS)
    return tuple(float(number * step) for number in range(int(seconds / step + 1e-9) + 1))


def _x(second: float, seconds: float) -> int:
    return round(_WIDTH * second / seconds)
