"""Arrays inside frozen objects: copied once, then read-only, with shapes and numbers checked."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.errors import ClipError

REPEATED = 1e-7  # A frame in which no number changes by more than this [m, rad, 1] repeats the one before it.


def frozen(values: Any, dtype: Any = float) -> np.ndarray:
    """Return a read-only, contiguous copy of `values`."""
    array = np.array(values, dtype=dtype, order="C")
    array.setflags(write=False)
    return array


def check_shape(owner: str, name: str, array: np.ndarray, expected: tuple[int, ...]) -> None:
    """Raise `ClipError` unless an array has the expected shape; it is told by its name and owner."""
    if array.shape != expected:
        raise ClipError(f"{owner}: {name} has shape {array.shape}, expected {expected}.")


def check_finite(owner: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Raise `ClipError` naming the first frames (axis 0) in which a number is not finite."""
    for name, array in arrays.items():
        bad = ~np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
        if bad.any():
            raise ClipError(f"{owner}: {name} is not finite in {describe_frames(np.flatnonzero(bad))}.")


def describe_frames(frames: np.ndarray) -> str:
    """Return a short text naming frame indices, such as `3 frames (4, 7, 9)`."""
    shown = ", ".join(str(frame) for frame in frames[:5])
    return f"{len(frames)} frame{'s' if len(frames) != 1 else ''} ({shown}{', ...' if len(frames) > 5 else ''})"


def repeated(values: Float[np.ndarray, "T k"]) -> Bool[np.ndarray, "steps"]:
    """Return whether each row from the second on repeats the one before it: no number changes by more than 1e-7."""
    return np.abs(np.diff(values, axis=0)).max(axis=1, initial=0.0) <= REPEATED


def runs(active: Bool[np.ndarray, "T"], shortest: int = 1) -> tuple[tuple[int, int], ...]:
    """Return the contiguous runs of at least `shortest` active frames as (first, one past the last)."""
    edges = np.flatnonzero(np.diff(active.astype(np.int8), prepend=0, append=0))
    return tuple((int(first), int(stop)) for first, stop in edges.reshape(-1, 2) if stop - first >= shortest)


def evenly_spaced(count: int, most: int) -> Int[np.ndarray, "K"]:
    """Return indices from the first to the last of `count`, evenly over them and at most so many."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).astype(int))


def unit_quats(owner: str, name: str, quats: np.ndarray) -> np.ndarray:
    """Return rotations of exactly unit length; raises `ClipError` unless they are close to it."""
    quats = np.asarray(quats, dtype=float)
    check_finite(owner, {name: quats})
    norms = np.linalg.norm(quats, axis=-1)
    # Sources store single precision: anything within 1 % of unit length is rounding, the rest is damage.
    bad = (np.abs(norms - 1.0) > 0.01).any(axis=tuple(range(1, norms.ndim)))
    if bad.any():
        raise ClipError(f"{owner}: {name} are not unit quaternions in {describe_frames(np.flatnonzero(bad))}.")
    return frozen(quats / norms[..., None])
