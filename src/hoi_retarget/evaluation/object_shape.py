"""An object's shape as figures look at it: exact triangles, with a distance field and points to find places quickly."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics.point_tree import PointTree
from hoi_retarget.objects.distance_field import SHELL_THICKNESS, DistanceField, distance_field
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.objects.surface_samples import surface_samples
from hoi_retarget.objects.track import ObjectGeometry

_SPACING = 3e-3
"""Square of the surface that a point stands for [m], so that no place is further than 4 mm from one."""
_OUTSIDE, _INSIDE = 0.06, 0.25
"""Shares of a field's distance that it may be off by on either side of the surface, besides its error."""
_FAR, _NEAR = 0.45, 0.02
"""From so far on [m], the distance may be larger than the field's by this share of it."""


@dataclass(frozen=True, eq=False)
class ObjectShape:
    """Distances from one object at captured size [m], negative inside.

    A shell, which has no inside, counts as `SHELL_THICKNESS` thick on both sides of its surface.
    """

    surface: Surface
    field: DistanceField

    @cached_property
    def tree(self) -> PointTree:
        """Points all over the surface."""
        return PointTree.of(surface_samples(self.surface, _SPACING))

    @cached_property
    def radius(self) -> float:
        """Radius of a ball that holds it, where its box has its middle [m]."""
        return 0.5 * float(np.linalg.norm(np.ptp(self.surface.vertices, axis=0)))

    def bounds(self, points: Float[np.ndarray, "K 3"]) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K"]]:
        """Return a lower and an upper bound of the distances of points."""
        found = self.field.distances(points)
        size = np.abs(found)
        share = np.where(found < 0.0, _INSIDE, _OUTSIDE)
        lower = found - self.field.error - share * size
        return lower, found + self.field.error + np.where(found > _NEAR, _FAR, share) * size

    def distances(
        self, points: Float[np.ndarray, "K 3"], lower: Float[np.ndarray, "K"], upper: Float[np.ndarray, "K"]
    ) -> Float[np.ndarray, "K"]:
        """Return the exact distances of points from the triangles, of which `bounds` are known."""
        away = self.surface.distances(points)
        if self.field.shell:
            return away - SHELL_THICKNESS
        inside = upper < 0.0
        unsure = ~inside & (lower < 0.0)
        inside[unsure] = self.surface.encloses(points[unsure], away[unsure])
        return np.where(inside, -away, away)


ObjectSurface = Literal["solid", "shell", "hull"]
"""What stands for an object's surface: one that has an inside, one that has none, or the convex hull of its points."""


def surface_kind(geometry: ObjectGeometry) -> ObjectSurface:
    """Return what stands for an object's surface; raises `GeometryError` when its mesh cannot be read."""
    path = geometry.mesh_path
    # Data sets whose objects are known by points alone come with meshes of their hulls.
    if not surface_of(geometry).exact or (path is not None and path.stem.endswith("_hull")):
        return "hull"
    return "shell" if distance_field(geometry).shell else "solid"


@lru_cache(maxsize=8)
def shape_of(geometry: ObjectGeometry) -> ObjectShape:
    """Return an object's shape, made once; raises `GeometryError` when its mesh cannot be read."""
    return ObjectShape(surface_of(geometry), distance_field(geometry))
