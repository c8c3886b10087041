"""An object as contact and clearance see it: distances from its surface, in the frame that moves with it."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from hoi_retarget.numerics import se3
from hoi_retarget.objects.distance_field import DistanceField, distance_field
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.surface_samples import surface_samples
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.retargeting.targets import Targets

SPACING = 0.005
"""Side of the square of surface for which one sample stands [m]."""


@dataclass(frozen=True, eq=False)
class MovingObject:
    """One object of the robot's world over T frames; points are stacked along the last two axes, frames last."""

    name: str
    field: DistanceField
    samples: KDTree
    """Points of the surface, in the object's frame [m]."""
    position: Float[np.ndarray, "3 T"]
    """[m]"""
    rotation: Float[np.ndarray, "3 3 T"]

    def inside(self, points: Float[np.ndarray, "3 K F"], frames: Int[np.ndarray, "F"]) -> Float[np.ndarray, "3 K F"]:
        """Return world points of some frames in the object's frame [m]."""
        offset = points - self.position[:, None, frames]
        return np.einsum("jif,jkf->ikf", self.rotation[:, :, frames], offset)

    def distances(self, points: Float[np.ndarray, "3 *many"]) -> Float[np.ndarray, "*many"]:
        """Return the distances from the surface [m] of points in the object's frame."""
        return self.field.distances(points.reshape(3, -1).T).reshape(points.shape[1:])

    def distances_and_normals(
        self, points: Float[np.ndarray, "3 *many"]
    ) -> tuple[Float[np.ndarray, "*many"], Float[np.ndarray, "3 *many"]]:
        """Return these distances and the directions, in the object's frame, in which they grow."""
        distances, normals = self.field.distances_and_normals(points.reshape(3, -1).T)
        return distances.reshape(points.shape[1:]), normals.T.reshape(points.shape)


def moving_objects(targets: Targets) -> tuple[MovingObject, ...]:
    """Return the objects of a robot's targets; raises `GeometryError` when a mesh cannot be read."""
    rotations = se3.quat_to_matrix(targets.object_quat).transpose(1, 2, 3, 0)
    return tuple(
        MovingObject(
            name,
            *_shape_of(geometry, float(targets.object_scale[index])),
            targets.object_pos[:, index].T,
            rotations[index],
        )
        for index, (name, geometry) in enumerate(zip(targets.object_names, targets.object_geometry, strict=True))
    )


@lru_cache(maxsize=16)
def _shape_of(geometry: ObjectGeometry, scale: float) -> tuple[DistanceField, KDTree]:
    """Return the distances and samples of an object's surface at another size; geometries are known by identity."""
    samples = surface_samples(surface_of(geometry), SPACING / scale)
    return distance_field(geometry).scaled(scale), KDTree(scale * samples)
