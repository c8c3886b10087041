"""What a robot-motion file is, from its numbers alone, and what contradicts what it claims."""

from hoi_retarget.motion.check.check import Verdict, check
from hoi_retarget.motion.check.finding import Finding
from hoi_retarget.motion.check.objects import ObjectPath
from hoi_retarget.motion.check.trajectory import Trajectory, as_qpos

__all__ = ["Finding", "ObjectPath", "Trajectory", "Verdict", "as_qpos", "check"]
