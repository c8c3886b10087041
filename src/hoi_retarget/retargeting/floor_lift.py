"""The reference of inverse kinematics above the floor where a person sits, kneels or lies.

A robot's trunk and thighs are thicker than a person's skeleton is scaled: inverse kinematics puts them into the floor,
and floor terms alone may roll a robot over that lies on its side. So the whole robot is lifted first.
"""

import numpy as np
from jaxtyping import Float

from hoi_retarget.evaluation.link_heights import link_heights
from hoi_retarget.numerics.filters import slow_cover
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.skin import skin_of

SUNK = 0.02
"""[m]; links that are less deep are pushed out by the trajectory's optimization alone."""


def lifted(model: RobotModel, targets: Targets, qpos: Float[np.ndarray, "T nq"]) -> Float[np.ndarray, "T nq"]:
    """Return a trajectory in which no link but hands and feet is deeper than `SUNK` under the floor.

    It rises and falls slowly. Where nothing is deeper, or a base carries it, it is the same array.
    """
    if targets.base_qpos is not None:
        return qpos
    ends = {model.site_bodies[model.sites.index[site]] for site in targets.contact_links}
    inner = [skin.link not in ends for skin in skin_of(model).links]
    depth = -link_heights(model.forward(qpos))[inner].min(axis=0, initial=0.0)
    if depth.max(initial=0.0) <= SUNK:
        return qpos
    above = qpos.copy()
    above[:, 2] += slow_cover(np.maximum(depth - SUNK, 0.0), targets.fps)
    return above
