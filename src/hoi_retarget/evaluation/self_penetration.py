"""How deep links of a robot are in each other: skin points of one in the outer solid of another."""

from functools import lru_cache
from itertools import combinations

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.evaluation.link_depths import pair_depths, placed_links
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import skin_of

JOINTS_APART = 2
"""Links with so many joints between them, or fewer, are not looked at: they meet at their joints, as they are built."""
JOINTS_ALONG_LIMB = 3
"""As many where one link carries the other."""
_BUILT_IN = 1e-3
"""Links that are deeper than this in each other [m] in the home pose are built so."""


def self_depths(
    kinematics: Kinematics, first: int = 0
) -> tuple[Float[np.ndarray, "F"], Int[np.ndarray, "F"], tuple[tuple[str, str], ...]]:
    """Return the largest depth [m] of links in each other in every frame, which pair has it, and the pairs.

    Args:
        kinematics: The robot's.
        first: The first frame that counts.
    """
    links = placed_links(kinematics, first)
    depths, near = pair_depths(links, links, looked_at(kinematics.model))
    if not len(depths):
        return np.zeros(len(kinematics.qpos) - first), np.zeros(len(kinematics.qpos) - first, dtype=int), ()
    worst = depths.argmax(axis=0)
    return depths.max(axis=0), worst, tuple((one.link, other.link) for one, other in near)


@lru_cache(maxsize=8)
def looked_at(model: RobotModel) -> tuple[tuple[int, int], ...]:
    """Return the pairs of links that can be in each other, as indices into the skin's links."""
    skin = skin_of(model)
    nodes = [link.frame.node for link in skin.links]
    pairs = [
        (one, other)
        for one, other in combinations(range(len(nodes)), 2)
        if _far_apart(model.supports, nodes[one], nodes[other])
    ]
    home = placed_links(model.forward(model.home_qpos[None]))
    depths, _ = pair_depths(home, home, pairs, keep_all=True)
    return tuple(pair for pair, depth in zip(pairs, depths.max(axis=1, initial=0.0), strict=True) if depth <= _BUILT_IN)


def _far_apart(supports: Float[np.ndarray, "N N"], one: int, other: int) -> bool:
    shared = supports[:, one] * supports[:, other]
    joints = supports[:, one].sum() + supports[:, other].sum() - 2 * shared.sum()
    along = bool(supports[one, other] or supports[other, one])
    return bool(joints > (JOINTS_ALONG_LIMB if along else JOINTS_APART))
