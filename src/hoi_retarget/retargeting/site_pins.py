"""Pins on a robot's sites: paths through the pinned places and back, with a weight in each frame.

A path is what the site would follow anyway, shifted by what the pin asks for: wholly in the pinned frame, and less and
less before and after it. From one pin to the next that is near, the shift goes straight from the one to the other.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import PosePin
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen, runs
from hoi_retarget.numerics.filters import seconds_to_frames, smoothstep_around

RAMP_SECONDS = 0.3  # On either side of a pin: what a hand needs for a decimetre, there and back, without a jerk.
FLAT = np.array([True, True, False])
"""Directions in which a foot that stands keeps what a pin asks for while it stands; likewise its turn about z."""


@dataclass(frozen=True, eq=False)
class SitePin:
    """The pins of one site; T frames."""

    site: str
    frames: tuple[int, ...]  # That are pinned, of the whole clip.
    turned_frames: tuple[int, ...]  # Those of them in which the rotation is pinned too.
    positions: Float[np.ndarray, "T 3"]  # [m]
    weights: Float[np.ndarray, "T"]  # 1 in pinned frames, fading to 0 around them.
    quats: Float[np.ndarray, "T 4"]
    turn_weights: Float[np.ndarray, "T"]

    def take(self, frames: slice) -> "SitePin":
        """Return some frames of it."""
        return SitePin(
            self.site,
            self.frames,
            self.turned_frames,
            self.positions[frames],
            self.weights[frames],
            self.quats[frames],
            self.turn_weights[frames],
        )


def site_pin(  # noqa: PLR0913  # the parts of a pinned path
    site: str,
    pins: Sequence[PosePin],
    positions: Float[np.ndarray, "T 3"],
    quats: Float[np.ndarray, "T 4"],
    *,
    scale: float,
    stands: Bool[np.ndarray, "T"],
    fps: float,
) -> SitePin:
    """Return the pins of one site.

    Args: `site`: the robot's; `pins`: of the part that it stands for, in the order of time; `positions`: what the site
    would follow [m]; `quats`: likewise its rotation; `scale`: human size to robot size; `stands`: when the site is a
    foot that stands; `fps`: frames a second.
    """
    ramp, frames = seconds_to_frames(RAMP_SECONDS, fps), len(positions)
    places = {pin.frame: scale * np.array(pin.position) - positions[pin.frame] for pin in pins}
    turns = {pin.frame: np.radians(pin.turn) for pin in pins if pin.turn is not None}
    shift = np.where(FLAT, _course(places, stands, ramp), _course(places, np.zeros_like(stands), ramp))
    turn = np.where(FLAT, _course(turns, np.zeros_like(stands), ramp), _course(turns, stands, ramp))
    return SitePin(
        site,
        tuple(places),
        tuple(turns),
        frozen(positions + shift),
        frozen(_weights(places, frames, ramp)),
        frozen(se3.quat_multiply(se3.exp(turn), quats)),
        frozen(_weights(turns, frames, ramp)),
    )


def _course(values: dict[int, np.ndarray], holds: Bool[np.ndarray, "T"], ramp: int) -> Float[np.ndarray, "T 3"]:
    """Return values at frames over all frames: held where it says so, else on the way to the next one, or to zero."""
    frames = len(holds)
    if not values:
        return np.zeros((frames, 3))
    spans = _spans(list(values), runs(holds))
    knots: dict[int, np.ndarray] = {}
    for (first, last), value in zip(spans, values.values(), strict=True):
        before = max(knots, default=first - 2 * ramp)
        if first - before >= 2 * ramp:
            knots |= {before + ramp: np.zeros(3), first - ramp: np.zeros(3)}
        knots |= {first: value, last: value}
    knots[max(knots) + ramp] = np.zeros(3)
    times, heights = np.array(list(knots)), np.stack(list(knots.values()))
    now = np.arange(frames)
    index = np.clip(np.searchsorted(times, now, side="right") - 1, 0, len(times) - 2)
    share = np.clip((now - times[index]) / (times[index + 1] - times[index]), 0.0, 1.0)
    eased = (0.5 - 0.5 * np.cos(np.pi * share))[:, None]
    return heights[index] + eased * (heights[index + 1] - heights[index])


def _spans(frames: Sequence[int], holds: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """Yield the first and last frame in which each value is held: those of two in one run do not meet."""
    for frame in frames:
        first, stop = next((run for run in holds if run[0] <= frame < run[1]), (frame, frame + 1))
        if any(first <= other < frame for other in frames):
            first = frame
        if any(frame < other < stop for other in frames):
            stop = frame + 1
        yield first, stop - 1


def _weights(pinned: dict[int, np.ndarray], frames: int, ramp: int) -> Float[np.ndarray, "T"]:
    """Return weights that are small where the path is still the site's own, which something else may know better."""
    return smoothstep_around(np.isin(np.arange(frames), list(pinned)), ramp) ** 2
