"""How far the parts of a robot that touch are off the object, frame by frame, quickly enough to follow an edit.

By skin points and the object's distance field: to a millimetre or two. Figures measure triangles, both ways.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from hoi_retarget.evaluation.surface_curves import part_skins
from hoi_retarget.evaluation.surface_distances import Poses
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.objects.distance_field import DistanceField, distance_field
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin

_FIRST, _AROUND = 150, 150  # Points all over a link, and then those around the nearest of them.


def skin_gaps(motion: Motion, kinematics: Kinematics, geometries: Sequence[ObjectGeometry]) -> Float[np.ndarray, "T C"]:
    """Return the least distance of each contact link's skin from the object that it is to touch [m], negative inside.

    Where it is to touch nothing, NaN.
    """
    model = kinematics.model
    parts = {site: part for part, site in model.spec.part_sites.items()}
    gaps = np.full(motion.contact_flags.shape, np.nan)
    for column, site in enumerate(motion.contact_links):
        for index, geometry in enumerate(geometries):
            frames = np.flatnonzero(motion.contact_flags[:, column] & (motion.contact_object[:, column] == index))
            if not len(frames) or site not in parts:
                continue
            field = distance_field(geometry).scaled(float(motion.object_scale[index]))
            item = Poses(motion.object_pos[frames, index], se3.quat_to_matrix(motion.object_quat[frames, index]))
            links = part_skins(model, parts[site])
            poses = [Poses.of_link(kinematics, skin).at(frames).inside(item) for skin in links]
            own = [_least(field, pose, skin) for pose, skin in zip(poses, links, strict=True)]
            gaps[frames, column] = np.min(own, axis=0)
    return gaps


def _least(field: DistanceField, pose: Poses, skin: LinkSkin) -> Float[np.ndarray, "F"]:
    """Return the least distance of a link's skin at poses in the object's frame [m]."""
    turned, places = pose.rotations.swapaxes(1, 2), pose.positions[:, None]

    def distances(points: np.ndarray) -> np.ndarray:
        local = points @ turned + places
        return field.distances(local.reshape(-1, 3)).reshape(local.shape[:2])

    best = distances(skin.points[:_FIRST]).argmin(axis=1)
    return distances(skin.points[_around(skin)[best]]).min(axis=1)


@lru_cache(maxsize=32)
def _around(skin: LinkSkin) -> Int[np.ndarray, "P N"]:
    """Return the skin points next to each of the first ones."""
    near = KDTree(skin.points).query(skin.points[:_FIRST], k=min(_AROUND, len(skin.points)))[1]
    return near.reshape(min(_FIRST, len(skin.points)), -1)
