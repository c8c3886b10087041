"""Convex parts of a robot's links, which a simulator collides: their hulls together are near the links' skin.

What touches an object with its skin touches it in simulation, too. The shapes in a robot's MJCF do not: a capsule
around a wrist, or a box for a palm, is up to 25 mm in what the skin only just touches, and throws it.
"""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float

from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.skin import LinkSkin, skin_of, skins_from
from hoi_retarget.robots.spec import PALMS

HAND_PARTS, LINK_PARTS = 10, 3
"""Of a hand that is one link; of a palm with fingers, whose own hulls are 0.7 mm off their skins at most on average."""
_CLUSTERED_CELLS, _MARGIN = 4000, 1e-3  # Cells of a solid that are clustered, so deep [m].
_LEAST_POINTS = 8  # Of a part.

Parts = tuple[Float[np.ndarray, "_ 3"], ...]
"""Corners of each part [m]."""


@lru_cache(maxsize=64)
def convex_parts(skin: LinkSkin, count: int) -> Parts:
    """Return the convex parts of a link, at most so many, in its frame: hulls of clusters of its solid's cells."""
    if count == 1:
        return (_hull(skin.points),) if len(skin.points) > _LEAST_POINTS else ()
    grid = skin.solid
    cells = grid.origin + grid.step * np.argwhere(grid.values < -_MARGIN)
    every = max(1, len(cells) // _CLUSTERED_CELLS)
    clusters = min(count, max(1, len(cells) // _LEAST_POINTS))
    centres, _ = scipy.cluster.vq.kmeans2(cells[::every], clusters, minit="++", rng=np.random.default_rng(0))
    points = np.concatenate([skin.points, cells])
    own = scipy.spatial.KDTree(centres).query(points)[1]
    parts = (points[own == number] for number in range(len(centres)))
    return tuple(_hull(part) for part in parts if len(part) > _LEAST_POINTS)


@lru_cache(maxsize=8)
def parts_by_body(model: RobotModel) -> Mapping[str, Parts]:
    """Return the convex parts of each body with a skin, in the body's frame; raises as `skin_of`."""
    hands = {palm: [skin.link for skin in skins_from(model, palm)] for palm in PALMS}
    counts = {links[0]: HAND_PARTS if len(links) == 1 else LINK_PARTS for links in hands.values()}
    found = {}
    for skin in skin_of(model).links:
        body = model.body_frames.frames[skin.link]
        turn = body.rotation.T @ skin.frame.rotation
        place = body.rotation.T @ (skin.frame.position - body.position)
        parts = convex_parts(skin, counts.get(skin.link, 1))
        found[skin.link] = tuple(frozen(corners @ turn.T + place) for corners in parts)
    return found


def _hull(points: Float[np.ndarray, "P 3"]) -> Float[np.ndarray, "_ 3"]:
    return frozen(points[scipy.spatial.ConvexHull(points, qhull_options="QJ").vertices])
