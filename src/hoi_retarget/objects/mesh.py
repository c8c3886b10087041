"""An object's surface as triangles, and the nearest point on it.

Targets need only an object's extreme points; to lay a contact on the object takes its triangles.
Meshes are read with trimesh here, which takes tenths of a second for the meshes of a recording,
and only when a surface is asked for.
"""

import functools
import hashlib
import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Bool, Float, Int

from hoi_retarget.errors import GeometryError, MeshError, ReadError
from hoi_retarget.files import user_cache
from hoi_retarget.files.reading import check_file
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.objects.track import ObjectGeometry

_MAX_THIN_SINE = 1e-3  # Sine of a triangle's smallest angle.
_EDGES = ((0, 1), (1, 2), (2, 0))
_ALONE = {".obj", ".ply", ".stl", ".off"}  # Such a file is a whole mesh: what was parsed is kept in the user's cache.
_VERSION = 1  # Of what is kept.
_HALF_A_TURN = 0.5  # Between the winding numbers of outside, 0, and inside, 1 or -1.
_IN_BALL = 1.0 + 1e-6  # How much larger a ball must be than the way to its middle, to hold the point.
_EXACT_DISTANCE = 1e-5  # Of the surface's size; below it, a point's side is decided in double precision.

# What trimesh raises for files that are no meshes.
_OF_VALUES = (ValueError, TypeError, LookupError, AttributeError, AssertionError)
_MESH_ERRORS = (OSError, NotImplementedError, MemoryError, *_OF_VALUES)


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles in an object's frame at captured size.

    Raises `GeometryError` when there is no triangle, or one that names absent or infinite vertices.
    """

    vertices: Float[np.ndarray, "V 3"]  # [m]
    faces: Int[np.ndarray, "F 3"]
    exact: bool = True
    """Whether these are the object's own triangles; otherwise they are the convex hull of the points that are known."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen(self.vertices))
        object.__setattr__(self, "faces", frozen(self.faces, int))
        if self.vertices.shape[1:] != (3,) or self.faces.shape[1:] != (3,) or len(self.faces) == 0:
            raise GeometryError(
                f"surface: vertices of shape {self.vertices.shape} and faces of shape {self.faces.shape}, "
                "expected (V, 3) and (F, 3) with at least one triangle."
            )
        if self.faces.min() < 0 or self.faces.max() >= len(self.vertices):
            raise GeometryError(f"surface: its triangles name vertices beyond the {len(self.vertices)} that there are.")
        if not np.isfinite(self.vertices).all():
            raise GeometryError("surface: vertices are not finite numbers.")

    @functools.cached_property
    def triangles(self) -> Float[np.ndarray, "F 3 3"]:
        """Corners of every triangle [m]."""
        return self.vertices[self.faces]

    @functools.cached_property
    def area(self) -> float:
        """Of all triangles [m^2]."""
        a, b, c = np.moveaxis(self.triangles, 1, 0)
        return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    @functools.cached_property
    def size(self) -> float:
        """Longest side of the box around it [m]."""
        return float(np.ptp(self.vertices, axis=0).max())

    def digest(self, settings: str) -> str:
        """Return a name for anything made of these triangles with some settings."""
        digest = hashlib.sha256(settings.encode())
        digest.update(self.vertices.data)
        digest.update(self.faces.data)
        return digest.hexdigest()[:32]

    def closest_points(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K 3"]:
        """Return, for each point, the nearest point of the surface [m]."""
        if len(points) == 0:
            return np.zeros((0, 3))
        tree, faces = self._tree
        return tree.squared_distance(self.vertices, faces, np.asarray(points, dtype=float))[2]

    def normals(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K 3"]:
        """Return, for each point, the unit normal of the triangle nearest to it; up, where that has no area."""
        if len(points) == 0:
            return np.zeros((0, 3))
        tree, faces = self._tree
        nearest = tree.squared_distance(self.vertices, faces, np.asarray(points, dtype=float))[1]
        a, b, c = self.vertices[faces[nearest]].transpose(1, 0, 2)
        across = np.cross(b - a, c - a)
        lengths = np.linalg.norm(across, axis=1, keepdims=True)
        return np.where(lengths > 0, across / np.where(lengths > 0, lengths, 1.0), [0.0, 0.0, 1.0])

    def distances(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K"]:
        """Return the distances of points from the surface, inside or outside [m]."""
        return np.linalg.norm(points - self.closest_points(points), axis=-1)

    def signed_distances(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K"]:
        """Return the distances of points from the surface [m], negative inside.

        A point is inside where the surface winds around it more than half a time, either way (generalized winding
        number; Jacobson et al., 2013). So a mesh need not be closed or manifold: an opening counts as closed where
        the surface fills more than half of what is seen from the point; solids that overlap are one, and triangles
        without area count for nothing. A flat surface has no inside, and neither have triangles that are not wound
        alike. A hull is wound alike always.
        """
        distances = self.distances(points)
        return np.where(self.encloses(points, distances), -distances, distances)

    def encloses(self, points: Float[np.ndarray, "K 3"], distances: Float[np.ndarray, "K"]) -> Bool[np.ndarray, "K"]:
        """Return which points are inside, as for `signed_distances`, given their distances from the surface [m]."""
        return np.abs(self.winding_numbers(*self._moved_off(points, distances))) > _HALF_A_TURN

    def _moved_off(
        self, points: Float[np.ndarray, "K 3"], distances: Float[np.ndarray, "K"]
    ) -> tuple[Float[np.ndarray, "K 3"], Float[np.ndarray, "K"]]:
        """Return points and distances, those very near to the surface moved away from it on their side [m].

        Within a ball that holds no surface all is on one side: a point has that of the middle.
        """
        way = 2.0 * _EXACT_DISTANCE * self.size
        near = np.flatnonzero((distances < 0.5 * way) & (distances > 0.0))
        if not near.size:
            return points, distances
        away = points[near] - self.closest_points(points[near])
        there = points[near] + way * away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-300)
        apart = self.distances(there)
        free = apart > _IN_BALL * way
        points, distances = points.copy(), distances.copy()
        points[near[free]], distances[near[free]] = there[free], apart[free]
        return points, distances

    @functools.cached_property
    def closed(self) -> bool:
        """Whether the triangles, as they are wound, have no border: then sides change at the surface only."""
        _, corner = np.unique(self.vertices, axis=0, return_inverse=True)
        faces = corner.reshape(-1)[self._wound_faces]
        starts, ends = np.concatenate([faces[:, edge] for edge in _EDGES]).T
        _, edges = np.unique(
            np.minimum(starts, ends) * len(self.vertices) + np.maximum(starts, ends), return_inverse=True
        )
        return not np.bincount(edges.reshape(-1), weights=np.sign(ends - starts)).any()

    def random_points(self, count: int, seed: int = 0) -> tuple[Float[np.ndarray, "K 3"], Float[np.ndarray, "K 3"]]:
        """Return points spread evenly over the surface [m], and the unit normals of their triangles as these are wound.

        There are none where no triangle has an area.
        """
        a, b, c = np.moveaxis(self.vertices[self._wound_faces], 1, 0)
        normals = np.cross(b - a, c - a)
        areas = np.linalg.norm(normals, axis=1)
        if areas.sum() == 0:
            return np.zeros((0, 3)), np.zeros((0, 3))
        rng = np.random.default_rng(seed)
        chosen = rng.choice(len(areas), count, p=areas / areas.sum())
        weights = rng.dirichlet(np.ones(3), size=count)
        points = np.einsum("kc,kci->ki", weights, self.vertices[self._wound_faces[chosen]])
        return points, normals[chosen] / areas[chosen, None]

    def winding_numbers(
        self, points: Float[np.ndarray, "K 3"], distances: Float[np.ndarray, "K"]
    ) -> Float[np.ndarray, "K"]:
        """Return how often the surface winds around points, given their distances from it [m]."""
        import igl  # noqa: PLC0415  # as in `_tree`

        if len(points) == 0:
            return np.zeros(0)
        numbers = self._winding_tree.winding_number(np.asarray(points, dtype=float))
        # The tree has single precision, which tells no side this near to the surface.
        near = distances < _EXACT_DISTANCE * self.size
        if near.any():
            numbers[near] = igl.winding_number(self.vertices, self._wound_faces, points[near])
        return numbers

    @functools.cached_property
    def _tree(self) -> tuple[Any, Int[np.ndarray, "N 3"]]:
        """A search tree (`igl.AABB`), and its triangles: the surface's, and the edges of thin ones."""
        import igl  # noqa: PLC0415  # takes a fifth of a second, and only surfaces need it

        along = np.roll(self.triangles, -1, axis=1) - self.triangles
        lengths = np.sort(np.linalg.norm(along, axis=2), axis=1)
        area = np.linalg.norm(np.cross(along[:, 0], along[:, 1]), axis=1)
        # Places on a thin triangle lose digits; those on a triangle of two corners, which is an edge, do not.
        thin = self.faces[area <= _MAX_THIN_SINE * lengths[:, 1] * lengths[:, 2]]
        faces = np.concatenate([self.faces, *(thin[:, [first, second, second]] for first, second in _EDGES)])
        tree = igl.AABB()
        tree.init(self.vertices, faces)
        return tree, faces

    @functools.cached_property
    def _winding_tree(self) -> Any:
        import igl  # noqa: PLC0415  # as above

        tree = igl.FastWindingNumberBVH()
        tree.init(self.vertices, self._wound_faces)
        return tree

    @functools.cached_property
    def _wound_faces(self) -> Int[np.ndarray, "F 3"]:
        """The triangles wound alike: their own order, but a hull's, which has none, so that they face outwards."""
        if self.exact:
            return self.faces
        a, b, c = np.moveaxis(self.triangles, 1, 0)
        from_middle = (a + b + c) / 3 - self.vertices.mean(axis=0)
        inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), from_middle) < 0
        return np.where(inward[:, None], self.faces[:, ::-1], self.faces)


def surface_of(geometry: ObjectGeometry) -> Surface:
    """Return an object's surface: its own triangles, else those of its mesh file, else the hull of its points.

    Raises `GeometryError` where the mesh file is missing, damaged, or has no triangles.
    """
    if geometry.faces is not None:
        return _own(geometry)
    if geometry.mesh_path is None:
        return _hull(geometry.points)
    path = geometry.mesh_path
    try:
        status = path.stat()
    except OSError as error:
        raise MeshError(
            f"{path}: the object's mesh cannot be read ({error.strerror or error}). Put it back, or read the clip "
            "again with --objects."
        ) from error
    return _load(path, status.st_mtime_ns, status.st_size)


@functools.lru_cache(maxsize=32)
def _own(geometry: ObjectGeometry) -> Surface:
    """Return the surface of a geometry's own triangles, with the search tree that it may have by now."""
    assert geometry.faces is not None, "it has triangles"
    return Surface(geometry.points, geometry.faces)


@functools.lru_cache(maxsize=6)
def _load(path: Path, _modified: int, _size: int) -> Surface:
    """Read one mesh; the time and the size only tell a changed file from a known one."""
    try:
        check_file(path)
        if path.suffix.lower() not in _ALONE:
            parsed = _parsed(path)
            return Surface(parsed["vertices"], parsed["faces"])
        name = f"mesh-{hashlib.sha256(path.read_bytes()).hexdigest()[:32]}{path.suffix.lower()}.{_VERSION}.npz"
        kinds = {"vertices": "f", "faces": "iu"}
        found = user_cache.cached_arrays(name, kinds, lambda: _parsed(path))
        return Surface(found["vertices"], found["faces"])
    except ReadError as error:
        raise MeshError(str(error)) from error
    except (*_MESH_ERRORS, GeometryError) as error:
        raise MeshError(f"{path}: no mesh with triangles can be read from it ({error}). Export it again.") from error


def _parsed(path: Path) -> dict[str, np.ndarray]:
    import trimesh  # noqa: PLC0415  # takes a third of a second, and only meshes that are not known by now need it

    # Materials would open other files, which nothing here looks at.
    options: Any = {"skip_materials": True} if path.suffix.lower() == ".obj" else {}
    mesh: Any = trimesh.load(path, process=False, force="mesh", **options)
    return {"vertices": np.asarray(mesh.vertices, dtype=float), "faces": np.asarray(mesh.faces)}


def _hull(points: Float[np.ndarray, "P 3"]) -> Surface:
    try:
        return Surface(points, scipy.spatial.ConvexHull(points).simplices, exact=False)
    except (scipy.spatial.QhullError, ValueError):
        pass  # Flat points have no hull in space, but one in their own plane; straight ones are an edge.
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    along = points @ axes.T
    try:
        around = scipy.spatial.ConvexHull(along[:, :2]).vertices
        faces = np.array([(around[0], a, b) for a, b in itertools.pairwise(around[1:])])
    except (scipy.spatial.QhullError, ValueError):
        first, last = int(along[:, 0].argmin()), int(along[:, 0].argmax())
        faces = np.array([(first, last, last)])
    return Surface(points, faces, exact=False)
