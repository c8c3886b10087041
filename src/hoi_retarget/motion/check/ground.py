"""Findings about the floor and the joints' ranges."""

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.finding import Finding
from hoi_retarget.numerics.arrays import evenly_spaced
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SIDES, SOLE_CORNERS

_FLOATS, _SINKS = 0.06, -0.05
"""The soles of real retargets are at most 5 cm above the floor, and 2 cm below it [m]."""
_FRAMES = 300
_OUTSIDE, _OFTEN = 0.1, 0.1
"""Joints that are this far outside [rad], in this part of the frames."""


def check_floor(model: RobotModel, qpos: Float[np.ndarray, "T nq"]) -> list[Finding]:
    """Return whether the robot stands on z = 0."""
    kinematics = model.forward(qpos[evenly_spaced(len(qpos), _FRAMES)])
    heights = np.min(
        [kinematics.site_position(f"{side}_sole_{corner}")[:, 2] for side in SIDES for corner in SOLE_CORNERS], axis=0
    )
    low, middle = (float(value) for value in np.quantile(heights, [0.05, 0.5]))
    says = f"the lowest sole corner is at {1000 * low:.0f} mm (5 % of frames are lower), median {1000 * middle:.0f} mm"
    if low > _FLOATS:
        advice = f"Lower everything by {low:.3f} m, or say where the floor is."
        return [Finding("contradiction", "floor", "the floor is at z = 0", says, advice, "poses")]
    if middle < _SINKS:
        advice = f"Raise everything by {-middle:.3f} m, or say where the floor is."
        return [Finding("contradiction", "floor", "the floor is at z = 0", says, advice, "poses")]
    return [Finding("ok", "floor", "the floor is at z = 0", says)]


def check_ranges(model: RobotModel, qpos: Float[np.ndarray, "T nq"]) -> list[Finding]:
    """Return which joints are outside their ranges."""
    outside = np.maximum(model.lower - qpos[:, 7:], qpos[:, 7:] - model.upper)
    worst, often = outside.max(axis=0), (outside > _OUTSIDE).mean(axis=0)
    claim = f"the ranges of {model.spec.name}"
    if (worst <= 0.01).all():
        return [Finding("ok", "joint ranges", claim, "all angles are inside")]
    beyond = 100 * (outside > 0.01).mean(axis=0)
    names = [
        f"{model.joint_names[index]} by {np.degrees(worst[index]):.1f} deg in {beyond[index]:.0f} %"
        for index in np.flatnonzero(worst > 0.01)
    ]
    says = f"outside: {'; '.join(names[:6])}" + ("; ..." if len(names) > 6 else "")
    if (often > _OFTEN).any():
        advice = "Is this the robot? Are order, sign and zero of these joints its own?"
        return [Finding("contradiction", "joint ranges", claim, says, advice, "poses")]
    return [Finding("note", "joint ranges", claim, says, "A robot cannot follow; consumers clip.")]
