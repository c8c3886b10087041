"""How deep links of a robot are in each other: skin points of one in the outer solid of another."""

from functools import lru_cache
from itertools import combinations

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.evaluation.surface_distances import Poses, least_in_solid, tree_of
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import LinkSkin, skin_of

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
    depths, near = pair_depths(kinematics, looked_at(kinematics.model), first)
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
    home = model.forward(model.home_qpos[None])
    depths, _ = pair_depths(home, tuple(pairs), keep_all=True)
    return tuple(pair for pair, depth in zip(pairs, depths[:, 0], strict=True) if depth <= _BUILT_IN)


def _far_apart(supports: Float[np.ndarray, "N N"], one: int, other: int) -> bool:
    shared = supports[:, one] * supports[:, other]
    joints = supports[:, one].sum() + supports[:, other].sum() - 2 * shared.sum()
    along = bool(supports[one, other] or supports[other, one])
    return bool(joints > (JOINTS_ALONG_LIMB if along else JOINTS_APART))


def pair_depths(
    kinematics: Kinematics, pairs: tuple[tuple[int, int], ...], first: int = 0, *, keep_all: bool = False
) -> tuple[Float[np.ndarray, "pairs F"], tuple[tuple[LinkSkin, LinkSkin], ...]]:
    """Return how deep pairs of links are in each other [m]; by default only the pairs that are near in some frame.

    Args:
        kinematics: The robot's.
        pairs: Indices into the skin's links.
        first: The first frame that counts.
        keep_all: Whether pairs that are never near are returned, too.
    """
    skin = skin_of(kinematics.model)
    poses = [Poses.of_link(kinematics, link, first) for link in skin.links]
    centres = np.array(
        [pose.positions + pose.rotations @ link.centre for pose, link in zip(poses, skin.links, strict=True)]
    )
    radii = [link.radius for link in skin.links]
    depths, kept = [], []
    for one, other in pairs:
        away = centres[one] - centres[other]
        near = np.flatnonzero(np.einsum("fi,fi->f", away, away) < (radii[one] + radii[other]) ** 2)
        if not len(near) and not keep_all:
            continue
        depth = np.zeros(away.shape[0])
        if len(near):
            at_one, at_other = poses[one].at(near), poses[other].at(near)
            depth[near] = np.maximum(
                _in_solid(skin.links[one], at_one.inside(at_other), skin.links[other]),
                _in_solid(skin.links[other], at_other.inside(at_one), skin.links[one]),
            )
        depths.append(depth)
        kept.append((skin.links[one], skin.links[other]))
    return np.reshape(depths, (-1, len(kinematics.qpos) - first)), tuple(kept)


def _in_solid(skin: LinkSkin, pose: Poses, solid: LinkSkin) -> Float[np.ndarray, "F"]:
    """Return how deep one link's skin is in another's solid [m], at poses in the other's frame."""
    depth = np.zeros(len(pose.positions))
    near = np.flatnonzero(solid.solid.distances(pose.positions + pose.rotations @ skin.centre) < skin.radius)
    if len(near):
        depth[near] = -least_in_solid(tree_of(skin), solid, pose.at(near))[0]
    return depth
