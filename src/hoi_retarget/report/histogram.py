"""Histogram of one figure over all motions, as a small picture with its thresholds."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from hoi_retarget.evaluation.thresholds import Level, Threshold
from hoi_retarget.viewers.html import render

WIDTH, HEIGHT = 264, 124  # [px]
_LEFT, _RIGHT, _TOP, _BOTTOM = 6, 6, 18, 18  # Around the bars [px].
_BINS = 24
_FARTHEST = 4.0  # Fail thresholds; what lies beyond is counted in the last bin.
_ROOM = 1.04  # Between the last value and the edge.


def histogram(threshold: Threshold, values: Sequence[float]) -> str:
    """Return an SVG element: a bar is as long as the number of motions, coloured by how good they are.

    Args:
        threshold: The figure.
        values: Of each motion, in stored units; at least one.
    """
    sign = 1.0 if threshold.column.better == "lower" else -1.0
    low, high, labels = _axis(threshold, sign, values)

    def share(value: float) -> float:
        return float(np.clip((sign * value - low) / (high - low), 0.0, 1.0))

    bins = [min(_BINS - 1, int(share(value) * _BINS)) for value in values]
    counts = np.zeros((_BINS, len(Level)), dtype=int)
    np.add.at(counts, (bins, [threshold.level(value) for value in values]), 1)
    limits = {Level.WARN: threshold.warn, Level.FAIL: threshold.fail}
    shares = {level: share(limit) for level, limit in limits.items() if limit is not None}
    return render(
        "report/page/histogram.svg.j2",
        header=threshold.column.header,
        **{"width": WIDTH, "height": HEIGHT, "top": _TOP, "base": HEIGHT - _BOTTOM},
        **{"left": _LEFT, "right": WIDTH - _RIGHT, "low": labels[0], "high": labels[1]},
        **{"figure": threshold.name, "better": threshold.column.better},
        bars=_bars(counts, lambda number: sign * (low + number / _BINS * (high - low))),
        marks=[
            {"level": level, "x": _x(along), "side": "end" if along > 0.5 else ""}
            for level, along in shares.items()
            if along < 1.0
        ],
    )


def _axis(threshold: Threshold, sign: float, values: Sequence[float]) -> tuple[float, float, tuple[str, str]]:
    """Return the ends of the axis, good values at the left, and what they are labelled; the bad end may be cut."""
    worse = sign * np.array(values)
    warn, fail = sign * threshold.warn, threshold.fail
    low, high = min(float(worse.min()), warn, 0.0), max(float(worse.max()), warn)
    beyond = ""
    if fail is not None and high > warn:
        farthest = _FARTHEST * sign * fail
        beyond = " and beyond" if high > farthest > 0 else ""
        high = farthest if beyond else max(high, sign * fail)
    high = low + _ROOM * (high - low) if high > low else low + 1.0
    first, last = (f"{float(f'{threshold.column.scale * sign * end + 0.0:.3g}'):g}" for end in (low, high))
    return low, high, (first, last + beyond)


def _x(share: float) -> float:
    return _LEFT + share * (WIDTH - _LEFT - _RIGHT)


def _bars(counts: np.ndarray, value: Callable[[int], float]) -> Iterator[dict[str, Any]]:
    step = (_x(1.0) - _x(0.0)) / _BINS
    room, tallest = HEIGHT - _TOP - _BOTTOM, counts.sum(axis=1).max()
    for number, of_levels in enumerate(counts):
        base = float(HEIGHT - _BOTTOM)
        # The first bin and the last one hold all that is beyond them.
        ends = (value(number) if number else None, value(number + 1) if number + 1 < _BINS else None)
        for level in Level:
            if of_levels[level]:
                height = max(2.0, room * of_levels[level] / tallest)
                base -= height
                yield {
                    "level": level,
                    "x": _x(0.0) + number * step,
                    "y": base,
                    "width": step - 1,
                    "height": height,
                    "ends": ends,
                }
