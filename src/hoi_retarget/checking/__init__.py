"""What a robot-motion file is, from its numbers alone, and what contradicts what it claims."""

from hoi_retarget.checking.check import Verdict, check
from hoi_retarget.checking.finding import Finding
from hoi_retarget.checking.objects import ObjectPath
from hoi_retarget.checking.trajectory import Trajectory, as_qpos

__all__ = ["Finding", "ObjectPath", "Trajectory", "Verdict", "as_qpos", "check"]
