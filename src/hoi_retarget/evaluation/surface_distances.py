"""Distances between a robot's skin and objects, frame by frame, both ways: what touches, and what goes through what.

Skin points are measured against the object's triangles, points of the object against each link's solid: a hand that
goes right through a thin board is hardly inside the board, but the board is deep inside the hand. Every frame, every
link and every object is looked at; figures and viewers choose.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.evaluation.object_shape import ObjectShape
from hoi_retarget.numerics.point_tree import Nearest, PointTree
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin

REACH = 0.012
"""An object's points are looked for in links whose skin is at most so far from it [m]: skin points are nearer to each
other, so an object that is in the solid is near one of them, unless all of it is inside."""
FRAMES_AT_ONCE = 500
"""That are measured together: enough for numpy to be quick, and few enough for their points to fit in memory."""


@dataclass(frozen=True, eq=False)
class Poses:
    """World poses of one frame over F frames."""

    positions: Float[np.ndarray, "F 3"]
    """[m]"""
    rotations: Float[np.ndarray, "F 3 3"]

    @classmethod
    def of_link(cls, kinematics: Kinematics, skin: LinkSkin, first: int = 0) -> "Poses":
        """Return the poses of a link from one frame on."""
        rotations = kinematics.orientation(skin.frame).transpose(2, 0, 1)
        return cls(kinematics.point(skin.frame).T[first:], np.ascontiguousarray(rotations[first:]))

    def inside(self, other: "Poses") -> "Poses":
        """Return these poses in the frame of others."""
        back = other.rotations.transpose(0, 2, 1)
        away = np.einsum("fij,fj->fi", back, self.positions - other.positions)
        return Poses(away, back @ self.rotations)

    def at(self, frames: Int[np.ndarray, "K"]) -> "Poses":
        """Return those of some frames."""
        return Poses(self.positions[frames], self.rotations[frames])

    def placed(self, points: Float[np.ndarray, "F 3"]) -> Float[np.ndarray, "F 3"]:
        """Return a point for each frame in the world [m]."""
        return np.einsum("fij,fj->fi", self.rotations, points) + self.positions


@dataclass(frozen=True, eq=False)
class PlacedObject:
    """An object over F frames."""

    shape: ObjectShape
    """At captured size."""
    pose: Poses
    scale: float


@dataclass(frozen=True, eq=False)
class LinkDistances:
    """One link and one object over F frames."""

    skin: Float[np.ndarray, "F"]
    """Least signed distance of the link's skin from the object [m]; infinite where beyond the reach."""
    point: Int[np.ndarray, "F"]
    """Skin point that has it; -1 where there is none."""
    object: Float[np.ndarray, "F"]
    """Least signed distance of the object's points from the link's solid [m], at most 0."""

    @cached_property
    def depth(self) -> Float[np.ndarray, "F"]:
        """How deep one is in the other [m], the larger of both ways; 0 where they are apart."""
        return np.maximum(np.maximum(-self.skin, -self.object), 0.0)

    @property
    def gap(self) -> Float[np.ndarray, "F"]:
        """Least signed distance [m]: off the surface, or how deep one is in the other."""
        return np.where(self.object < 0.0, np.minimum(self.skin, self.object), self.skin)


def link_distances(skin: LinkSkin, link: Poses, placed: PlacedObject, measured: Bool[np.ndarray, "F"]) -> LinkDistances:
    """Return the distances of a link and an object in every frame, in memory that long clips do not grow.

    Args:
        skin: The link's.
        link: World poses of the link.
        placed: The object.
        measured: Frames in which they are measured however far apart they are; in others, what is further than
            `REACH` is infinitely far.
    """
    parts = []
    for start in range(0, len(measured), FRAMES_AT_ONCE):
        frames = np.arange(start, min(start + FRAMES_AT_ONCE, len(measured)))
        there = replace(placed, pose=placed.pose.at(frames))
        parts.append(_link_distances(skin, link.at(frames), there, measured[frames]))
    columns = ([part.skin for part in parts], [part.point for part in parts], [part.object for part in parts])
    return LinkDistances(*map(np.concatenate, columns))


def _link_distances(
    skin: LinkSkin, link: Poses, placed: PlacedObject, measured: Bool[np.ndarray, "F"]
) -> LinkDistances:
    shape, scale = placed.shape, placed.scale
    limit = np.where(measured, np.inf, REACH)
    least, point, sunk = np.full(len(limit), np.inf), np.full(len(limit), -1), np.zeros(len(limit))
    inside = link.inside(placed.pose)
    lower, _ = shape.bounds((inside.positions + inside.rotations @ skin.centre) / scale)
    near = np.flatnonzero(scale * lower - skin.radius <= limit)
    if not len(near):
        return LinkDistances(least, point, sunk)

    def bounds(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = shape.bounds(points / scale)
        return scale * lower, scale * upper

    own, tree = inside.at(near), tree_of(skin)
    found = tree.nearest(own.rotations, own.positions, bounds, limit[near])
    least[near], point[near] = _exact(found, tree, own, shape, scale)
    swallowed = scale * shape.radius <= skin.radius
    hit = near if swallowed else np.flatnonzero(least <= REACH)
    if len(hit):
        # Measured at the object's captured size, as its points are.
        back = placed.pose.at(hit).inside(link.at(hit))
        sunk[hit] = scale * least_in_solid(shape.tree, skin, Poses(back.positions / scale, back.rotations), scale)[0]
    return LinkDistances(least, point, sunk)


def least_in_solid(
    tree: PointTree, skin: LinkSkin, pose: Poses, scale: float = 1.0
) -> tuple[Float[np.ndarray, "F"], Float[np.ndarray, "F 3"]]:
    """Return the least signed distance of points from a link's solid, over the scale, at most 0, and the point.

    Where none is inside, the point is the origin.
    """

    def bounds(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        distances = skin.solid.distances(scale * points) / scale
        return distances, distances

    found = tree.nearest(pose.rotations, pose.positions, bounds, 0.0)
    least, points = np.zeros(len(pose.positions)), np.zeros((len(pose.positions), 3))
    np.minimum.at(least, found.place, found.lower)
    deepest = (found.lower == least[found.place]) & (found.lower < 0.0)
    points[found.place[deepest]] = tree.points[found.point[deepest]]
    return least, points


@lru_cache(maxsize=256)
def tree_of(skin: LinkSkin) -> PointTree:
    """Return all points of a link's skin as a tree."""
    return PointTree.of(skin.points)


def _exact(
    found: Nearest, tree: PointTree, pose: Poses, shape: ObjectShape, scale: float
) -> tuple[Float[np.ndarray, "F"], Int[np.ndarray, "F"]]:
    """Return the exact least distance at each place, and the skin point that has it."""
    least, point = np.full(len(pose.positions), np.inf), np.full(len(pose.positions), -1)
    middle = found.lower + found.upper
    order = np.lexsort((middle, found.place))
    place = found.place[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = place[1:] != place[:-1]
    for batch in (order[first], order[~first]):
        # The one that seems nearest is measured first: it leaves few others to measure.
        chosen = batch[found.lower[batch] < least[found.place[batch]]]
        at, which = found.place[chosen], found.point[chosen]
        placed = np.einsum("kij,kj->ki", pose.rotations[at], tree.points[which]) + pose.positions[at]
        distances = scale * shape.distances(placed / scale, found.lower[chosen] / scale, found.upper[chosen] / scale)
        better = np.argsort(-distances, kind="stable")  # The last one written stays.
        better = better[distances[better] < least[at[better]]]
        least[at[better]], point[at[better]] = distances[better], tree.order[which[better]]
    return least, point
