"""How deep links are in other links, of the same robot or of another: skin points of one in the solid of the other."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.evaluation.surface_distances import Poses, least_in_solid, tree_of
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin, skin_of


@dataclass(frozen=True, eq=False)
class PlacedLink:
    """A link over F frames."""

    skin: LinkSkin
    pose: Poses
    centre: Float[np.ndarray, "F 3"]
    """Of the ball around it, in the world [m]."""


def placed_links(kinematics: Kinematics, first: int = 0) -> tuple[PlacedLink, ...]:
    """Return a robot's links that have a skin, from one frame on."""
    poses = [(skin, Poses.of_link(kinematics, skin, first)) for skin in skin_of(kinematics.model).links]
    return tuple(PlacedLink(skin, pose, pose.positions + pose.rotations @ skin.centre) for skin, pose in poses)


def pair_depths(
    ones: Sequence[PlacedLink],
    others: Sequence[PlacedLink],
    pairs: Iterable[tuple[int, int]],
    *,
    keep_all: bool = False,
) -> tuple[Float[np.ndarray, "pairs F"], tuple[tuple[LinkSkin, LinkSkin], ...]]:
    """Return how deep pairs of links are in each other in every frame [m], and their links.

    Args:
        ones: Links of one robot.
        others: Links of the same robot or another, in the same frames.
        pairs: Indices into both.
        keep_all: Whether pairs that are not near in any frame are kept, too.
    """
    depths, kept = [], []
    for pair in pairs:
        one, other = ones[pair[0]], others[pair[1]]
        away = one.centre - other.centre
        near = np.flatnonzero(np.einsum("fi,fi->f", away, away) < (one.skin.radius + other.skin.radius) ** 2)
        if not len(near) and not keep_all:
            continue
        depth = np.zeros(len(away))
        if len(near):
            at_one, at_other = one.pose.at(near), other.pose.at(near)
            depth[near] = np.maximum(
                _in_solid(one.skin, at_one.inside(at_other), other.skin),
                _in_solid(other.skin, at_other.inside(at_one), one.skin),
            )
        depths.append(depth)
        kept.append((one.skin, other.skin))
    return np.reshape(depths, (len(depths), len(ones[0].centre) if ones else 0)), tuple(kept)


def _in_solid(skin: LinkSkin, pose: Poses, solid: LinkSkin) -> Float[np.ndarray, "F"]:
    """Return how deep one link's skin is in another's solid [m], at poses in the other's frame."""
    depth = np.zeros(len(pose.positions))
    near = np.flatnonzero(solid.solid.distances(pose.positions + pose.rotations @ skin.centre) < skin.radius)
    if len(near):
        depth[near] = -least_in_solid(tree_of(skin), solid, pose.at(near))[0]
    return depth
