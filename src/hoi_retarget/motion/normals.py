"""Which way an object's surface faces where it is touched."""

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from hoi_retarget.objects.mesh import Surface

_ON_TRIANGLE = 1e-6  # Of the object's size: a point that near to a triangle lies on it.
_SAME_SIDE = 6  # Digits in which the normals of one flat side agree.


def outward_normals(surface: Surface, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K 3"]:
    """Return the outward unit normal at the surface's nearest point to each point.

    Where sides meet, it is the mean of theirs. Triangles are taken to be wound alike; which way,
    the enclosed volume tells. A hull's triangles face away from its middle.
    """
    normals = np.empty_like(points, dtype=float)
    if len(points) == 0:
        return normals
    places, which = np.unique(surface.closest_points(points), axis=0, return_inverse=True)
    faces, usable = _facing(surface)
    triangles, faces = surface.triangles[usable], faces[usable]
    centroids = triangles.mean(axis=1)
    reach = np.linalg.norm(triangles - centroids[:, None], axis=-1).max()
    tolerance = _ON_TRIANGLE * float(np.ptp(surface.vertices, axis=0).max())
    near = KDTree(centroids).query_ball_point(places, reach + tolerance)
    found = np.empty_like(places)
    for index, place in enumerate(places):
        members = np.asarray(near[index], dtype=int)
        away = _distances(place, triangles[members])
        meeting = faces[members[away <= max(tolerance, away.min())]]
        # A flat side counts once, however many triangles it is cut into.
        found[index] = np.unique(meeting.round(_SAME_SIDE), axis=0).sum(axis=0)
    lengths = np.linalg.norm(found, axis=1, keepdims=True)
    return (found / np.where(lengths > 0, lengths, 1.0))[which.reshape(-1)]


def _facing(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normals that face outwards, and which triangles have an area."""
    a, b, c = np.moveaxis(surface.triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    usable = lengths > 0
    normals /= np.where(usable, lengths, 1.0)[:, None]
    from_middle = surface.triangles.mean(axis=1) - surface.vertices.mean(axis=0)
    outward = np.einsum("fi,fi->f", from_middle, normals)
    if not surface.exact:
        return np.where(outward[:, None] < 0, -normals, normals), usable
    volume = float(np.sum(outward * lengths))  # Six times the enclosed volume, whatever the origin.
    return (normals if volume >= 0 else -normals), usable


def _distances(point: Float[np.ndarray, "3"], triangles: Float[np.ndarray, "N 3 3"]) -> Float[np.ndarray, "N"]:
    """Return how far a point of the surface lies beside each triangle: 0 on it, at least its way out of it else."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    height = np.abs(np.einsum("ni,ni->n", point - a, normal))
    beside = np.zeros(len(triangles))
    for first, second in ((a, b), (b, c), (c, a)):
        inward = np.cross(normal, second - first)
        inward /= np.linalg.norm(inward, axis=1, keepdims=True)
        beside = np.maximum(beside, -np.einsum("ni,ni->n", point - first, inward))
    return np.maximum(height, beside)
