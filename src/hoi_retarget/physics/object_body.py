"""An object as a rigid body: mass, centre and inertia, from its shape and what it is called.

No recording tells what an object weighs. By default it is its convex hull filled with the mean density of things of
its kind, which counts the air in them; so an object that is made smaller is lighter.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.physics.settings import Physics

DENSITIES = {
    "suitcase": 70.0,
    "monitor": 350.0,
    "trash": 70.0,
    "bin": 70.0,
    "plasticbox": 25.0,
    "box": 40.0,
    "table": 35.0,
    "desk": 35.0,
    "chair": 35.0,
    "stool": 60.0,
    "sofa": 60.0,
    "lamp": 25.0,
    "stand": 20.0,
    "tripod": 40.0,
    "vacuum": 150.0,
    "mop": 25.0,
    "broom": 25.0,
    "ball": 90.0,
    "bottle": 600.0,
    "cup": 400.0,
    "backpack": 80.0,
    "bag": 80.0,
}
"""Mass over the volume of the convex hull [kg/m^3] by a word in the name: of usual things of that kind."""
OTHER_DENSITY = 60.0
_THIN = 1e-3  # [m]; what is flat counts as so thick on either side.


@dataclass(frozen=True, eq=False)
class ObjectBody:
    """One object as a rigid body, in its own frame, at the size that the robot handles."""

    name: str
    mass: float
    """[kg]"""
    reason: str
    """Where the mass is from."""
    centre: Float[np.ndarray, "3"]
    """Centre of mass [m]."""
    inertia: Float[np.ndarray, "3 3"]
    """About the centre of mass [kg m^2]."""


def object_body(name: str, geometry: ObjectGeometry, scale: float, physics: Physics) -> ObjectBody:
    """Return an object as a rigid body: its convex hull, evenly filled."""
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


def _hull(points: Float[np.ndarray, "P 3"]) -> ConvexHull:
    try:
        return ConvexHull(points)
    except (QhullError, ValueError):
        offsets = _THIN * np.concatenate([np.eye(3), -np.eye(3)])
        return ConvexHull((points[:, None] + offsets).reshape(-1, 3))


def _moments(hull: ConvexHull) -> tuple[float, Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
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
