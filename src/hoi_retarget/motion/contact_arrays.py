"""Contact arrays of exports: links, bodies, times, points and surface normals, with the paths and scales of objects.

One set of arrays, the same inside formats that have room for it and in the file beside those that have none.
"""

from collections.abc import Mapping

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float

from hoi_retarget.motion.resample import ResampledMotion
from hoi_retarget.objects.mesh import Surface
from hoi_retarget.robots.spec import SIDES

END_EFFECTORS = ("left_foot", "right_foot", "left_hand", "right_hand")
"""Of OmniContact's `contact_info`, in its order, as hands and feet near the object tell it."""
_NEUTRAL_SECONDS = 0.2  # Before and after a touch, in which a link is neither apart nor touching, and a hand closed.
_ON_TRIANGLE_SHARE = 1e-6  # Of the object's size: the distance of a point on a triangle from it.
_NORMAL_DIGITS = 6  # In which the normals of one flat side agree.


def contact_arrays(resampled: ResampledMotion, surfaces: Mapping[str, Surface]) -> dict[str, np.ndarray]:
    """Return the contact arrays; C contact links, O objects.

    Normals are NaN where nothing is touched, and for objects whose surface is not given.
    """
    motion, links, flags = resampled.motion, resampled.motion.contact_links, resampled.contact_flags
    bodies, points = _touching(resampled)
    names = np.array(links, dtype=np.str_)
    of_limbs = names[:, None] == [resampled.model.spec.part_sites.get(part, "") for part in END_EFFECTORS]
    of_side = np.char.startswith(names[:, None], SIDES)  # All links of a side that are no foot are its hand's.
    of_hands = of_side & ~np.char.endswith(names, "foot")[:, None]
    near = scipy.ndimage.maximum_filter1d(flags, 2 * round(_NEUTRAL_SECONDS * resampled.fps) + 1, axis=0)
    return {
        "contact_links": names,
        "contact_bodies": np.array(bodies, dtype=np.str_),
        "contact_body_points": points,
        "contact_flags": flags,
        "contact_ternary": np.add(flags, near, dtype=np.int8) - np.int8(1),
        "contact_hand_closed": near @ of_hands,
        "contact_info": (flags @ of_limbs)[:, :, None].astype(np.float32),
        "contact_object": resampled.contact_object.astype(np.int64),
        "contact_points": resampled.contact_points,
        "contact_normals": _normals(resampled, surfaces),
        "contact_object_names": np.array(motion.object_names, dtype=np.str_),
        "contact_object_scale": motion.object_scale,
        "contact_object_pos_w": resampled.object_pos,
        "contact_object_quat_w": resampled.object_quat,
        "contact_stance": resampled.stance_flags,
    }


def _touching(resampled: ResampledMotion) -> tuple[list[str], Float[np.ndarray, "C 3"]]:
    """Return each contact link's body, and where on it the contact is [m]."""
    model, links = resampled.model, resampled.motion.contact_links
    names: list[str] = []
    points = np.zeros((len(links), 3))
    for column, link in enumerate(links):
        site = model.sites.index[link]
        body = int(np.flatnonzero(model.bodies.nodes == model.sites.nodes[site])[0])
        names.append(model.body_names[body])
        offset = model.sites.positions[:, site] - model.bodies.positions[:, body]
        points[column] = model.bodies.rotations[:, :, body].T @ offset
    return names, points


def _normals(resampled: ResampledMotion, surfaces: Mapping[str, Surface]) -> Float[np.ndarray, "T C 3"]:
    normals = np.full(resampled.contact_points.shape, np.nan)
    for index, name in enumerate(resampled.motion.object_names):
        if name not in surfaces:
            continue
        touched = resampled.contact_flags & (resampled.contact_object == index)
        # Surfaces are at captured size. Scaling about the origin turns no normal.
        points = resampled.contact_points[touched] / resampled.motion.object_scale[index]
        normals[touched] = outward_normals(surfaces[name], points)
    return normals


def outward_normals(surface: Surface, points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "K 3"]:
    """Return the outward unit normal at the surface's nearest point to each point.

    Where sides meet, it is the mean of theirs. Triangles are taken to be wound alike; the sign of the enclosed volume
    gives the direction. A hull's triangles face away from its middle.
    """
    normals = np.empty_like(points, dtype=float)
    if len(points) == 0:
        return normals
    places, which = np.unique(surface.closest_points(points), axis=0, return_inverse=True)
    faces, usable = _facing(surface)
    triangles, faces = surface.triangles[usable], faces[usable]
    centroids = triangles.mean(axis=1)
    reach = np.linalg.norm(triangles - centroids[:, None], axis=-1).max()
    tolerance = _ON_TRIANGLE_SHARE * float(np.ptp(surface.vertices, axis=0).max())
    near = scipy.spatial.KDTree(centroids).query_ball_point(places, reach + tolerance)
    found = np.empty_like(places)
    for index, place in enumerate(places):
        members = np.asarray(near[index], dtype=int)
        away = _distances(place, triangles[members])
        meeting = faces[members[away <= max(tolerance, away.min())]]
        # A flat side counts once, however many triangles it is cut into.
        found[index] = np.unique(meeting.round(_NORMAL_DIGITS), axis=0).sum(axis=0)
    lengths = np.linalg.norm(found, axis=1, keepdims=True)
    return (found / np.where(lengths > 0, lengths, 1.0))[which.reshape(-1)]


def _facing(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normals that face outwards, and the mask of triangles with an area."""
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
    """Return a bound of the distance of a surface point from each triangle [m]; 0 on it."""
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
