"""Penetration, touch and place of a comparison, frame by frame: what figures summarize and viewers draw."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.evaluation.object_distances import (
    PART_SITES,
    ObjectDistances,
    Touching,
    object_distances,
    part_skins,
)
from hoi_retarget.evaluation.object_shape import shape_of
from hoi_retarget.evaluation.statistics import norms
from hoi_retarget.evaluation.surface_distances import PlacedObject, Poses
from hoi_retarget.evaluation.view import Comparison


@dataclass(frozen=True, eq=False)
class TouchCurve:
    """One hand or foot and one object that the human's touches with it, over the F counted frames."""

    part: str
    object: int
    active: Bool[np.ndarray, "F"]
    """Frames in which the recording says that they touch."""
    gap: Float[np.ndarray, "F"]
    """Least signed distance [m] between skin and surface; negative by how deep one is in the other. Where the recording
    does not say that they touch, what is further than `REACH` is infinite."""
    place: Float[np.ndarray, "F"]
    """Distance on the object [m] from where skin and surface are nearest to where the human's palm is; NaN where
    inactive."""


@dataclass(frozen=True, eq=False)
class SurfaceCurves:
    """One robot and all objects over the F counted frames."""

    links: tuple[str, ...]
    depth: Float[np.ndarray, "O L F"]
    """How deep each link and each object are in each other [m]."""
    touches: tuple[TouchCurve, ...]

    @property
    def penetration(self) -> Float[np.ndarray, "F"]:
        """The deepest of all links and objects in every frame [m]."""
        return self.depth.max(axis=(0, 1), initial=0.0)

    @property
    def worst_link(self) -> str | None:
        """The link that is deepest in an object, or an object in it; None where nothing is."""
        deepest = self.depth.max(axis=(0, 2), initial=0.0)
        return self.links[int(deepest.argmax())] if deepest.max(initial=0.0) > 0.0 else None


def surface_curves(view: Comparison) -> SurfaceCurves:
    """Return the curves of a comparison; raises `GeometryError` when an object's mesh cannot be read."""
    model = view.kinematics.model
    tracks = [
        track
        for track in view.clip.contacts
        if track.person == view.person and track.part in PART_SITES and part_skins(model, track.part)
    ]
    never = np.zeros(view.clip.frames - view.first, dtype=bool)
    touching: Touching = {}
    for track in tracks:
        for link in part_skins(model, track.part):
            key = link.link, track.object
            touching[key] = touching.get(key, never) | track.active[view.first :]
    placed = tuple(
        PlacedObject(shape_of(track.geometry), Poses(pose.positions, pose.rotations), float(scale))
        for track, pose, scale in zip(view.clip.objects, view.robot_objects, view.motion.object_scale, strict=True)
    )
    distances = object_distances(view.kinematics, placed, touching, view.first)
    return SurfaceCurves(distances.links, distances.depth, tuple(_touch(view, track, distances) for track in tracks))


def _touch(view: Comparison, track: ContactTrack, distances: ObjectDistances) -> TouchCurve:
    active, palms = track.active[view.first :], track.contact_points[view.first :]
    skins, placed = part_skins(view.kinematics.model, track.part), distances.objects[track.object]
    pairs = [distances.pairs[skin.link, track.object] for skin in skins]
    nearest = np.array([pair.skin for pair in pairs]).argmin(axis=0)
    place = np.full(len(active), np.nan)
    for index, (skin, pair) in enumerate(zip(skins, pairs, strict=True)):
        chosen = np.flatnonzero(active & (nearest == index))
        pose = distances.poses[skin.link].at(chosen).inside(placed.pose.at(chosen))
        place[chosen] = place_on(placed, pose.placed(skin.points[pair.point[chosen]]), palms[chosen])
    return TouchCurve(track.part, track.object, active, distances.gap(skins, track.object), place)


def place_on(
    placed: PlacedObject, robot: Float[np.ndarray, "K 3"], human: Float[np.ndarray, "K 3"]
) -> Float[np.ndarray, "K"]:
    """Return how far apart two points' nearest places on the surface are [m].

    Args:
        placed: The object.
        robot: In the frame of the scaled object [m].
        human: In the object's frame at captured size [m].
    """
    surface = placed.shape.surface
    return placed.scale * norms(surface.closest_points(robot / placed.scale) - surface.closest_points(human))
