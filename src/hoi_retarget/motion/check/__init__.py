"""Checks of robot-motion files by their numbers alone: contradictions of the order, units, rate and frames claimed."""

from hoi_retarget.motion.check.check_motion import CheckedMotion, as_qpos, check, repair
from hoi_retarget.motion.check.finding import FormatFinding
from hoi_retarget.motion.check.object_checks import ObjectPath
from hoi_retarget.motion.check.plausibility import FLOOR

__all__ = [
    "FLOOR",
    "CheckedMotion",
    "FormatFinding",
    "ObjectPath",
    "as_qpos",
    "check",
    "repair",
]
