"""Findings about the floor and the joints' ranges."""

from collections.abc import Iterator, Sequence

import numpy as np

from hoi_retarget.motion.check.change import Change
from hoi_retarget.motion.check.finding import Finding
from hoi_retarget.motion.check.objects import ObjectPath
from hoi_retarget.motion.check.plausibility import soles
from hoi_retarget.motion.check.surroundings import Surroundings
from hoi_retarget.numerics.arrays import evenly_spaced

_FLOATS, _SINKS = 0.06, -0.05
"""The soles of real retargets are at most 5 cm above the floor, and 2 cm below it [m]."""
_STILL, _REACH, _PART_OF_HEIGHT, _ABOVE = 0.01, 1.0, 0.5, 0.1
"""What carries: it moves less [m], a foot comes that near [m], and its origin is between this part of the soles' height
and so much above it [m]."""
FLOOR, _AT_ZERO = "floor", "the floor is at z = 0"
_FRAMES = 300
_OUTSIDE, _OFTEN = 0.1, 0.1
"""Joints that are this far outside [rad], in this part of the frames."""


def check_floor(around: Surroundings, objects: Sequence[ObjectPath]) -> Iterator[Finding]:
    """Yield whether the robot stands on z = 0, or on an object that never moves."""
    frames = evenly_spaced(len(around.qpos), _FRAMES)
    heights = soles(around.model.forward(around.qpos[frames]))[..., 2].min(axis=(1, 2))
    low, middle = (float(value) for value in np.quantile(heights, [0.05, 0.5]))
    says = f"the lowest sole corner is at {1000 * low:.0f} mm (5 % of frames are lower), median {1000 * middle:.0f} mm"
    if low > _FLOATS and (below := [item for item in objects if _may_carry(item, low, around.qpos)]):
        carriers = ", ".join(f"{item.name} at {item.pos[0, 2]:.2f} m" for item in below)
        says += f"; it may stand on {carriers}, whose shapes are not in the file: cannot be told"
        yield Finding("unknown", FLOOR, _AT_ZERO, says)
    elif low > _FLOATS:
        yield _moved(says, f"Lower everything by {low:.3f} m, or say where the floor is.", -low)
    elif middle < _SINKS:
        yield _moved(says, f"Raise everything by {-middle:.3f} m, or say where the floor is.", -middle)
    else:
        yield Finding("ok", FLOOR, _AT_ZERO, says)


def _moved(says: str, advice: str, by: float) -> Finding:
    return Finding("contradiction", FLOOR, _AT_ZERO, says, advice, "poses", (Change("move", "", (0.0, 0.0, by)),))


def _may_carry(item: ObjectPath, soles_at: float, qpos: np.ndarray) -> bool:
    """Return whether an object that never moves has its origin at the height of the soles or not far below."""
    still = np.ptp(item.pos, axis=0).max() < _STILL
    near = np.linalg.norm(qpos[:, :2] - item.pos[0, :2], axis=1).min() < _REACH
    return bool(still and near and _PART_OF_HEIGHT * soles_at < item.pos[0, 2] < soles_at + _ABOVE)


def check_ranges(around: Surroundings) -> Iterator[Finding]:
    """Yield which joints are outside their ranges."""
    model, qpos = around.model, around.qpos
    outside = np.maximum(model.lower - qpos[:, 7:], qpos[:, 7:] - model.upper)
    worst, often = outside.max(axis=0), (outside > _OUTSIDE).mean(axis=0)
    claim = f"the ranges of {model.spec.name}"
    if (worst <= 0.01).all():
        yield Finding("ok", "joint ranges", claim, "all angles are inside")
        return
    beyond = 100 * (outside > 0.01).mean(axis=0)
    names = [
        f"{model.joint_names[index]} by {np.degrees(worst[index]):.1f} deg in {beyond[index]:.0f} %"
        for index in np.flatnonzero(worst > 0.01)
    ]
    says = f"outside: {'; '.join(names[:6])}" + ("; ..." if len(names) > 6 else "")
    if (often > _OFTEN).any():
        advice = "Is this the robot? Are order, sign and zero of these joints its own?"
        yield Finding("contradiction", "joint ranges", claim, says, advice, "poses")
    else:
        yield Finding("note", "joint ranges", claim, says, "A robot cannot follow; consumers clip.")
