"""Distances of all links of a robot from all objects, for figures and for viewers."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.evaluation.object_shape import shape_of
from hoi_retarget.evaluation.surface_distances import LinkDistances, PlacedObject, Poses, link_distances
from hoi_retarget.evaluation.view import FOOT_SITES, HAND_SITES
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import LinkSkin, skin_of, skins_from

PART_SITES = {**HAND_SITES, **FOOT_SITES}
Touching = dict[tuple[str, int], Bool[np.ndarray, "F"]]
"""Link and object -> the frames in which they are to touch."""


@dataclass(frozen=True, eq=False)
class ObjectDistances:
    """One robot and all objects over F frames."""

    links: tuple[str, ...]
    poses: Mapping[str, Poses]
    """Of links in the world."""
    objects: tuple[PlacedObject, ...]
    pairs: Mapping[tuple[str, int], LinkDistances]
    """By link and object."""

    @property
    def depth(self) -> Float[np.ndarray, "O L F"]:
        """How deep each link and each object are in each other [m]."""
        frames = len(next(iter(self.poses.values())).positions) if self.poses else 0
        depths = [self.pairs[link, index].depth for index in range(len(self.objects)) for link in self.links]
        return np.reshape(depths, (len(self.objects), len(self.links), frames))

    def gap(self, skins: tuple[LinkSkin, ...], index: int) -> Float[np.ndarray, "F"]:
        """Return the least signed distance of some links and an object [m]; infinite where it was not measured."""
        return np.min([self.pairs[skin.link, index].gap for skin in skins], axis=0)


def object_distances(
    kinematics: Kinematics, objects: tuple[PlacedObject, ...], touching: Touching, first: int = 0
) -> ObjectDistances:
    """Return the distances from one frame on.

    Args:
        kinematics: The robot's, over all frames.
        objects: Over the frames that count.
        touching: Frames in which distances are measured however large they are.
        first: The first frame that counts.
    """
    skins = skin_of(kinematics.model).links
    poses = {skin.link: Poses.of_link(kinematics, skin, first) for skin in skins}
    never = np.zeros(len(kinematics.qpos) - first, dtype=bool)
    pairs = {
        (skin.link, index): link_distances(skin, poses[skin.link], one, touching.get((skin.link, index), never))
        for index, one in enumerate(objects)
        for skin in skins
    }
    return ObjectDistances(tuple(poses), poses, objects, pairs)


@lru_cache(maxsize=4)
def distances_of_motion(
    motion: Motion, model: RobotModel, geometries: tuple[ObjectGeometry, ...]
) -> tuple[ObjectDistances, Float[np.ndarray, "T C"]]:
    """Return a motion's distances from its objects, and of each contact link from the object that it is to touch [m].

    The latter are negative inside, and NaN where there is no contact. Raises `GeometryError` when an object's mesh
    cannot be read.
    """
    rotations = se3.quat_to_matrix(motion.object_quat)
    objects = tuple(
        PlacedObject(
            shape_of(geometry),
            Poses(motion.object_pos[:, index], np.ascontiguousarray(rotations[:, index])),
            float(motion.object_scale[index]),
        )
        for index, geometry in enumerate(geometries)
    )
    skins_of = {name: part_skins(model, part) for part, site in PART_SITES.items() for name in (part, site)}
    contacts = [
        (column, index, skins_of[link], asked)
        for column, link in enumerate(motion.contact_links)
        for index in range(len(geometries))
        if skins_of.get(link)
        and (asked := motion.contact_flags[:, column] & (motion.contact_object[:, column] == index)).any()
    ]
    touching = {(skin.link, index): asked for _, index, skins, asked in contacts for skin in skins}
    distances = object_distances(model.forward(motion.qpos), objects, touching)
    gaps = np.full(motion.contact_flags.shape, np.nan)
    for column, index, skins, asked in contacts:
        gaps[asked, column] = distances.gap(skins, index)[asked]
    return distances, gaps


def part_skins(model: RobotModel, part: str) -> tuple[LinkSkin, ...]:
    """Return the skins of the links that stand for a human's hand or foot: the site's link and those it carries."""
    return skins_from(model, PART_SITES[part])
