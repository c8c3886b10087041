"""Poses of links over frames, and the depths of links in each other, of one robot or of two."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.kernels.point_tree import PointTree
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin, skin_of


@dataclass(frozen=True, eq=False)
class RigidPoses:
    """World poses of a link or an object over F frames."""

    positions: Float[np.ndarray, "F 3"]  # [m]
    rotations: Float[np.ndarray, "F 3 3"]

    @classmethod
    def of_link(cls, kinematics: Kinematics, skin: LinkSkin, first: int = 0) -> "RigidPoses":
        """Return the poses of a link from one frame on."""
        rotations = kinematics.orientation(skin.frame).transpose(2, 0, 1)
        return cls(kinematics.point(skin.frame).T[first:], np.ascontiguousarray(rotations[first:]))

    def at(self, frames: Int[np.ndarray, "K"]) -> "RigidPoses":
        """Return the poses in some frames."""
        return RigidPoses(self.positions[frames], self.rotations[frames])

    def relative_to(self, other: "RigidPoses") -> "RigidPoses":
        """Return these poses in the frame of others."""
        back = other.rotations.transpose(0, 2, 1)
        away = np.einsum("fij,fj->fi", back, self.positions - other.positions)
        return RigidPoses(away, back @ self.rotations)

    def placed(self, points: Float[np.ndarray, "F 3"]) -> Float[np.ndarray, "F 3"]:
        """Return the world positions of local points, one a frame [m]."""
        return np.einsum("fij,fj->fi", self.rotations, points) + self.positions

    def points_inside(self, points_world: Float[np.ndarray, "F 3"]) -> Float[np.ndarray, "F 3"]:
        """Return world points, one a frame, in this frame [m] (paper Eq. 1)."""
        return self.vectors_inside((points_world - self.positions)[:, None])[:, 0]

    def vectors_inside(self, vectors_world: Float[np.ndarray, "F K 3"]) -> Float[np.ndarray, "F K 3"]:
        """Return world vectors, K a frame, along these axes, in their unit."""
        return vectors_world @ self.rotations

    def rotations_inside(self, rotations_world: Float[np.ndarray, "F 3 3"]) -> Float[np.ndarray, "F 3 3"]:
        """Return world rotations, one a frame, relative to these."""
        return np.swapaxes(self.rotations, 1, 2) @ rotations_world


@dataclass(frozen=True, eq=False)
class PosedLink:
    """A link over F frames."""

    skin: LinkSkin
    pose: RigidPoses
    centre: Float[np.ndarray, "F 3"]  # Of the ball around it, in the world [m].


def posed_links(kinematics: Kinematics, first: int = 0) -> tuple[PosedLink, ...]:
    """Return a robot's links that have a skin, from one frame on."""
    poses = [(skin, RigidPoses.of_link(kinematics, skin, first)) for skin in skin_of(kinematics.model).links]
    return tuple(PosedLink(skin, pose, pose.positions + pose.rotations @ skin.centre) for skin, pose in poses)


def pair_depths(
    ones: Sequence[PosedLink], others: Sequence[PosedLink], pairs: Iterable[tuple[int, int]], *, keep_all: bool = False
) -> tuple[Float[np.ndarray, "pairs F"], tuple[tuple[LinkSkin, LinkSkin], ...]]:
    """Return the depths of pairs of links in each other in every frame [m], and their links.

    `ones`: links of one robot; `others`: links of the same robot or another, in the same frames; `pairs`: indices into
    both; `keep_all`: whether pairs that are not near in any frame are returned, too.
    """
    depths, links = [], []
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
                _in_solid(one.skin, at_one.relative_to(at_other), other.skin),
                _in_solid(other.skin, at_other.relative_to(at_one), one.skin),
            )
        depths.append(depth)
        links.append((one.skin, other.skin))
    return np.reshape(depths, (len(depths), len(ones[0].centre) if ones else 0)), tuple(links)


def _in_solid(skin: LinkSkin, pose: RigidPoses, solid: LinkSkin) -> Float[np.ndarray, "F"]:
    """Return the depth of one link's skin in another's solid [m], at poses in the other's frame."""
    depth = np.zeros(len(pose.positions))
    near = np.flatnonzero(solid.solid.distances(pose.positions + pose.rotations @ skin.centre) < skin.radius)
    if len(near):
        depth[near] = -least_in_solid(tree_of(skin), solid, pose.at(near))[0]
    return depth


def robot_depths(
    one: Kinematics, other: Kinematics
) -> tuple[Float[np.ndarray, "pairs T"], tuple[tuple[LinkSkin, LinkSkin], ...]]:
    """Return the depths of links of two robots in each other in every frame [m], for pairs that ever are near."""
    ones, others = posed_links(one), posed_links(other)
    return pair_depths(ones, others, product(range(len(ones)), range(len(others))))


@lru_cache(maxsize=256)
def tree_of(skin: LinkSkin) -> PointTree:
    """Return all points of a link's skin as a tree."""
    return PointTree.of(skin.points)


def least_in_solid(
    tree: PointTree, skin: LinkSkin, pose: RigidPoses, scale: float = 1.0
) -> tuple[Float[np.ndarray, "F"], Float[np.ndarray, "F 3"]]:
    """Return the least signed distance of points from a link's solid, over the scale, at most 0, and the point [m].

    Where none is inside, the point is the origin.

    `tree`: points of another link, or of an object at captured size; `skin`: the link's; `pose`: poses of the points'
    owner in the link's frame; `scale`: size of the object over captured size.
    """
    found = tree.nearest(skin.solid.compiled, pose.rotations, pose.positions / scale, limit=0.0, scale=1.0 / scale)
    least, points = np.zeros(len(pose.positions)), np.zeros((len(pose.positions), 3))
    np.minimum.at(least, found.place, found.lower)
    deepest = (found.lower == least[found.place]) & (found.lower < 0.0)
    points[found.place[deepest]] = tree.points[found.point[deepest]]
    return least, points
