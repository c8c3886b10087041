"""Checks of robot-motion files by their numbers alone: contradictions of the order, units, rate and frames claimed."""

from hoi_retarget.motion.check.check_motion import CheckedMotion as CheckedMotion
from hoi_retarget.motion.check.check_motion import as_qpos as as_qpos
from hoi_retarget.motion.check.check_motion import check as check
from hoi_retarget.motion.check.check_motion import repair as repair
from hoi_retarget.motion.check.finding import FormatFinding as FormatFinding
from hoi_retarget.motion.check.object_checks import ObjectPath as ObjectPath
from hoi_retarget.motion.check.plausibility import FLOOR as FLOOR
