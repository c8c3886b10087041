"""The robot's motion as a file was found to hold it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.interpretation import Interpretation
from hoi_retarget.motion.formats import Convention
from hoi_retarget.robots.model import RobotModel


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The robot's motion, and how poses of objects about it are to be read."""

    model: RobotModel
    qpos: Float[np.ndarray, "T nq"]
    reading: Interpretation
    convention: Convention
    fps: float
