"""Ranges of left and right joints that are no mirror images: axes were mirrored, and limits were not."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.adding.description import finite_range
from hoi_retarget.robots.adding.findings import Finding
from hoi_retarget.robots.adding.zero_pose import ZeroPose

_PARALLEL = 0.95
_APART = 0.2
"""By how much ends of mirrored ranges may differ [rad]."""


def range_findings(
    pose: ZeroPose, left: Sequence[int], right: Sequence[int], leftwards: Float[np.ndarray, "3"]
) -> Iterator[Finding]:
    """Yield the joints of two limbs that do not move alike, with the ranges that would mend either.

    Args:
        pose: The zero pose.
        left: The left limb's joints, from the trunk outwards.
        right: The right limb's.
        leftwards: Across the trunk, of unit length.
    """
    for one, other in zip(left, right, strict=False):
        mirrored = 2.0 * (pose.axes[one] @ leftwards) * leftwards - pose.axes[one]
        same = float(mirrored @ pose.axes[other])
        here, there = _from_zero(pose, one), _from_zero(pose, other)
        if abs(same) < _PARALLEL or here is None or there is None:
            continue
        as_here, as_there = (np.sort(np.sign(same) * ends) for ends in (here, there))
        if np.abs(as_here - there).max() > _APART:
            names = pose.name(one), pose.name(other)
            told = " and ".join(
                f"{name} {lower:.0f} to {upper:.0f} deg"
                for name, (lower, upper) in zip(names, np.degrees([here, there]), strict=True)
            )
            what = f"{told} are no mirror images: one side cannot do what the other does"
            mended = _line(pose, one, as_there), _line(pose, other, as_here)
            hint = "  # or ".join(f"range.{name} = {ends}" for name, ends in zip(names, mended, strict=True))
            yield Finding("warn", "ranges", what, hint)


def _from_zero(pose: ZeroPose, joint: int) -> Float[np.ndarray, "2"] | None:
    ends = finite_range(pose.compiled, joint)
    return None if ends is None else np.array(ends) - _zero(pose, joint)


def _line(pose: ZeroPose, joint: int, from_zero: Float[np.ndarray, "2"]) -> str:
    lower, upper = from_zero + _zero(pose, joint)
    return f"[{lower:.4g}, {upper:.4g}]"


def _zero(pose: ZeroPose, joint: int) -> float:
    return float(pose.compiled.qpos0[pose.compiled.jnt_qposadr[joint]])
