"""Penetration, touch and place of a comparison, frame by frame: what figures summarize and viewers draw."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.evaluation.object_shape import shape_of
from hoi_retarget.evaluation.statistics import norms
from hoi_retarget.evaluation.surface_distances import LinkDistances, PlacedObject, Poses, link_distances
from hoi_retarget.evaluation.view import FOOT_SITES, HAND_SITES, Comparison
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.skin import LinkSkin, skin_of

_SITES = {**HAND_SITES, **FOOT_SITES}


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
    skin = skin_of(model)
    tracks = [
        track
        for track in view.clip.contacts
        if track.person == view.person and track.part in _SITES and part_skins(model, track.part)
    ]
    never = np.zeros(view.clip.frames - view.first, dtype=bool)
    touching: dict[tuple[str, int], np.ndarray] = {}
    for track in tracks:
        for link in part_skins(model, track.part):
            key = link.link, track.object
            touching[key] = touching.get(key, never) | track.active[view.first :]
    poses = {link.link: Poses.of_link(view.kinematics, link, view.first) for link in skin.links}
    placed = [
        PlacedObject(shape_of(track.geometry), Poses(pose.positions, pose.rotations), float(scale))
        for track, pose, scale in zip(view.clip.objects, view.robot_objects, view.motion.object_scale, strict=True)
    ]
    found = {
        (link.link, index): link_distances(link, poses[link.link], one, touching.get((link.link, index), never))
        for index, one in enumerate(placed)
        for link in skin.links
    }
    links = tuple(link.link for link in skin.links)
    depth = np.array([found[link, index].depth for index in range(len(placed)) for link in links])
    touches = []
    for track in tracks:
        own = {link: found[link.link, track.object] for link in part_skins(model, track.part)}
        touches.append(_touch(view, track, own, poses, placed[track.object]))
    return SurfaceCurves(links, depth.reshape(len(placed), len(links), len(never)), tuple(touches))


def _touch(
    view: Comparison,
    track: ContactTrack,
    own: dict[LinkSkin, LinkDistances],
    poses: dict[str, Poses],
    placed: PlacedObject,
) -> TouchCurve:
    active, palms = track.active[view.first :], track.contact_points[view.first :]
    nearest = np.array([distances.skin for distances in own.values()]).argmin(axis=0)
    gap = np.min(
        [np.where(one.object < 0.0, np.minimum(one.skin, one.object), one.skin) for one in own.values()], axis=0
    )
    place = np.full(len(active), np.nan)
    for index, (link, one) in enumerate(own.items()):
        chosen = np.flatnonzero(active & (nearest == index))
        pose = poses[link.link].at(chosen).inside(placed.pose.at(chosen))
        place[chosen] = place_on(placed, pose.placed(link.points[one.point[chosen]]), palms[chosen])
    return TouchCurve(track.part, track.object, active, gap, place)


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


@lru_cache(maxsize=32)
def part_skins(model: RobotModel, part: str) -> tuple[LinkSkin, ...]:
    """Return the skins of the links that stand for a human's hand or foot: the site's link and those it carries."""
    node = model.sites.frames[_SITES[part]].node
    return tuple(link for link in skin_of(model).links if model.supports[node, link.frame.node])
