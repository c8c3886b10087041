"""Filters over time: captures jitter and labels switch from frame to frame, robots should not."""

from math import perm

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Bool, Float, Int

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs

SMOOTHING_SECONDS, SMOOTHING_ORDER = 11 / 30, 3
COASTING_SECONDS = 0.2  # Of values that go on at the speed that they had.
LIFT_SECONDS = 0.2  # In each direction, of each of two means over time.


def smooth(path: Float[np.ndarray, "T k"], fps: float) -> Float[np.ndarray, "T k"]:
    """Return a path, in its unit, after a Savitzky-Golay filter; one too short for the filter's order as it is."""
    longest = len(path) - 1 + len(path) % 2
    window = min(2 * round(0.5 * (SMOOTHING_SECONDS * fps - 1)) + 1, longest)
    return savitzky_golay(path, window, SMOOTHING_ORDER) if window > SMOOTHING_ORDER else path.copy()


def savitzky_golay(
    path: Float[np.ndarray, "T k"], window: int, order: int, derivative: int = 0, spacing: float = 1.0
) -> Float[np.ndarray, "T k"]:
    """Return a derivative of the polynomials that fit a path best around each frame; at its ends, of the last fits.

    As `scipy.signal.savgol_filter`, which takes a second of CPU to import.

    Args: `path`: at least as long as the window; `window`: frames of a fit, an odd number; `order`: of the polynomials;
    `derivative`: which one; `spacing`: between frames, in the unit of the derivative.
    """
    half, powers = window // 2, np.arange(order + 1)
    places = np.arange(window) - half
    fit = np.linalg.pinv(places[:, None].astype(float) ** powers)
    factors = np.array([perm(int(power), derivative) for power in powers]) / spacing**derivative
    by_coefficient = factors * places[:, None].astype(float) ** np.maximum(powers - derivative, 0)
    weights = by_coefficient @ fit
    found = scipy.ndimage.correlate1d(path, weights[half], axis=0, mode="nearest")
    found[:half] = np.tensordot(weights[:half], path[:window], 1)
    found[len(path) - half :] = np.tensordot(weights[half + 1 :], path[-window:], 1)
    return found


def smooth_quats(quats: Float[np.ndarray, "T 4"], fps: float) -> Float[np.ndarray, "T 4"]:
    """Return rotations (quaternions, wxyz) after the same filter."""
    return se3.quat_normalize(smooth(se3.quat_continuous(quats), fps))


def speeds(path: Float[np.ndarray, "T *batch 3"], fps: float) -> Float[np.ndarray, "T *batch"]:
    """Return the speed of points [m/s], by central differences."""
    return np.linalg.norm(np.gradient(path, axis=0), axis=-1) * fps


def rate_limited_upper_envelope(values: Float[np.ndarray, "T"], fps: float) -> Float[np.ndarray, "T"]:
    """Return values, in their unit, that are nowhere below the given ones, and rise and fall slowly."""
    window = 2 * seconds_to_frames(LIFT_SECONDS, fps) + 1
    # As wide as both means together: these are then nowhere below.
    largest = scipy.ndimage.maximum_filter1d(values, 2 * window - 1)
    return scipy.ndimage.uniform_filter1d(scipy.ndimage.uniform_filter1d(largest, window), window)


def closed_and_opened(active: Bool[np.ndarray, "T"], *, gap: int, shortest: int) -> Bool[np.ndarray, "T"]:
    """Return flags without gaps of up to `gap` frames, and then without runs of fewer than `shortest`."""
    steady = active.copy()
    for first, stop in _inner_runs(~steady):
        if stop - first <= gap:
            steady[first:stop] = True
    for first, stop in _inner_runs(steady):
        if stop - first < shortest:
            steady[first:stop] = False
    return steady


def _inner_runs(active: Bool[np.ndarray, "T"]) -> list[tuple[int, int]]:
    """Return the runs that end within the clip on both sides; others may be longer than their recorded part."""
    return [(first, stop) for first, stop in runs(active) if first > 0 and stop < len(active)]


def nearest_active(active: Bool[np.ndarray, "T"]) -> Int[np.ndarray, "T"]:
    """Return, for every frame, the nearest active one, the earlier of two; some frame must be active."""
    frames = np.flatnonzero(active)
    time = np.arange(len(active))
    after = np.minimum(np.searchsorted(frames, time), len(frames) - 1)
    before = np.maximum(after - 1, 0)
    closer = np.abs(frames[before] - time) <= np.abs(frames[after] - time)
    return np.where(closer, frames[before], frames[after])


def between_known(
    values: Float[np.ndarray, "T k"], known: Bool[np.ndarray, "T"], fps: float
) -> Float[np.ndarray, "T k"]:
    """Return values that are kept in known frames, at least one, and go smoothly from one to the next in all others.

    They leave a known run, and come to one, at its speed, which is lost within `COASTING_SECONDS`.
    """
    filled, coasting = values.copy(), seconds_to_frames(COASTING_SECONDS, fps)
    for first, stop in runs(~known):
        times = np.arange(1.0, stop - first + 1)
        ends = []
        for last, before, away in ((first - 1, first - 2, times), (stop, stop + 1, times[::-1])):
            if 0 <= last < len(known):
                moving = 0 <= before < len(known) and known[before]
                step = values[last] - values[before] if moving else np.zeros_like(values[last])
                ends.append(values[last] + np.outer(coasting * -np.expm1(-away / coasting), step))
        share = least_jerk_step(times / (len(times) + 1))[:, None]
        filled[first:stop] = (1.0 - share) * ends[0] + share * ends[-1]
    return filled


def least_jerk_step(share: Float[np.ndarray, "T"]) -> Float[np.ndarray, "T"]:
    """Return a step from 0 to 1 with least jerk, at rest before a share of 0 and after one of 1."""
    share = np.clip(share, 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def smoothstep_around(active: Bool[np.ndarray, "T"], ramp: int) -> Float[np.ndarray, "T"]:
    """Return shares: 1 in active frames, with a cosine ramp to 0 over `ramp` frames on either side of them."""
    if not active.any():
        return np.zeros(len(active))
    away = np.abs(np.arange(len(active)) - nearest_active(active))
    return 0.5 + 0.5 * np.cos(np.pi * np.minimum(away / (ramp + 1), 1.0))


def seconds_to_frames(seconds: float, fps: float) -> int:
    """Return the number of frames in a duration, at least one."""
    return max(1, round(seconds * fps))
