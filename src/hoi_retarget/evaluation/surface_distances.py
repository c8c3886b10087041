"""Distances of a robot's links from objects and from other links, frame by frame, both ways.

Skin points are measured against the object's triangles, points of the object against each link's solid: a hand that
goes right through a thin board is hardly inside the board, but the board is deep inside the hand. Every frame, every
link and every object is measured; figures and viewers choose.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.evaluation.comparison import FOOT_SITES, HAND_SITES, object_poses
from hoi_retarget.kernels.point_tree import Accuracy, Nearest, PointTree
from hoi_retarget.motion.motion import Motion
from hoi_retarget.objects.distance_field import (
    SHELL_THICKNESS,
    DistanceField,
    Region,
    distance_field,
    is_large,
    surface_samples,
)
from hoi_retarget.objects.mesh import Surface, surface_of
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.link_depths import RigidPoses, least_in_solid, tree_of
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import LinkSkin, skin_of, skins_from
from hoi_retarget.robots.spec import BODY_SITES, FINGER_SITES

_SPACING = 3e-3  # Square of the surface that a point stands for [m], so that no place is further than 4 mm from one.
_OUTSIDE_ERROR, _INSIDE_ERROR = 0.06, 0.25
"""Relative errors of a field's distance on either side of the surface, besides its absolute error."""
_FAR_ERROR, _FAR_M = 0.45, 0.02
"""The relative error by which the distance may be larger than the field's from so far on [m]."""


@dataclass(frozen=True, eq=False)
class ObjectShape:
    """Distances from one object at captured size [m], negative inside.

    A shell, which has no inside, counts as `SHELL_THICKNESS` thick on both sides of its surface.
    """

    surface: Surface
    field: DistanceField

    @cached_property
    def _tree(self) -> PointTree:
        return PointTree.of(surface_samples(self.surface, _SPACING))

    def tree_near(self, link: RigidPoses, skin: LinkSkin, scale: float) -> PointTree:
        """Return points of the surface: all over it, or of a large one, those near a link.

        The poses of the link are in the frame of the object, whose size over captured size is `scale`.
        """
        if not is_large(self.surface, _SPACING):
            return self._tree
        centres = (link.positions + link.rotations @ skin.centre) / scale
        return PointTree.of(surface_samples(self.surface, _SPACING, Region(centres, (skin.radius + REACH) / scale)))

    @cached_property
    def radius(self) -> float:
        """Radius of a ball that holds it, where its box has its middle [m]."""
        return 0.5 * float(np.linalg.norm(np.ptp(self.surface.vertices, axis=0)))

    @property
    def accuracy(self) -> Accuracy:
        """Of the field's distances."""
        return Accuracy(self.field.error, _OUTSIDE_ERROR, _INSIDE_ERROR, _FAR_ERROR, _FAR_M)

    def bounds(self, points: Float[np.ndarray, "K 3"]) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K"]]:
        """Return a lower and an upper bound of the distances of points [m]."""
        return self.accuracy.bounds(self.field.distances(points))

    def distances(
        self, points: Float[np.ndarray, "K 3"], lower: Float[np.ndarray, "K"], upper: Float[np.ndarray, "K"]
    ) -> Float[np.ndarray, "K"]:
        """Return the exact distances of points from the triangles [m], given their `bounds`."""
        away = self.surface.distances(points)
        if self.field.shell:
            return away - SHELL_THICKNESS
        inside = upper < 0.0
        unsure = ~inside & (lower < 0.0)
        inside[unsure] = self.surface.encloses(points[unsure], away[unsure])
        return np.where(inside, -away, away)


ObjectSurface = Literal["solid", "shell", "hull"]
"""Kind of an object's surface: one that has an inside, one that has none, or the convex hull of its points."""


def surface_kind(geometry: ObjectGeometry) -> ObjectSurface:
    """Return the kind of an object's surface; raises `GeometryError` when its mesh cannot be read."""
    path = geometry.mesh_path
    # Data sets whose objects are known by points alone come with meshes of their hulls.
    if not surface_of(geometry).exact or (path is not None and path.stem.endswith("_hull")):
        return "hull"
    return "shell" if distance_field(geometry).shell else "solid"


@lru_cache(maxsize=3)
def shape_of(geometry: ObjectGeometry) -> ObjectShape:
    """Return an object's shape, made once; raises `GeometryError` when its mesh cannot be read."""
    return ObjectShape(surface_of(geometry), distance_field(geometry))


REACH = 0.012
"""An object's points are measured in links whose skin is at most so far from it [m]: skin points are nearer to each
other, so an object that is in the solid is near one of them, unless all of it is inside."""
FRAMES_AT_ONCE = 500
"""Measured together: enough for numpy to be quick, and few enough for their points to fit in memory."""


@dataclass(frozen=True, eq=False)
class PosedObject:
    """An object over F frames."""

    shape: ObjectShape  # At captured size.
    pose: RigidPoses
    scale: float


def posed_objects(
    geometries: Sequence[ObjectGeometry], poses: Sequence[RigidPoses], motion: Motion
) -> tuple[PosedObject, ...]:
    """Return a motion's objects at poses; raises `GeometryError` when an object's mesh cannot be read."""
    placed = zip(geometries, poses, motion.object_scale.tolist(), strict=True)
    return tuple(PosedObject(shape_of(geometry), pose, scale) for geometry, pose, scale in placed)


@dataclass(frozen=True, eq=False)
class LinkDistances:
    """One link and one object over F frames."""

    skin: Float[np.ndarray, "F"]
    """Least signed distance of the link's skin from the object [m]; infinite where beyond the reach."""
    point: Int[np.ndarray, "F"]  # Skin point that has it; -1 where there is none.
    object: Float[np.ndarray, "F"]  # Least signed distance of the object's points from the link's solid [m], at most 0.

    @cached_property
    def depth(self) -> Float[np.ndarray, "F"]:
        """Depth of one in the other [m], the larger of both ways; 0 where they are apart."""
        return np.maximum(np.maximum(-self.skin, -self.object), 0.0)

    @property
    def gap(self) -> Float[np.ndarray, "F"]:
        """Least signed distance [m]: off the surface, or minus the depth of one in the other."""
        return np.where(self.object < 0.0, np.minimum(self.skin, self.object), self.skin)


def link_distances(
    skin: LinkSkin, link: RigidPoses, placed: PosedObject, measured: Bool[np.ndarray, "F"]
) -> LinkDistances:
    """Return the distances of a link and an object in every frame, in memory that long clips do not grow.

    In frames that are not `measured` however far apart they are, what is further than `REACH` is infinitely far.
    """
    parts = []
    for start in range(0, len(measured), FRAMES_AT_ONCE):
        frames = np.arange(start, min(start + FRAMES_AT_ONCE, len(measured)))
        there = replace(placed, pose=placed.pose.at(frames))
        parts.append(_link_distances(skin, link.at(frames), there, measured[frames]))
    columns = ([part.skin for part in parts], [part.point for part in parts], [part.object for part in parts])
    return LinkDistances(*map(np.concatenate, columns))


def _link_distances(
    skin: LinkSkin, link: RigidPoses, placed: PosedObject, measured: Bool[np.ndarray, "F"]
) -> LinkDistances:
    shape, scale = placed.shape, placed.scale
    limit = np.where(measured, np.inf, REACH)
    least, point, sunk = np.full(len(limit), np.inf), np.full(len(limit), -1), np.zeros(len(limit))
    inside = link.relative_to(placed.pose)
    lower, _ = shape.bounds((inside.positions + inside.rotations @ skin.centre) / scale)
    near = np.flatnonzero(scale * lower - skin.radius <= limit)
    if not len(near):
        return LinkDistances(least, point, sunk)

    own, tree, accuracy = inside.at(near), tree_of(skin), shape.accuracy.at(scale)
    field, poses = shape.field.compiled, (own.rotations, own.positions)
    found = tree.nearest(field, *poses, limit=limit[near], accuracy=accuracy, scale=scale)
    least[near], point[near] = _exact(found, tree, own, shape, scale)
    swallowed = scale * shape.radius <= skin.radius
    hit = near if swallowed else np.flatnonzero(least <= REACH)
    if len(hit):
        back = placed.pose.at(hit).relative_to(link.at(hit))
        sunk[hit] = scale * least_in_solid(shape.tree_near(inside.at(hit), skin, scale), skin, back, scale)[0]
    return LinkDistances(least, point, sunk)


def _exact(
    found: Nearest, tree: PointTree, pose: RigidPoses, shape: ObjectShape, scale: float
) -> tuple[Float[np.ndarray, "F"], Int[np.ndarray, "F"]]:
    """Return the exact least distance at each place, and the skin point that has it."""
    least, point = np.full(len(pose.positions), np.inf), np.full(len(pose.positions), -1)
    middle = found.lower + found.upper
    order = np.lexsort((middle, found.place))
    place = found.place[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = place[1:] != place[:-1]
    for batch in (order[first], order[~first]):
        # The seemingly nearest is measured first: it leaves few others to measure.
        chosen = batch[found.lower[batch] < least[found.place[batch]]]
        at, which = found.place[chosen], found.point[chosen]
        placed = np.einsum("kij,kj->ki", pose.rotations[at], tree.points[which]) + pose.positions[at]
        distances = scale * shape.distances(placed / scale, found.lower[chosen] / scale, found.upper[chosen] / scale)
        better = np.argsort(-distances, kind="stable")  # The last one written stays.
        better = better[distances[better] < least[at[better]]]
        least[at[better]], point[at[better]] = distances[better], tree.order[which[better]]
    return least, point


def near_surface(
    placed: PosedObject, poses: RigidPoses, points: Float[np.ndarray, "K 3"], limit: float
) -> tuple[Float[np.ndarray, "F K 3"], Bool[np.ndarray, "F K"]]:
    """Return points of a link, at its world poses, in an object's frame [m], and which are within `limit` of it [m]."""
    shape, scale, inside = placed.shape, placed.scale, poses.relative_to(placed.pose)
    there = np.einsum("fij,kj->fki", inside.rotations, points) + inside.positions[:, None]
    captured = there.reshape(-1, 3) / scale
    lower, upper = shape.bounds(captured)
    near = (scale * lower >= -limit) & (scale * upper <= limit)
    unsure = np.flatnonzero(~near & (scale * lower <= limit) & (scale * upper >= -limit))
    exact = shape.distances(captured[unsure], lower[unsure], upper[unsure])
    near[unsure] = scale * np.abs(exact) <= limit
    return there, near.reshape(there.shape[:2])


PART_SITES = {**HAND_SITES, **FOOT_SITES, **BODY_SITES, **{site: site for site in FINGER_SITES}}
Touching = dict[tuple[str, int], Bool[np.ndarray, "F"]]  # Link and object -> the frames in which they are to touch.


@dataclass(frozen=True, eq=False)
class ObjectDistances:
    """One robot and all objects over F frames."""

    links: tuple[str, ...]
    poses: Mapping[str, RigidPoses]  # Of links in the world.
    objects: tuple[PosedObject, ...]
    pairs: Mapping[tuple[str, int], LinkDistances]  # By link and object.

    @property
    def depth(self) -> Float[np.ndarray, "O L F"]:
        """Depth of each link and each object in each other [m]."""
        frames = len(next(iter(self.poses.values())).positions) if self.poses else 0
        depths = [self.pairs[link, index].depth for index in range(len(self.objects)) for link in self.links]
        return np.reshape(depths, (len(self.objects), len(self.links), frames))

    def gap(self, skins: tuple[LinkSkin, ...], index: int) -> Float[np.ndarray, "F"]:
        """Return the least signed distance of some links and an object [m]; infinite where it was not measured."""
        return np.min([self.pairs[skin.link, index].gap for skin in skins], axis=0)


def object_distances(
    kinematics: Kinematics, objects: tuple[PosedObject, ...], touching: Touching, first: int = 0
) -> ObjectDistances:
    """Return the distances from one frame on; where a link and an object are `touching`, however large they are.

    `objects` are those of the frames from there on.
    """
    skins = skin_of(kinematics.model).links
    poses = {skin.link: RigidPoses.of_link(kinematics, skin, first) for skin in skins}
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
    objects = posed_objects(geometries, object_poses(motion), motion)
    skins_of = {name: part_skins(model, part) for part, site in PART_SITES.items() for name in (part, site)}
    contacts = [
        (column, index, skins_of[link], labelled)
        for column, link in enumerate(motion.contact_links)
        for index in range(len(geometries))
        if skins_of.get(link) and (labelled := motion.labelled(index)[:, column]).any()
    ]
    touching = {(skin.link, index): labelled for _, index, skins, labelled in contacts for skin in skins}
    distances = object_distances(model.forward(motion.qpos), objects, touching)
    gaps = np.full(motion.contact_flags.shape, np.nan)
    for column, index, skins, labelled in contacts:
        gaps[labelled, column] = distances.gap(skins, index)[labelled]
    return distances, gaps


def part_skins(model: RobotModel, part: str) -> tuple[LinkSkin, ...]:
    """Return the skins of the links that stand for a human's part, as `skins_from` gives them; none of no such part."""
    return skins_from(model, PART_SITES[part]) if PART_SITES[part] in model.sites.index else ()
