"""Points of a link's skin near a moving object, and rows that hold points at a distance from a surface.

The nearest points are found from a coarser skin first: most of a skin is far from every object.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float, Int

from hoi_retarget.kernels import moving_points
from hoi_retarget.kernels.point_cells import nearest_skin
from hoi_retarget.numerics import se3
from hoi_retarget.objects.distance_field import DistanceField, Region, distance_field, is_large, surface_samples
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.surface_samples import SolidPoses, SurfaceSamples
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.retargeting.trajopt.problem import FrameRows
from hoi_retarget.robots.frames import Frame
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin

LINEAR_BEYOND = 0.03  # [m]
NEAR = 0.03  # [m]; skin that is further away is left out.


def levers(
    kinematics: Kinematics, frame: Frame, points: Float[np.ndarray, "3 K F"], frames: Int[np.ndarray, "F"]
) -> Float[np.ndarray, "3 K F"]:
    """Return the vectors [m], in world axes, from a link's origin to points in its frame.

    `kinematics`: of the trajectory; `frame`: of the link; `points`: in the link's frame [m]; `frames`: frames of the
    trajectory.
    """
    return np.einsum("ijf,jkf->ikf", kinematics.orientation(frame)[:, :, frames], points)


def moments(lever: Float[np.ndarray, "3 K F"], normals: Float[np.ndarray, "3 K F"]) -> Float[np.ndarray, "3 K F"]:
    """Return the derivative of the points' way along the normals by the link's angular velocity [m/rad]."""
    (x, y, z), (a, b, c) = lever, normals
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a])


def hinge_rows(  # noqa: PLR0913, PLR0917  # the parts of rows
    frame: Frame,
    lever: Float[np.ndarray, "3 K F"],
    distances: Float[np.ndarray, "K F"],
    normals: Float[np.ndarray, "3 K F"],
    margin: float | Float[np.ndarray, "K F"],
    weight: float | Float[np.ndarray, "F"],
    frames: Int[np.ndarray, "F"],
) -> FrameRows:
    """Return `weight max(0, margin - distance)^2` of every point, as rows of the link that carries the points.

    Deep inside, beyond `LINEAR_BEYOND`, the cost grows in proportion to the depth: what cannot be got out is not torn.

    Args: `frame`: of the link; `lever`: from the link's origin to the points, in world axes [m]; `distances`: of the
    points [m]; `normals`: world directions in which the distances grow as the points move; `margin`: distance that
    costs nothing [m]; `weight`: [1/m^2]; `frames`: of the rows.
    """
    return FrameRows(frame, *moving_points.hinge(lever, distances, normals, margin, LINEAR_BEYOND), weight, frames)


def softened(
    residual: Float[np.ndarray, "*many"], knee: float
) -> tuple[Float[np.ndarray, "*many"], Float[np.ndarray, "*many"]]:
    """Return residuals of Huber's cost, in their unit, quadratic up to the knee and linear beyond, and their slopes."""
    size = np.abs(residual)
    beyond = size > knee
    root = np.sqrt(np.where(beyond, knee * (2.0 * size - knee), 1.0))
    return np.where(beyond, np.sign(residual) * root, residual), np.where(beyond, knee / root, 1.0)


SPACING = 0.005  # Side of the square of surface for which one sample stands [m].
HELD_SHELL_SPACING = 0.0035
"""The same of a surface without an inside, for holds: only its samples tell that it goes through a hand."""
_REACH = 0.6  # A robot's skin is nearer to its targets [m]: the largest links have a radius of 0.3.


@dataclass(frozen=True, eq=False)
class MovingObject:
    """One object of the robot's world over T frames; points are stacked along the last two axes, frames last."""

    name: str
    field: DistanceField
    samples: SurfaceSamples
    position: Float[np.ndarray, "3 T"]  # [m]
    rotation: Float[np.ndarray, "3 3 T"]

    def inside(self, points: Float[np.ndarray, "3 K F"], frames: Int[np.ndarray, "F"]) -> Float[np.ndarray, "3 K F"]:
        """Return world points of some frames in the object's frame [m]."""
        offset = points - self.position[:, None, frames]
        return np.einsum("jif,jkf->ikf", self.rotation[:, :, frames], offset)

    def distances(self, points: Float[np.ndarray, "3 *many"]) -> Float[np.ndarray, "*many"]:
        """Return the distances from the surface [m] of points in the object's frame."""
        return self.field.distances(points.reshape(3, -1).T).reshape(points.shape[1:])


def at_points(
    distances_and_vectors: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], points: Float[np.ndarray, "3 *many"]
) -> tuple[Float[np.ndarray, "*many"], Float[np.ndarray, "3 *many"]]:
    """Return the distances [m] and the slopes or normals [unitless] of a field or a grid at points in its frame."""
    distances, vectors = distances_and_vectors(points.reshape(3, -1).T)
    return distances.reshape(points.shape[1:]), vectors.T.reshape(points.shape)


def moving_objects(targets: Targets, shell_spacing: float = SPACING) -> tuple[MovingObject, ...]:
    """Return the objects of a robot's targets; raises `GeometryError` when a mesh cannot be read."""
    rotations = se3.quat_to_matrix(targets.object_quat).transpose(1, 2, 3, 0)
    return tuple(
        MovingObject(
            name,
            *_shape_near(geometry, float(targets.object_scale[index]), targets, index, shell_spacing),
            targets.object_pos[:, index].T,
            rotations[index],
        )
        for index, (name, geometry) in enumerate(zip(targets.object_names, targets.object_geometry, strict=True))
    )


def _shape_near(
    geometry: ObjectGeometry, scale: float, targets: Targets, index: int, shell_spacing: float
) -> tuple[DistanceField, SurfaceSamples]:
    """Return the same as `_shape_of`; of a large object, the samples that the robot can get to."""
    if not is_large(surface_of(geometry), SPACING / scale):
        return _shape_of(geometry, scale, shell_spacing)
    places = targets.site_positions - targets.object_pos[:, None, index]
    local = se3.rotate_inverse(targets.object_quat[:, None, index], places).reshape(-1, 3) / scale
    return _sampled(geometry, scale, shell_spacing, Region(local, _REACH / scale))


@lru_cache(maxsize=6)
def _shape_of(geometry: ObjectGeometry, scale: float, shell_spacing: float) -> tuple[DistanceField, SurfaceSamples]:
    """Return the distances and samples of an object's surface at another size; geometries are known by identity."""
    return _sampled(geometry, scale, shell_spacing, None)


def _sampled(
    geometry: ObjectGeometry, scale: float, shell_spacing: float, region: Region | None
) -> tuple[DistanceField, SurfaceSamples]:
    field = distance_field(geometry)
    samples = surface_samples(surface_of(geometry), (shell_spacing if field.shell else SPACING) / scale, region)
    return field.scaled(scale), SurfaceSamples(scale * samples)


@dataclass(frozen=True, eq=False)
class LinkAtObject:
    """One link of a robot with one object, along the trajectory that a solve starts from."""

    skin: LinkSkin
    moving_object: MovingObject
    start: Kinematics

    @cached_property
    def centres(self) -> Float[np.ndarray, "3 T"]:
        """The middle of the link in the object's frame [m]."""
        centre = self.start.point(self.skin.middle)
        return self.moving_object.inside(centre[:, None], np.arange(centre.shape[1]))[:, 0]

    @cached_property
    def around(self) -> Float[np.ndarray, "T"]:
        """Distances of the link's middle from the object [m]."""
        return self.moving_object.distances(self.centres)

    @cached_property
    def near_frames(self) -> Int[np.ndarray, "F"]:
        """Frames in which skin may be nearer than `NEAR`."""
        return np.flatnonzero(self.around < self.skin.radius + NEAR)

    def poses(self, frames: Int[np.ndarray, "F"]) -> SolidPoses:
        """Return the link's poses on the object."""
        origins = self.moving_object.inside(self.start.point(self.skin.frame)[:, None, frames], frames)[:, 0].T
        return SolidPoses(self.skin.solid, self.turns(frames), origins, self.skin.centre, self.skin.radius)

    def turns(self, frames: Int[np.ndarray, "F"]) -> Float[np.ndarray, "F 3 3"]:
        """Return the rotations of the link in the object's frame."""
        turn = self.moving_object.rotation[:, :, frames].transpose(2, 1, 0)
        return turn @ self.start.orientation(self.skin.frame)[:, :, frames].transpose(2, 0, 1)


COARSE = 100  # Points of the coarser skin.
SPREAD = 0.01
"""[m]; patches of skin that may hold a point less than this further than the nearest one are looked at closely."""


@dataclass(frozen=True, eq=False)
class Patches:
    """A link's skin in patches around the points of a coarser skin."""

    order: Int[np.ndarray, "P"]  # Points, patch by patch.
    first: Int[np.ndarray, "C"]
    count: Int[np.ndarray, "C"]
    radius: Float[np.ndarray, "C"]  # [m]


@lru_cache(maxsize=256)
def patches_of(skin: LinkSkin) -> Patches:
    """Return the patches of a skin."""
    points = skin.points
    away, patch = scipy.spatial.KDTree(points[:COARSE]).query(points)
    order = np.argsort(patch, kind="stable")
    count = np.bincount(patch, minlength=min(COARSE, len(points)))
    radius = np.zeros(len(count))
    np.maximum.at(radius, patch, away)
    return Patches(order, np.cumsum(count) - count, count, radius)


@dataclass(frozen=True, eq=False)
class NearSkin:
    """The points of a link's skin that are nearest to an object, in the frames in which any may be near."""

    frames: Int[np.ndarray, "F"]
    chosen: Int[np.ndarray, "F K"]  # The nearest point, then the nearest that is not close to it, and so on.
    nearest: Float[np.ndarray, "F"]  # Distance of the nearest point [m]; infinite where none is near.
    least: Float[np.ndarray, "F"]  # Distance that no point is nearer than [m].


def near_skin(link: LinkAtObject, count: int, apart: float) -> NearSkin:
    """Return the nearest points of a link's skin.

    `link`: the link and the object; `count`: points in each frame; `apart`: two points that are less from each other
    [m] are not chosen both.
    """
    points, patches, frames = link.skin.points, patches_of(link.skin), link.near_frames
    count, poses = min(count, len(points)), link.poses(frames)
    parts = patches.order, patches.first, patches.count, patches.radius
    options = {"near": NEAR, "spread": SPREAD, "count": count, "apart": apart}
    surface, own = link.moving_object.field.compiled, (poses.rotations, poses.origins)
    return NearSkin(frames, *nearest_skin(surface, points, parts, own, **options))
