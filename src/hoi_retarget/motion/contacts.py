"""Contacts as exported: who touches what, when, where, and which way the surface faces there.

One set of arrays, the same in every format that has room for it and in the file beside those that
have none. It says all that a contact's place means anything with: the objects' paths and scales,
and the point of the robot's body that touches.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.normals import outward_normals
from hoi_retarget.motion.resample import ResampledMotion
from hoi_retarget.objects.mesh import Surface


def contact_arrays(resampled: ResampledMotion, surfaces: Mapping[str, Surface]) -> dict[str, np.ndarray]:
    """Return the contact arrays; C contact links, O objects.

    Normals are NaN where nothing is touched, and for objects whose surface is not given.
    """
    motion = resampled.motion
    bodies, points = _touching(resampled)
    return {
        "contact_links": np.array(motion.contact_links, dtype=np.str_),
        "contact_bodies": np.array(bodies, dtype=np.str_),
        "contact_body_points": points,
        "contact_flags": resampled.contact_flags,
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
