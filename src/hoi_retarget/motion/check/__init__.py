"""What a robot-motion file is, from its numbers alone, and what contradicts what it claims."""

from hoi_retarget.motion.check.check import CheckedMotion, check, mended
from hoi_retarget.motion.check.convert import ConvertedMotion, as_found, as_qpos
from hoi_retarget.motion.check.finding import Finding
from hoi_retarget.motion.check.ground import FLOOR
from hoi_retarget.motion.check.objects import ObjectPath

__all__ = [
    "FLOOR",
    "CheckedMotion",
    "ConvertedMotion",
    "Finding",
    "ObjectPath",
    "as_found",
    "as_qpos",
    "check",
    "mended",
]
