"""The outer skin of a robot's links: points on it with normals, and the solid that it encloses.

A robot of this package has its skin in a file, made by `tools/make_skins.py` from its maker's meshes; the skin of any
other robot is that of its colliding geometries.
"""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from hoi_retarget.errors import RobotError
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.numerics.distance_grid import DistanceGrid
from hoi_retarget.robots.collision_skin import collision_skins
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.outer_skin import OuterSkin
from hoi_retarget.robots.parts import Frame
from hoi_retarget.robots.skin_file import read_skins, write_skins
from hoi_retarget.robots.user_robots import keep_skin


@dataclass(frozen=True, eq=False)
class LinkSkin:
    """Skin of one link, in the frame of its body."""

    link: str
    """Body."""
    frame: Frame
    points: Float[np.ndarray, "P 3"]
    """In farthest-point order: the first n are a coarser skin [m]."""
    normals: Float[np.ndarray, "P 3"]
    """Outward, of unit length."""
    radii: Float[np.ndarray, "P"]
    """What each point stands for is a ball of this radius [m]; 0 for a point of the skin itself."""
    solid: DistanceGrid

    @cached_property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Centre of a ball around the whole link [m]."""
        return 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))

    @cached_property
    def radius(self) -> float:
        """Radius of that ball [m]."""
        return float((np.linalg.norm(self.points - self.centre, axis=1) + self.radii).max())

    @cached_property
    def extreme_points(self) -> Float[np.ndarray, "H 3"]:
        """Points among which the furthest one in any direction is [m]."""
        try:
            return self.points[ConvexHull(self.points).vertices]
        except (QhullError, ValueError):  # Few points, or all in one plane.
            return self.points


@dataclass(frozen=True, eq=False)
class Skin:
    """Skins of all links of a robot that have a surface."""

    links: tuple[LinkSkin, ...]

    @cached_property
    def by_link(self) -> dict[str, LinkSkin]:
        """Skins by body."""
        return {skin.link: skin for skin in self.links}

    def solid(self, link: str) -> DistanceGrid:
        """Return the distances from a link's outer solid, in the body's frame; raises `RobotError` without one."""
        if link not in self.by_link:
            raise RobotError(f"no skin of the link {link!r}. Links with a skin: {', '.join(self.by_link)}.")
        return self.by_link[link].solid


@lru_cache(maxsize=32)
def skins_from(model: RobotModel, site: str) -> tuple[LinkSkin, ...]:
    """Return the skins of a site's link and of those it carries, such as a hand's; raises what `skin_of` raises."""
    node = model.sites.frames[site].node
    return tuple(link for link in skin_of(model).links if model.supports[node, link.frame.node])


@lru_cache(maxsize=8)
def skin_of(model: RobotModel) -> Skin:
    """Return a robot's skin, computed once per model.

    Raises:
        RobotError: The specification's skin file is missing or damaged, or names links that the robot has not.
    """
    file = model.spec.skin
    skins = read_skins(file) if file is not None else _computed(model)
    frames = model.body_frames.frames
    if unknown := sorted(set(skins) - set(frames)):
        raise RobotError(f"{file}: skins of links that {model.spec.name} has not: {', '.join(unknown)}.")
    return Skin(
        tuple(
            LinkSkin(
                link,
                frames[link],
                frozen(skin.points),
                frozen(skin.normals),
                frozen(np.zeros(len(skin.points))),
                skin.solid,
            )
            for link, skin in skins.items()
        )
    )


def _computed(model: RobotModel) -> Mapping[str, OuterSkin]:
    skins = collision_skins(model)
    if skins:
        content = io.BytesIO()
        write_skins(content, skins, {})
        keep_skin(model.spec, content.getvalue())
    return skins
