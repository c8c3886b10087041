"""Objects as rigid bodies: mass, centre and inertia from shape and name, and convex shapes for collisions.

No recording tells an object's weight. By default it is its convex hull filled with the mean density of objects of its
kind, which counts the air in them; so an object that is made smaller is lighter.

A simulator collides convex shapes only: an oriented box or the convex hull where they fit, else convex parts. They fit
where the object's surface is within millimetres of theirs: hands touch the surface, and what is in a shape is thrown.
Convex parts are CoACD's (Wei et al., 2022), where the extra `physics` is installed: tens of seconds for a chair, so
they are kept in the user's cache folder by the mesh's digest. Without it, the hull stands for the object, and `text`
says so.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float

from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.errors import install_hint
from hoi_retarget.files import user_cache
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.objects.track import ObjectGeometry

Kind = Literal["box", "convex parts", "convex hull"]

_BOX_GAP_M, _HULL_GAP_M = 0.002, 0.003
"""Mean distances between the object's surface and each face of a box, or all of its hull, with which these fit [m]."""
_POINTS_PER_EDGE = 24  # Points along a face's edge from which distances are taken.
_HULL_POINTS = 2000  # On a hull.
_PARTS_VERSION = 1  # Of the parts of the same triangles.
_CONCAVITY, _MAX_PARTS = 0.05, 32  # CoACD's concavity, and the number of parts.


@dataclass(frozen=True, eq=False)
class Box:
    """An oriented box in the object's frame."""

    centre: Float[np.ndarray, "3"]  # [m]
    rotation: Float[np.ndarray, "3 3"]  # Box to object.
    half: Float[np.ndarray, "3"]  # Half extents [m].

    @property
    def corners(self) -> Float[np.ndarray, "8 3"]:
        """Corners in the object's frame [m]."""
        signs = np.array(list(product((-1.0, 1.0), repeat=3)))
        return self.centre + (self.half * signs) @ self.rotation.T


@dataclass(frozen=True, eq=False)
class CollisionShape:
    """An object's colliding shape in its own frame at captured size."""

    kind: Kind
    box: Box | None = None
    parts: tuple[Float[np.ndarray, "_ 3"], ...] = ()  # Corners of the convex parts [m]; none for a box.
    fits: bool = True  # Whether a hull is near the surface.

    @property
    def text(self) -> str:
        """The shape in words."""
        if self.kind == "convex parts":
            return f"{len(self.parts)} convex parts"
        hint = "" if self.fits else f" (it does not fit; parts by CoACD do. {install_hint('coacd')})"
        return f"a {self.kind}{hint}"


def collision_shape(geometry: ObjectGeometry) -> CollisionShape:
    """Return an object's colliding shape; raises `GeometryError` when its mesh cannot be read."""
    surface = surface_of(geometry)
    box = oriented_box(surface.vertices)
    if _fits(box, surface):
        return CollisionShape("box", box=box)
    hull = frozen(_hull_corners(surface.vertices))
    if surface.exact and not _fits_hull(hull, surface):
        if not install_hint("coacd"):
            return CollisionShape("convex parts", parts=_cached_parts(surface))
        return CollisionShape("convex hull", parts=(hull,), fits=False)
    return CollisionShape("convex hull", parts=(hull,))


def oriented_box(points: Float[np.ndarray, "P 3"]) -> Box:
    """Return the smallest box around points."""
    import trimesh  # noqa: PLC0415  # takes a third of a second

    to_box, extents = trimesh.bounds.oriented_bounds(points)
    rotation = to_box[:3, :3].T
    return Box(frozen(-rotation @ to_box[:3, 3]), frozen(rotation), frozen(0.5 * extents))


def _fits(box: Box, surface: Surface) -> bool:
    steps = (np.arange(_POINTS_PER_EDGE) + 0.5) * (2.0 / _POINTS_PER_EDGE) - 1.0
    first, second = (grid.reshape(-1) for grid in np.meshgrid(steps, steps))
    plane = np.stack([first, second], axis=1)
    faces = [np.insert(plane, axis, side, axis=1) for axis in range(3) for side in (-1.0, 1.0)]
    places = [box.centre + (box.half * face) @ box.rotation.T for face in faces]
    return bool(max(surface.distances(place).mean() for place in places) < _BOX_GAP_M)


def _fits_hull(corners: Float[np.ndarray, "V 3"], surface: Surface) -> bool:
    faces = scipy.spatial.ConvexHull(corners, qhull_options="QJ").simplices
    points, _ = Surface(corners, faces, exact=False).random_points(_HULL_POINTS)
    return bool(surface.distances(points).mean() < _HULL_GAP_M)


def _hull_corners(points: np.ndarray) -> Float[np.ndarray, "V 3"]:
    hull = scipy.spatial.ConvexHull(points, qhull_options="QJ")  # Joggled: flat points have a hull, too.
    return points[hull.vertices]


def _cached_parts(surface: Surface) -> tuple[Float[np.ndarray, "_ 3"], ...]:
    def build() -> dict[str, np.ndarray]:
        parts = _decomposed(surface)
        return {"corners": np.concatenate(parts), "ends": np.cumsum([len(part) for part in parts])}

    name = f"parts-{surface.digest(f'{_PARTS_VERSION} {_CONCAVITY} {_MAX_PARTS}')}.npz"
    arrays = user_cache.cached_arrays(name, {"corners": "f", "ends": "i"}, build)
    return tuple(frozen(part) for part in np.split(arrays["corners"], arrays["ends"][:-1]))


def _decomposed(surface: Surface) -> tuple[Float[np.ndarray, "_ 3"], ...]:
    import coacd  # noqa: PLC0415  # pyright: ignore[reportMissingImports]  # the extra `physics`

    library: Any = coacd
    library.set_log_level("error")
    mesh = library.Mesh(np.array(surface.vertices), np.array(surface.faces))
    found = library.run_coacd(mesh, threshold=_CONCAVITY, max_convex_hull=_MAX_PARTS, seed=0)
    return tuple(frozen(corners) for corners, _ in found)


DENSITIES = {"suitcase": 70.0, "monitor": 350.0, "trash": 70.0, "bin": 70.0, "plasticbox": 25.0, "box": 40.0}
DENSITIES |= {"table": 35.0, "desk": 35.0, "chair": 35.0, "stool": 60.0, "sofa": 60.0, "lamp": 25.0, "stand": 20.0}
DENSITIES |= {"tripod": 40.0, "vacuum": 150.0, "mop": 25.0, "broom": 25.0, "ball": 90.0, "bottle": 600.0, "cup": 400.0}
DENSITIES |= {"backpack": 80.0, "bag": 80.0}
"""Mass over the volume of the convex hull [kg/m^3] by a word in the name: of usual objects of that kind."""
OTHER_DENSITY = 60.0
_HALF_THICKNESS = 1e-3  # [m]; a flat object counts as so thick on either side.


@dataclass(frozen=True, eq=False)
class ObjectBody:
    """One object as a rigid body, in its own frame, at the size that the robot handles."""

    name: str
    mass: float  # [kg]
    reason: str  # Where the mass is from.
    centre: Float[np.ndarray, "3"]  # Centre of mass [m].
    inertia: Float[np.ndarray, "3 3"]  # About the centre of mass [kg m^2].


def object_body(name: str, geometry: ObjectGeometry, scale: float, physics: Physics) -> ObjectBody:
    """Return an object as a rigid body: its convex hull, evenly filled, `scale` times as large as captured."""
    volume, centre, second = _moments(_hull(scale * geometry.points))
    if physics.object_mass != "auto":
        mass, reason = physics.object_mass, "as asked for"
    else:
        word = next((word for word in DENSITIES if word in name.lower()), None)
        density = OTHER_DENSITY if word is None else DENSITIES[word]
        kind = "as of anything" if word is None else f"as of a {word}"
        mass, reason = density * volume, f"{density:g} kg/m^3 of its convex hull, {kind}"
    spread = second / volume - np.outer(centre, centre)
    inertia = mass * (np.trace(spread) * np.eye(3) - spread)
    return ObjectBody(name, float(mass), reason, frozen(centre), frozen(inertia))


def _hull(points: Float[np.ndarray, "P 3"]) -> "scipy.spatial.ConvexHull":
    try:
        return scipy.spatial.ConvexHull(points)
    except (scipy.spatial.QhullError, ValueError):
        offsets = _HALF_THICKNESS * np.concatenate([np.eye(3), -np.eye(3)])
        return scipy.spatial.ConvexHull((points[:, None] + offsets).reshape(-1, 3))


def _moments(hull: "scipy.spatial.ConvexHull") -> tuple[float, Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Return the volume [m^3], the centre [m] and the second moments about the origin [m^5] of a hull."""
    inner = hull.points[hull.vertices].mean(axis=0)
    corners = hull.points[hull.simplices] - inner
    volumes = np.abs(np.linalg.det(corners)) / 6.0  # Of the tetrahedra from the inner point to the triangles.
    volume = float(volumes.sum())
    sums = corners.sum(axis=1)
    centre = np.einsum("f,fi->i", volumes, sums) / (4.0 * volume)
    second = np.einsum("f,fki,fkj->ij", volumes, corners, corners) + np.einsum("f,fi,fj->ij", volumes, sums, sums)
    cross = np.outer(volume * centre, inner)
    return volume, centre + inner, second / 20.0 + cross + cross.T + volume * np.outer(inner, inner)
