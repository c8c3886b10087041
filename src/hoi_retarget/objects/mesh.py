"""An object's surface as triangles, and the nearest point on it.

Targets need only an object's extreme points; to lay a contact on the object takes its triangles.
Meshes are read with trimesh here, which takes tenths of a second for the meshes of a recording,
and only when a surface is asked for.
"""

import functools
import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull, KDTree, QhullError

from hoi_retarget.errors import GeometryError
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.objects.track import ObjectGeometry

_SIZE_CLASS = 2.0  # Triangles are searched together when their radii differ by less than this factor.
_NEIGHBOURS = 8  # Triangles that bound the distance before the others are looked for.
_PAIRS = 400_000  # Of a point and a triangle that are compared at once: bounds the memory.

# What trimesh raises for files that are no meshes.
_MESH_ERRORS = (
    OSError,
    ValueError,
    TypeError,
    KeyError,
    IndexError,
    AttributeError,
    NotImplementedError,
    AssertionError,
    MemoryError,
)


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles in an object's frame at captured size.

    Raises `GeometryError` when there is no triangle, or one that names absent or infinite vertices.
    """

    vertices: Float[np.ndarray, "V 3"]
    """[m]"""
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

    def closest_points(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K 3"]:
        """Return, for each point, the nearest point of the surface [m]."""
        if len(points) == 0:
            return np.zeros((0, 3))
        closest, distances = self._by_centroids(points)
        for tree, members, radius in self._size_classes:
            # A triangle is no farther away than its centroid less its radius.
            reach = distances + radius + 1e-12
            counts = tree.query_ball_point(points, reach, return_length=True)
            for first, stop in _batches(np.asarray(counts)):
                found = tree.query_ball_point(points[first:stop], reach[first:stop])
                lengths = np.array([len(item) for item in found])
                if lengths.sum() == 0:
                    continue
                which = np.repeat(np.arange(first, stop), lengths)
                faces = members[np.concatenate(found).astype(int)]
                _keep_nearest(points, which, self.triangles[faces], closest, distances)
        return closest

    def distances(self, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K"]:
        """Return how far points are from the surface, inside or outside [m]."""
        return np.linalg.norm(points - self.closest_points(points), axis=-1)

    def _by_centroids(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the nearest point on the triangles whose centroids are nearest, and how far it is [m]."""
        tree, count = self._centroid_tree, min(_NEIGHBOURS, len(self.faces))
        faces = np.asarray(tree.query(points, k=count)[1])
        closest, distances = np.empty_like(points, dtype=float), np.full(len(points), np.inf)
        which = np.repeat(np.arange(len(points)), count)
        _keep_nearest(points, which, self.triangles[faces.reshape(-1)], closest, distances)
        return closest, distances

    @functools.cached_property
    def _centroids(self) -> np.ndarray:
        return self.triangles.mean(axis=1)

    @functools.cached_property
    def _centroid_tree(self) -> KDTree:
        return KDTree(self._centroids)

    @functools.cached_property
    def _size_classes(self) -> tuple[tuple[KDTree, np.ndarray, float], ...]:
        """Triangles of like size: a tree of their centroids, their indices and their largest radius [m]."""
        radii = np.linalg.norm(self.triangles - self._centroids[:, None], axis=-1).max(axis=1)
        smallest = max(float(radii.max()) * 1e-3, np.finfo(float).tiny)
        classes = np.floor(np.log(np.maximum(radii, smallest)) / np.log(_SIZE_CLASS))
        found = []
        for value in np.unique(classes):
            members = np.flatnonzero(classes == value)
            found.append((KDTree(self._centroids[members]), members, float(radii[members].max())))
        return tuple(found)


def surface_of(geometry: ObjectGeometry) -> Surface:
    """Return an object's surface: its own triangles, else those of its mesh file, else the hull of its points.

    Raises:
        GeometryError: the mesh file is missing, damaged, or has no triangles.
    """
    if geometry.faces is not None:
        return Surface(geometry.points, geometry.faces)
    if geometry.mesh_path is None:
        return _hull(geometry.points)
    path = geometry.mesh_path
    try:
        status = path.stat()
    except OSError as error:
        raise GeometryError(
            f"{path}: the object's mesh cannot be read ({error.strerror or error}). Put it back, or read the clip "
            "again with --objects."
        ) from error
    return _load(path, status.st_mtime_ns, status.st_size)


@functools.lru_cache(maxsize=32)
def _load(path: Path, _modified: int, _size: int) -> Surface:
    """Read one mesh; the time and the size only tell a changed file from a known one."""
    import trimesh  # noqa: PLC0415  # takes a third of a second, and only surfaces need it

    try:
        # Materials would open other files, which nothing here looks at.
        options: Any = {"skip_materials": True} if path.suffix.lower() == ".obj" else {}
        mesh: Any = trimesh.load(path, process=False, force="mesh", **options)
        return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    except (*_MESH_ERRORS, GeometryError) as error:
        raise GeometryError(
            f"{path}: no mesh with triangles can be read from it ({error}). Export it again."
        ) from error


def _hull(points: Float[np.ndarray, "P 3"]) -> Surface:
    try:
        return Surface(points, ConvexHull(points).simplices, exact=False)
    except (QhullError, ValueError):
        pass  # Flat points have no hull in space, but one in their own plane; straight ones are an edge.
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    along = points @ axes.T
    try:
        around = ConvexHull(along[:, :2]).vertices
        faces = np.array([(around[0], a, b) for a, b in itertools.pairwise(around[1:])])
    except (QhullError, ValueError):
        first, last = int(along[:, 0].argmin()), int(along[:, 0].argmax())
        faces = np.array([(first, last, last)])
    return Surface(points, faces, exact=False)


def _batches(counts: Int[np.ndarray, "K"]) -> list[tuple[int, int]]:
    """Return runs of points that have no more pairs together than are compared at once, at least one point each."""
    edges, pairs = [0], 0
    for index, count in enumerate(counts):
        if pairs and pairs + count > _PAIRS:
            edges.append(index)
            pairs = 0
        pairs += int(count)
    edges.append(len(counts))
    return list(itertools.pairwise(edges))


def _keep_nearest(
    points: np.ndarray, which: np.ndarray, triangles: np.ndarray, closest: np.ndarray, distances: np.ndarray
) -> None:
    """Replace `closest` and `distances` where one of the triangles, each for the point `which`, is nearer."""
    candidates = _on_triangles(points[which], triangles)
    away = np.linalg.norm(candidates - points[which], axis=1)
    order = np.lexsort((away, which))
    first = order[np.unique(which[order], return_index=True)[1]]
    nearer = first[away[first] < distances[which[first]]]
    closest[which[nearer]], distances[which[nearer]] = candidates[nearer], away[nearer]


def _on_triangles(points: Float[np.ndarray, "N 3"], triangles: Float[np.ndarray, "N 3 3"]) -> Float[np.ndarray, "N 3"]:
    """Return the nearest point of one triangle for each point: above its inside, or on one of its edges.

    Triangles without area are their edges; edges without length are points.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    ab, ac, ap = b - a, c - a, points - a
    d_bb, d_bc, d_cc = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    d_b, d_c = _dot(ab, ap), _dot(ac, ap)
    area = d_bb * d_cc - d_bc * d_bc
    safe = np.where(area > 0, area, 1.0)
    v, w = (d_cc * d_b - d_bc * d_c) / safe, (d_bb * d_c - d_bc * d_b) / safe
    # Thin triangles lose all digits of their plane's coordinates: their edges are as near.
    inside = (area > 1e-14 * d_bb * d_cc) & (v >= 0) & (w >= 0) & (v + w <= 1)
    best = a + v[:, None] * ab + w[:, None] * ac
    rest = np.flatnonzero(~inside)
    best[rest] = _on_edges(points[rest], triangles[rest])
    return best


def _on_edges(points: Float[np.ndarray, "N 3"], triangles: Float[np.ndarray, "N 3 3"]) -> Float[np.ndarray, "N 3"]:
    along = np.roll(triangles, -1, axis=1) - triangles
    squared = np.einsum("nej,nej->ne", along, along)
    reach = np.einsum("nej,nej->ne", points[:, None] - triangles, along)
    fraction = np.clip(reach / np.where(squared > 0, squared, 1.0), 0.0, 1.0)
    candidates = triangles + fraction[..., None] * along
    nearest = np.linalg.norm(candidates - points[:, None], axis=-1).argmin(axis=1)
    return candidates[np.arange(len(points)), nearest]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ni,ni->n", a, b)
