"""Histogram of one figure over all motions, as a small picture with its thresholds."""

from collections.abc import Iterator, Sequence
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
    axis = _Axis(threshold, values)
    levels = [threshold.level(value) for value in values]
    bins = [axis.bin_of(value) for value in values]
    counts = np.zeros((_BINS, len(Level)), dtype=int)
    np.add.at(counts, (bins, levels), 1)
    limits = {Level.WARN: threshold.warn, Level.FAIL: threshold.fail}
    low, high = axis.labels()
    return render(
        "report/page/histogram.svg.j2",
        header=threshold.column.header,
        **{"width": WIDTH, "height": HEIGHT, "top": _TOP, "base": HEIGHT - _BOTTOM},
        **{"left": _LEFT, "right": WIDTH - _RIGHT, "low": low, "high": high},
        bars=_bars(counts),
        marks=[
            _mark(level, axis.share(limit))
            for level, limit in limits.items()
            if limit is not None and axis.share(limit) < 1.0
        ],
    )


class _Axis:
    """Axis of a histogram, good values at the left; its bad end may be cut."""

    def __init__(self, threshold: Threshold, values: Sequence[float]) -> None:
        self._column = threshold.column
        self._sign = 1.0 if threshold.column.better == "lower" else -1.0
        worse = self._sign * np.array(values)
        warn, fail = self._sign * threshold.warn, threshold.fail
        self._low = min(float(worse.min()), warn, 0.0)
        high = max(float(worse.max()), warn)
        self.cut = False
        if fail is not None and high > warn:
            farthest = _FARTHEST * self._sign * fail
            self.cut = high > farthest > 0
            high = farthest if self.cut else max(high, self._sign * fail)
        self._high = self._low + _ROOM * (high - self._low) if high > self._low else self._low + 1.0

    def share(self, value: float) -> float:
        """Return how far along the axis a value lies, from 0 to 1, with the good ones at the left."""
        return float(np.clip((self._sign * value - self._low) / (self._high - self._low), 0.0, 1.0))

    def bin_of(self, value: float) -> int:
        return min(_BINS - 1, int(self.share(value) * _BINS))

    def labels(self) -> tuple[str, str]:
        low, high = (
            f"{float(f'{self._column.scale * self._sign * end + 0.0:.3g}'):g}" for end in (self._low, self._high)
        )
        return low, f"{high} and beyond" if self.cut else high


def _x(share: float) -> float:
    return _LEFT + share * (WIDTH - _LEFT - _RIGHT)


def _bars(counts: np.ndarray) -> Iterator[dict[str, Any]]:
    step = (_x(1.0) - _x(0.0)) / _BINS
    room, tallest = HEIGHT - _TOP - _BOTTOM, counts.sum(axis=1).max()
    for number, of_levels in enumerate(counts):
        base = float(HEIGHT - _BOTTOM)
        for level in Level:
            if of_levels[level]:
                height = max(2.0, room * of_levels[level] / tallest)
                base -= height
                yield {"level": level, "x": _x(0.0) + number * step, "y": base, "width": step - 1, "height": height}


def _mark(level: Level, share: float) -> dict[str, Any]:
    return {"level": level, "x": _x(share), "side": "end" if share > 0.5 else ""}
