"""Contacts as exported: who touches what, when, where, and which way the surface faces there.

One set of arrays, the same in every format that has room for it and in the file beside those that
have none. It says all that a contact's place means anything with: the objects' paths and scales,
and the point of the robot's body that touches.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.normals import outward_normals
from hoi_retarget.motion.trajectory import Trajectory
from hoi_retarget.objects.mesh import Surface
from hoi_retarget.robots.model import RobotModel


def contact_arrays(
    motion: Motion, model: RobotModel, trajectory: Trajectory, surfaces: Mapping[str, Surface]
) -> dict[str, np.ndarray]:
    """Return the contact arrays; C contact links, O objects.

    Normals are NaN where nothing is touched, and for objects whose surface is not given.
    """
    bodies, points = _touching(motion, model)
    return {
        "contact_links": np.array(motion.contact_links, dtype=np.str_),
        "contact_bodies": np.array(bodies, dtype=np.str_),
        "contact_body_points": points,
        "contact_flags": trajectory.contact_flags,
        "contact_object": trajectory.contact_object.astype(np.int64),
        "contact_points": trajectory.contact_points,
        "contact_normals": _normals(motion, trajectory, surfaces),
        "contact_object_names": np.array(motion.object_names, dtype=np.str_),
        "contact_object_scale": motion.object_scale,
        "contact_object_pos_w": trajectory.object_pos,
        "contact_object_quat_w": trajectory.object_quat,
        "contact_stance": trajectory.stance_flags,
    }


def _touching(motion: Motion, model: RobotModel) -> tuple[list[str], Float[np.ndarray, "C 3"]]:
    """Return each contact link's body, and where on it the contact is [m]."""
    names: list[str] = []
    points = np.zeros((len(motion.contact_links), 3))
    for column, link in enumerate(motion.contact_links):
        site = model.sites.index[link]
        body = int(np.flatnonzero(model.bodies.nodes == model.sites.nodes[site])[0])
        names.append(model.body_names[body])
        offset = model.sites.positions[:, site] - model.bodies.positions[:, body]
        points[column] = model.bodies.rotations[:, :, body].T @ offset
    return names, points


def _normals(motion: Motion, trajectory: Trajectory, surfaces: Mapping[str, Surface]) -> Float[np.ndarray, "T C 3"]:
    normals = np.full(trajectory.contact_points.shape, np.nan)
    for index, name in enumerate(motion.object_names):
        if name not in surfaces:
            continue
        touched = trajectory.contact_flags & (trajectory.contact_object == index)
        # Surfaces are at captured size. Scaling about the origin turns no normal.
        points = trajectory.contact_points[touched] / motion.object_scale[index]
        normals[touched] = outward_normals(surfaces[name], points)
    return normals
