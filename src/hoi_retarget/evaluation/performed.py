"""How near is what a simulated robot performed to its reference? Deviations over all frames, up to a fall."""

import numpy as np

from hoi_retarget.evaluation.figure import Figure
from hoi_retarget.motion.motion import SIMULATED, Motion
from hoi_retarget.numerics import se3


def performed_figures(motion: Motion) -> dict[str, float | None]:
    """Return the deviations of a performed motion from the stage before, by name; none of one that was not performed.

    Without objects their deviations are left out.
    """
    if motion.stages[-1].name != SIMULATED or len(motion.stages) == 1:
        return {}
    reference = motion.at_stage(motion.stages[-2].name)
    wanted, found = reference.qpos, motion.qpos
    figures: dict[str, float | None] = {
        "reference_root_m": float(np.linalg.norm(found[:, :3] - wanted[:, :3], axis=1).mean()),
        "reference_root_deg": float(np.degrees(se3.angle_between(found[:, 3:7], wanted[:, 3:7])).mean()),
        "reference_joint_rad": float(np.abs(found[:, 7:] - wanted[:, 7:]).mean()),
    }
    if motion.report.performance is not None:
        figures["stood_s"] = motion.report.performance.seconds
    if motion.object_names:
        apart = np.linalg.norm(motion.object_pos - reference.object_pos, axis=2)
        turned = se3.angle_between(motion.object_quat, reference.object_quat)
        figures |= {"reference_object_m": float(apart.mean()), "reference_object_max_m": float(apart.max())}
        figures["reference_object_deg"] = float(np.degrees(turned).mean())
    return figures


PERFORMED = (
    Figure("reference_object_m", "object off reference", "cm", 1e2, 1, "lower"),
    Figure("reference_object_max_m", "object off reference max", "cm", 1e2, 1, "lower"),
    Figure("reference_object_deg", "object turned off reference", "deg", 1.0, 1, "lower"),
    Figure("reference_root_m", "root off reference", "cm", 1e2, 1, "lower"),
    Figure("reference_root_deg", "root turned off reference", "deg", 1.0, 1, "lower"),
    Figure("reference_joint_rad", "joints off reference", "rad", 1.0, 3, "lower"),
    Figure("stood_s", "time to fall or end", "s", 1.0, 1, "higher"),
)
"""Figures that only a performed motion has."""
