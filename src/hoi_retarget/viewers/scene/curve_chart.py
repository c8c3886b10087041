"""Curves over time as a fragment of HTML: small charts above each other that share the time axis.

The plotting area begins `LEFT_INSET_PX` from the fragment's left edge and ends `RIGHT_INSET_PX` from its
right one, however wide the page: frame 0 lies on the one, the last frame on the other. Lines are
stretched with the page, text is not.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.numerics.arrays import runs
from hoi_retarget.viewers.scene.curves import Curve

LEFT_INSET_PX = 132
RIGHT_INSET_PX = 160
CHART_HEIGHT_PX = 32
TITLES_HEIGHT_PX = 19
"""Of the line that names several results."""
LARGEST_POINTS = 1500
"""Points of one curve; of longer ones the smallest and the largest number of every stretch is drawn."""

_WIDTH, _HEIGHT = 4000, 400  # Units of the drawings, which are stretched to the page.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
_DASHES = ("", "5 3", "1.5 2.5", "7 2.5 1.5 2.5")
_ROUND_NUMBERS = np.array([1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
_ROUND_STEPS = np.array([1.0, 2.0, 5.0, 10.0])
_LARGEST_TICKS = 12

_STYLE = f"""
.curves {{ font: 11px/1.25 system-ui, sans-serif; color: #222; background: #fff; padding-top: 5px; }}
.curves .chart {{ display: flex; margin-bottom: 5px; }}
.curves .what {{ width: {LEFT_INSET_PX - 36}px; box-sizing: border-box; padding-left: 8px; font-weight: 600; }}
.curves .what span {{ display: block; font-weight: 400; font-size: 10px; color: #666; }}
.curves .range {{ width: 36px; box-sizing: border-box; padding-right: 5px; display: flex; flex-direction: column;
  justify-content: space-between; text-align: right; font-size: 10px; line-height: 10px; color: #666;
  font-variant-numeric: tabular-nums; }}
.curves .plot {{ flex: 1; min-width: 0; }}
.curves svg {{ display: block; width: 100%; height: 100%; overflow: visible; }}
.curves path {{ fill: none; vector-effect: non-scaling-stroke; stroke-linejoin: round; stroke-linecap: round; }}
.curves .legend {{ width: {RIGHT_INSET_PX}px; box-sizing: border-box; padding-left: 8px; display: grid;
  grid-template-columns: 1fr 1fr; align-content: center; gap: 1px 4px; font-size: 10px; color: #444; }}
.curves .key {{ display: flex; align-items: center; gap: 4px; white-space: nowrap; }}
.curves .key svg {{ width: 14px; height: 6px; flex: none; }}
.curves .titles {{ display: flex; flex-wrap: wrap; gap: 2px 18px;
  padding: 0 {RIGHT_INSET_PX}px 5px {LEFT_INSET_PX}px; }}
.curves .time {{ position: relative; height: 14px; margin: -2px {RIGHT_INSET_PX}px 0 {LEFT_INSET_PX}px; font-size: 10px;
  color: #666; }}
.curves .time span {{ position: absolute; transform: translateX(-50%); }}
.curves .time i {{ position: absolute; left: calc(100% + 6px); font-style: normal; }}
"""


@dataclass(frozen=True)
class _Line:
    """One curve as it is drawn."""

    curve: Curve
    colour: str
    dash: str


def chart_html(
    subjects: Sequence[tuple[str, tuple[Curve, ...]]], fps: float, *, chart_height_px: int = CHART_HEIGHT_PX
) -> str:
    """Return the charts of one or several results: a chart a group, curves of all results in it.

    One result's curves differ in colour. Of several results each has a colour, and its curves differ in
    their dashes. Frames that a figure counts are drawn bold, where it counts only some.

    Args:
        subjects: Each result's title and curves.
        fps: Rate of the frames that the time axis is divided into: `Scene.fps` where a scene plays beside it.
        chart_height_px: Of one chart [px].
    """
    seconds = max(((len(curve.values) - 1) / curve.fps for _, curves in subjects for curve in curves), default=0.0)
    # The last frame of the scene, as `Scene.frames` counts.
    seconds = max(round(seconds * fps), 1) / fps
    groups = dict.fromkeys(curve.group for _, curves in subjects for curve in curves)
    parts = [f"<style>{_STYLE}</style>"]
    if len(subjects) > 1:
        keys = [_key(title, colour, "") for (title, _), colour in zip(subjects, _cycle(_COLOURS), strict=False)]
        parts.append(f'<div class="titles">{"".join(keys)}</div>')
    ticks = _ticks(seconds)
    for group in groups:
        lines = list(_lines(subjects, group))
        if any(np.isfinite(line.curve.values).any() for line in lines):
            parts.append(_chart(group, lines, seconds, ticks, chart_height_px, coloured=len(subjects) == 1))
    parts.append(_time_axis(ticks, seconds))
    return f'<div class="curves">{"".join(parts)}</div>'


def _lines(subjects: Sequence[tuple[str, tuple[Curve, ...]]], group: str) -> Iterator[_Line]:
    names = list(dict.fromkeys(curve.name for _, curves in subjects for curve in curves if curve.group == group))
    for index, (_, curves) in enumerate(subjects):
        for curve in curves:
            if curve.group == group:
                number = names.index(curve.name)
                if len(subjects) == 1:
                    yield _Line(curve, _COLOURS[number % len(_COLOURS)], "")
                else:
                    yield _Line(curve, _COLOURS[index % len(_COLOURS)], _DASHES[number % len(_DASHES)])


def _chart(  # noqa: PLR0913 - what a chart is made of
    group: str, lines: Sequence[_Line], seconds: float, ticks: Sequence[float], height_px: int, *, coloured: bool
) -> str:
    low, high = _range([line.curve.values for line in lines])
    upright = "".join(f"M{_x(tick, seconds)} 0V{_HEIGHT}" for tick in ticks)
    zero = _HEIGHT * high / (high - low)
    drawn = [
        f'<path d="{upright}M0 0H{_WIDTH}" stroke="#e6e8eb" stroke-width="1"/>',
        f'<path d="M0 {zero:.0f}H{_WIDTH}" stroke="#9aa0a6" stroke-width="1"/>',
    ]
    for line in lines:
        curve = line.curve
        dash = f' stroke-dasharray="{line.dash}"' if line.dash else ""
        for values, width in _passes(curve):
            path = _path(values, curve.fps, seconds, low, high)
            if path:
                drawn.append(f'<path d="{path}" stroke="{line.colour}" stroke-width="{width}"{dash}/>')
    # Of several results, the legend tells the dashes; the colours stand above all charts.
    looks = {line.curve.name: (line.colour, "") if coloured else ("#444", line.dash) for line in lines}
    keys = "".join(_key(name.replace("_", " "), *look) for name, look in looks.items())
    unit = lines[0].curve.unit.replace("^3", "³")
    return (
        f'<div class="chart" style="height:{height_px}px">'
        f'<div class="what">{escape(group)}<span>{escape(unit)}</span></div>'
        f'<div class="range"><span>{high:g}</span><span>{low:g}</span></div>'
        f'<div class="plot"><svg viewBox="0 0 {_WIDTH} {_HEIGHT}" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape(group)} over time">{"".join(drawn)}</svg></div>'
        f'<div class="legend">{keys if len(looks) > 1 else ""}</div></div>'
    )


def _passes(curve: Curve) -> Iterator[tuple[Float[np.ndarray, "T"], float]]:
    """Yield what is drawn of a curve, and how wide [px]: what counts is drawn over it once more."""
    if curve.counted is None:
        yield curve.values, 1.4
    else:
        yield curve.values, 0.7
        yield np.where(curve.counted, curve.values, np.nan), 2.0


def _path(values: Float[np.ndarray, "T"], fps: float, seconds: float, low: float, high: float) -> str:
    """Return a curve as the commands of an SVG path."""
    strokes = []
    for frames in _strokes(values):
        heights = _HEIGHT * (high - values[frames]) / (high - low)
        points = [f"{_x(frame / fps, seconds)} {height:.0f}" for frame, height in zip(frames, heights, strict=True)]
        # A number alone is a stroke of no length, which round ends make a dot.
        strokes.append(f"M{points[0]}{'h0' if len(points) == 1 else 'L'}{' '.join(points[1:])}")
    return "".join(strokes)


def _strokes(values: Float[np.ndarray, "T"]) -> Iterator[Int[np.ndarray, "_"]]:
    """Yield the frames that are joined: runs of numbers, or the extremes of equal stretches of a long curve."""
    there = np.isfinite(values)
    if len(values) <= LARGEST_POINTS:
        yield from (np.arange(first, stop) for first, stop in runs(there))
        return
    stretches = np.array_split(np.arange(len(values)), LARGEST_POINTS // 2)
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


def _time_axis(ticks: Sequence[float], seconds: float) -> str:
    labels = [f'<span style="left:{100 * tick / seconds:.3f}%">{tick:g}</span>' for tick in ticks]
    return f'<div class="time">{"".join(labels)}<i>s</i></div>'


def _key(text: str, colour: str, dash: str) -> str:
    pattern = f' stroke-dasharray="{dash}"' if dash else ""
    line = f'<path d="M1 3H13" stroke="{colour}" stroke-width="2"{pattern}/>'
    return f'<span class="key"><svg viewBox="0 0 14 6">{line}</svg>{escape(text)}</span>'


def _x(second: float, seconds: float) -> int:
    return round(_WIDTH * second / seconds)


def _cycle(colours: Sequence[str]) -> Iterator[str]:
    while True:
        yield from colours
