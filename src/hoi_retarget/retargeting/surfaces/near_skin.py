"""Which points of a link's skin are near an object, found from a coarser skin without asking for all of them."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from hoi_retarget.retargeting.surfaces.moving_object import MovingObject
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin

COARSE = 100
"""Points of the coarser skin."""
SPREAD = 0.01
"""[m]; patches of skin that may hold a point less than this further than the nearest one are looked at closely."""
FAR = 10.0
"""More than any distance of a near point [m]."""


@dataclass(frozen=True, eq=False)
class Patches:
    """A link's skin in patches around the points of a coarser skin."""

    order: Int[np.ndarray, "P"]
    """Points, patch by patch."""
    first: Int[np.ndarray, "C"]
    count: Int[np.ndarray, "C"]
    radius: Float[np.ndarray, "C"]
    """[m]"""
    close: Bool[np.ndarray, "P P"]
    """Which points are too near to each other to be chosen both."""


@lru_cache(maxsize=256)
def patches_of(skin: LinkSkin, apart: float) -> Patches:
    """Return the patches of a skin; points that are less than `apart` from each other [m] are close."""
    points = skin.points
    away, patch = KDTree(points[:COARSE]).query(points)
    order = np.argsort(patch, kind="stable")
    count = np.bincount(patch, minlength=min(COARSE, len(points)))
    radius = np.zeros(len(count))
    np.maximum.at(radius, patch, away)
    close = np.linalg.norm(points[:, None] - points[None], axis=2) < apart
    return Patches(order, np.cumsum(count) - count, count, radius, close)


def near_distances(  # noqa: PLR0913, PLR0917 - what decides a distance
    skin: LinkSkin, patches: Patches, thing: MovingObject, start: Kinematics, frames: Int[np.ndarray, "F"], near: float
) -> Float[np.ndarray, "P F"]:
    """Return the distances of the nearest skin points from an object [m]; `FAR` for points that are not looked at."""
    distances = np.full((len(skin.points), len(frames)), FAR)
    if not frames.size:
        return distances
    rough = _distances(skin, thing, start, frames, *np.indices((len(patches.count), len(frames))).reshape(2, -1))
    rough = rough.reshape(len(patches.count), len(frames))
    closely = rough - patches.radius[:, None] < np.minimum(rough.min(axis=0) + SPREAD, near)
    patch, column = np.nonzero(closely)
    count = patches.count[patch]
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    point = patches.order[np.repeat(patches.first[patch], count) + within]
    column = np.repeat(column, count)
    distances[point, column] = _distances(skin, thing, start, frames, point, column)
    return distances


def _distances(  # noqa: PLR0913, PLR0917 - as above
    skin: LinkSkin, thing: MovingObject, start: Kinematics, frames: np.ndarray, point: np.ndarray, column: np.ndarray
) -> Float[np.ndarray, "N"]:
    """Return the distance of single points in single frames [m]."""
    # The link's pose in the object's frame, frame by frame, then once for each point.
    rotation = np.einsum("jit,jkt->tik", thing.rotation[:, :, frames], start.orientation(skin.frame)[:, :, frames])
    origin = thing.inside(start.point(skin.frame)[:, None, frames], frames)[:, 0].T
    places = np.einsum("nij,nj->ni", rotation[column], skin.points[point]) + origin[column]
    return thing.field.distances(places)


def nearest_spread(distances: Float[np.ndarray, "P F"], patches: Patches, count: int) -> Int[np.ndarray, "K F"]:
    """Return, in every frame, the point with the least distance, then the next one that is not close to these, ..."""
    # Most of a skin is never looked at.
    seen = np.flatnonzero((distances < FAR).any(axis=1))
    seen = seen if seen.size else np.arange(min(count, len(distances)))
    left, close, chosen = distances[seen], patches.close[np.ix_(seen, seen)], []
    for _ in range(min(count, len(seen))):
        chosen.append(left.argmin(axis=0))
        left += np.where(close[:, chosen[-1]], FAR, 0.0)
    return seen[np.array(chosen)]
