"""The shape with which a simulator collides an object: an oriented box where one fits, else convex parts.

A simulator collides convex shapes only. A box fits where the object's surface is near all of the box's, so that open
bins and tables are none. Convex parts are CoACD's (Wei et al., 2022), where the extra `physics` is installed: tens of
seconds for a chair, so they are kept in the user's cache folder by the mesh's digest. Without it, the convex hull
stands for the object, and `kind` says so.
"""

import hashlib
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import product
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from hoi_retarget.files import npz, user_cache
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.objects.track import ObjectGeometry

Kind = Literal["box", "convex parts", "convex hull"]

_FIT = 0.1
"""Share of the box's shortest edge: a box fits when each of its faces is on average nearer to the surface than this.
The boxes and suitcases of OMOMO have 0.09 at most, a bin without a lid 0.2, tables 0.3."""
_ON_BOX = 24  # Points along a face's edge from which distances are taken.
_VERSION = 1  # Of what is made of the same triangles.
_THRESHOLD, _MOST_PARTS = 0.05, 32  # CoACD's concavity, and the number of parts.


@dataclass(frozen=True, eq=False)
class Box:
    """An oriented box in the object's frame."""

    centre: Float[np.ndarray, "3"]
    """[m]"""
    rotation: Float[np.ndarray, "3 3"]
    """Box to object."""
    half: Float[np.ndarray, "3"]
    """Half extents [m]."""

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
    parts: tuple[Float[np.ndarray, "V 3"], ...] = ()
    """Corners of the convex parts [m]; none for a box."""

    @property
    def text(self) -> str:
        """What it is, in words."""
        if self.kind == "convex parts":
            return f"{len(self.parts)} convex parts"
        hint = " (no box fits; install hoi-retarget[physics] for convex parts)" if self.kind == "convex hull" else ""
        return f"a {self.kind}{hint}"


def collision_shape(geometry: ObjectGeometry) -> CollisionShape:
    """Return an object's colliding shape; raises `GeometryError` when its mesh cannot be read."""
    surface = surface_of(geometry)
    box = oriented_box(surface.vertices)
    if _fits(box, surface):
        return CollisionShape("box", box=box)
    if surface.exact and find_spec("coacd") is not None:
        return CollisionShape("convex parts", parts=_kept_parts(surface))
    return CollisionShape("convex hull", parts=(frozen(_hull_corners(surface.vertices)),))


def oriented_box(points: Float[np.ndarray, "P 3"]) -> Box:
    """Return the smallest box around points."""
    import trimesh  # noqa: PLC0415  # takes a third of a second

    to_box, extents = trimesh.bounds.oriented_bounds(points)
    rotation = to_box[:3, :3].T
    return Box(frozen(-rotation @ to_box[:3, 3]), frozen(rotation), frozen(0.5 * extents))


def _fits(box: Box, surface: Surface) -> bool:
    steps = (np.arange(_ON_BOX) + 0.5) * (2.0 / _ON_BOX) - 1.0
    first, second = (grid.reshape(-1) for grid in np.meshgrid(steps, steps))
    plane = np.stack([first, second], axis=1)
    faces = [np.insert(plane, axis, side, axis=1) for axis in range(3) for side in (-1.0, 1.0)]
    places = [box.centre + (box.half * face) @ box.rotation.T for face in faces]
    return bool(max(surface.distances(place).mean() for place in places) < 2.0 * _FIT * box.half.min())


def _hull_corners(points: np.ndarray) -> Float[np.ndarray, "V 3"]:
    hull = ConvexHull(points, qhull_options="QJ")  # Joggled: flat points have a hull, too.
    return points[hull.vertices]


def _kept_parts(surface: Surface) -> tuple[Float[np.ndarray, "V 3"], ...]:
    digest = hashlib.sha256(f"{_VERSION} {_THRESHOLD} {_MOST_PARTS}".encode())
    digest.update(surface.vertices.data)
    digest.update(surface.faces.data)
    name = f"parts-{digest.hexdigest()[:32]}.npz"
    content = user_cache.kept(name)
    if content is not None:
        try:
            entries = npz.members(content)
            corners = npz.array("corners", entries["corners"], "f")
            ends = npz.array("ends", entries["ends"], "i")
            return tuple(frozen(part) for part in np.split(corners, ends[:-1]))
        except (KeyError, ValueError):
            pass  # Damaged: made anew.
    parts = _decomposed(surface)
    ends = np.cumsum([len(part) for part in parts])
    user_cache.keep(name, npz.encode({"corners": np.concatenate(parts), "ends": ends}))
    return parts


def _decomposed(surface: Surface) -> tuple[Float[np.ndarray, "V 3"], ...]:
    import coacd  # noqa: PLC0415  # pyright: ignore[reportMissingImports]  # the extra `physics`

    library: Any = coacd
    library.set_log_level("error")
    mesh = library.Mesh(np.array(surface.vertices), np.array(surface.faces))
    found = library.run_coacd(mesh, threshold=_THRESHOLD, max_convex_hull=_MOST_PARTS, seed=0)
    return tuple(frozen(corners) for corners, _ in found)
