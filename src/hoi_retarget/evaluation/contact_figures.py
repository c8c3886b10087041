"""Contact figures: palms at the human's places on objects, and skins that touch surfaces without sinking into them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.clip.label_contacts import EDITED, recorded_points
from hoi_retarget.evaluation.comparison import (
    FOOT_SITES,
    HAND_SITES,
    Comparison,
    figure,
    max_or_none,
    mean_or_none,
    norms,
    percentile_or_none,
)
from hoi_retarget.evaluation.surface_distances import (
    FRAMES_AT_ONCE,
    PART_SITES,
    ObjectDistances,
    PosedObject,
    Touching,
    near_surface,
    object_distances,
    part_skins,
    posed_objects,
)
from hoi_retarget.numerics import se3
from hoi_retarget.robots.skin import palmar_points, skins_from
from hoi_retarget.robots.spec import BODY_SITES, FINGER_SITES

_MAX_TOUCH_GAP_M = 2e-3  # A gap up to this [m], off the surface or sunk into it, is touch.
_MAX_REST_GAP_M = 5e-3  # The same of parts that rest [m]: clothes and cushions give way.
_FINGERS = {site: site for site in FINGER_SITES}
_RESTING = {part: site for part, site in BODY_SITES.items() if not part.endswith("thigh")}
"""Judged parts: whether a seat meets the thighs, too, depends on the length of the legs."""
_MIN_TOUCH_AREA_M2, _FACING = 2e-4, np.cos(np.radians(45.0))
"""Palmar skin within that gap that makes a touch the palm's: a fingertip has 1 cm2, a flat hand 5. Hands with curled
fingers or a wrist thicker than the palm have less on a large face: then the palm has to face it, turned at most so."""


@figure("contact gap", "mm")
def contact_gap_m(view: Comparison) -> float | None:
    """Mean distance of palms from the points where the human's were on the object [m]."""
    return mean_or_none(view.cached(_contact_gaps))


@figure("gap p95", "mm")
def contact_gap_p95_m(view: Comparison) -> float | None:
    """The same distance, exceeded in 5 % of the frames [m]."""
    return percentile_or_none(view.cached(_contact_gaps))


@figure("gap max", "mm")
def contact_gap_max_m(view: Comparison) -> float | None:
    """The same distance at its largest [m]."""
    return max_or_none(view.cached(_contact_gaps))


@figure("hand rotation", "deg")
def relative_hand_rotation_deg(view: Comparison) -> float | None:
    """Mean angle between the turns of a touching hand of robot and human on the object [deg].

    With `A_t` the hand's rotation relative to the object, the change is `A_t A_0^T`: it is written in the
    object's axes, which both sides share, and a constant offset between the human's and the robot's hand
    frames, `A_t K`, cancels in it. (`A_0^T A_t` would be written in the hand's axes, which differ.)
    """
    angles = []
    for track in view.hand_contacts:
        frames = np.flatnonzero(track.active)
        starts = _segment_starts(track.active)
        robot = view.robot_objects[track.object].rotations_inside(view.robot_rotation(HAND_SITES[track.part]))
        human = view.human_objects[track.object].rotations_inside(view.human_part_rotation(track.part))
        robot_change = robot[frames] @ np.swapaxes(robot[starts], 1, 2)
        human_change = human[frames] @ np.swapaxes(human[starts], 1, 2)
        angles.append(np.degrees(se3.matrix_angle_between(robot_change, human_change)))
    return mean_or_none(_pooled(angles))


def _contact_gaps(view: Comparison) -> Float[np.ndarray, "K"]:
    """Return the distance on the object [m] between palm and human contact point, hands and contact frames pooled."""
    gaps = []
    for track in view.hand_contacts:
        palm = view.robot_objects[track.object].points_inside(view.robot_point(HAND_SITES[track.part]))
        target = track.contact_points * view.motion.object_scale[track.object]
        gaps.append(norms((palm - target)[track.active]))
    return _pooled(gaps)


def _segment_starts(active: Bool[np.ndarray, "F"]) -> Int[np.ndarray, "K"]:
    """Return, for each active frame, the first frame of its run of active frames."""
    begins = active.copy()
    begins[1:] &= ~active[:-1]
    latest = np.maximum.accumulate(np.where(begins, np.arange(len(active)), 0))
    return latest[active]


def _pooled(arrays: Iterable[np.ndarray]) -> Float[np.ndarray, "K"]:
    return np.concatenate([np.zeros(0), *arrays])


@dataclass(frozen=True, eq=False)
class TouchCurve:
    """One part of the robot and one object that the human's own touches, over the F counted frames."""

    part: str
    object: int
    active: Bool[np.ndarray, "F"]  # Frames in which they touch by the recording's labels.
    gap: Float[np.ndarray, "F"]
    """Least signed distance [m] between skin and surface; minus the depth where one is in the other. In
    inactive frames it is infinite beyond `REACH`."""
    place: Float[np.ndarray, "F"]
    """Distance on the object [m] from the nearest place of skin and surface to the human's palm; NaN where inactive."""
    uncovered: Float[np.ndarray, "F"]
    """The same from the touching skin that is nearest to it, if any is: on a long hand, not the deepest."""
    recorded_place: Float[np.ndarray, "F"]
    """The same to where the human's palm was before the contact was edited; NaN where it was not."""
    palmar_area: Float[np.ndarray, "F"]
    """Area of a hand's palmar skin within 2 mm of the surface [m^2]; 0 where inactive or off it."""
    palm_faces: Bool[np.ndarray, "F"]  # Frames with such skin in which the palm faces the surface there.


@dataclass(frozen=True, eq=False)
class SurfaceCurves:
    """One robot and all objects over the F counted frames."""

    links: tuple[str, ...]
    depth: Float[np.ndarray, "O L F"]  # How deep each link and each object are in each other [m].
    touches: tuple[TouchCurve, ...]

    @property
    def penetration(self) -> Float[np.ndarray, "F"]:
        """The deepest of all links and objects in every frame [m]."""
        return self.depth.max(axis=(0, 1), initial=0.0)


@figure("touch", "%", better="higher", slow=True)
def touch_share(view: Comparison) -> float | None:
    """Share of the frames in which a hand that is to touch is within 2 mm of the surface."""
    return _touch_share(_gaps(view, HAND_SITES))


@figure("palm touch", "%", better="higher", slow=True)
def palm_touch_share(view: Comparison) -> float | None:
    """Share of these frames in which the palm touches, with 2 cm2 or facing the surface, not a fingertip alone."""
    return mean_or_none(_by_palm(view).astype(float))


@figure("fingertip touch", "%", slow=True)
def fingertip_touch_share(view: Comparison) -> float | None:
    """Share of these frames in which the hand touches, but with less than that."""
    touching = np.abs(_gaps(view, HAND_SITES)) <= _MAX_TOUCH_GAP_M
    return mean_or_none((touching & ~_by_palm(view)).astype(float))


@figure("touch gap p95", "mm", slow=True)
def touch_gap_p95_m(view: Comparison) -> float | None:
    """Distance of such a hand's skin from the surface, exceeded in 5 % of the frames [m]."""
    return percentile_or_none(np.abs(_gaps(view, HAND_SITES)))


@figure("touch place", "mm", slow=True)
def touch_place_m(view: Comparison) -> float | None:
    """Distance of the touch from the human's place on the surface [m]."""
    return mean_or_none(_pooled(curve.place[curve.active] for curve in _curves(view, HAND_SITES)))


@figure("finger touch", "%", better="higher", slow=True)
def finger_touch_share(view: Comparison) -> float | None:
    """Share of the frames in which a finger that is to touch is within 2 mm of the surface; of robots with fingers."""
    return _touch_share(_gaps(view, _FINGERS))


@figure("finger place", "mm", slow=True)
def finger_place_m(view: Comparison) -> float | None:
    """Distance of a finger's touch from that of the human's finger on the surface [m]."""
    return mean_or_none(_pooled(curve.place[curve.active] for curve in _curves(view, _FINGERS)))


@figure("finger depth max", "mm", slow=True)
def finger_depth_max_m(view: Comparison) -> float | None:
    """Largest depth of a finger, or of the hand that carries it, in an object [m]."""
    model, curves = view.kinematics.model, view.cached(surface_curves)
    hands = {skin.link for site in HAND_SITES.values() for skin in skins_from(model, site)}
    own = [link in hands for link in curves.links]
    return max_or_none(curves.depth[:, own]) if model.spec.fingers else None


@figure("recorded place", "mm", slow=True)
def recorded_place_m(view: Comparison) -> float | None:
    """Distance of the touch from the human's place before contacts were edited [m]."""
    places = _pooled(curve.recorded_place[curve.active] for curve in _curves(view, HAND_SITES))
    return mean_or_none(places[np.isfinite(places)])


@figure("foot touch", "%", better="higher", slow=True)
def foot_touch_share(view: Comparison) -> float | None:
    """Share of the frames in which a foot that is to touch an object does."""
    return _touch_share(_gaps(view, FOOT_SITES))


@figure("foot touch gap p95", "mm", slow=True)
def foot_touch_gap_p95_m(view: Comparison) -> float | None:
    """Distance of such a foot from the surface, exceeded in 5 % of the frames [m]."""
    return percentile_or_none(np.abs(_gaps(view, FOOT_SITES)))


@figure("rest", "%", better="higher", slow=True)
def rest_share(view: Comparison) -> float | None:
    """Share of the frames in which a pelvis or forearm that is to rest on an object is within 5 mm of it."""
    return mean_or_none((np.abs(_gaps(view, _RESTING)) <= _MAX_REST_GAP_M).astype(float))


@figure("rest gap p95", "mm", slow=True)
def rest_gap_p95_m(view: Comparison) -> float | None:
    """Distance of such a part from the surface, exceeded in 5 % of the frames [m]."""
    return percentile_or_none(np.abs(_gaps(view, _RESTING)))


def _curves(view: Comparison, parts: Mapping[str, str]) -> list[TouchCurve]:
    return [curve for curve in view.cached(surface_curves).touches if curve.part in parts]


def _gaps(view: Comparison, parts: Mapping[str, str]) -> Float[np.ndarray, "K"]:
    return _pooled(curve.gap[curve.active] for curve in _curves(view, parts))


def _touch_share(gaps: Float[np.ndarray, "K"]) -> float | None:
    return mean_or_none((np.abs(gaps) <= _MAX_TOUCH_GAP_M).astype(float))


def _by_palm(view: Comparison) -> Bool[np.ndarray, "K"]:
    curves = _curves(view, HAND_SITES)
    palms = (((curve.palmar_area >= _MIN_TOUCH_AREA_M2) | curve.palm_faces)[curve.active] for curve in curves)
    return np.concatenate([np.zeros(0, dtype=bool), *palms])


def surface_curves(view: Comparison) -> SurfaceCurves:
    """Return the curves of a comparison; raises `GeometryError` when an object's mesh cannot be read."""
    model = view.kinematics.model
    tracks = [track for track in view.contacts if track.part in PART_SITES and part_skins(model, track.part)]
    never = np.zeros(view.clip.frames - view.first, dtype=bool)
    touching: Touching = {}
    for track in tracks:
        for link in part_skins(model, track.part):
            key = link.link, track.object
            touching[key] = touching.get(key, never) | track.active
    placed = posed_objects([track.geometry for track in view.clip.objects], view.robot_objects, view.motion)
    distances = object_distances(view.kinematics, placed, touching, view.first)
    return SurfaceCurves(distances.links, distances.depth, tuple(_touch(view, track, distances) for track in tracks))


def _touch(view: Comparison, track: ContactTrack, distances: ObjectDistances) -> TouchCurve:
    active, never = track.active, np.full((len(track.active), 3), np.nan)
    skins, placed = part_skins(view.kinematics.model, track.part), distances.objects[track.object]
    pairs = [distances.pairs[skin.link, track.object] for skin in skins]
    nearest = np.array([pair.skin for pair in pairs]).argmin(axis=0)
    gap, touching = distances.gap(skins, track.object), never.copy()
    for index, (skin, pair) in enumerate(zip(skins, pairs, strict=True)):
        chosen = np.flatnonzero(active & (nearest == index))
        pose = distances.poses[skin.link].at(chosen).relative_to(placed.pose.at(chosen))
        touching[chosen] = pose.placed(skin.points[pair.point[chosen]])
    recorded = recorded_points(view.clip, track, np.full((view.clip.frames, 3), np.nan))[view.first :]
    recorded = np.where((norms(recorded - track.contact_points) > EDITED)[:, None], recorded, np.nan)
    place, before = (_place_distances(placed, touching, points) for points in (track.contact_points, recorded))
    area, uncovered, faces = np.zeros(len(active)), place.copy(), np.zeros(len(active), dtype=bool)
    near = np.flatnonzero(active & (gap <= _MAX_TOUCH_GAP_M))
    for start in range(0, len(near), FRAMES_AT_ONCE):
        frames = near[start : start + FRAMES_AT_ONCE]
        area[frames], away = _touching_skin(view, track, distances, frames)
        uncovered[frames] = np.minimum(place[frames], away)
    faces[near] = (area[near] > 0.0) & (_palm_cosines(view, PART_SITES[track.part], placed, touching, near) > _FACING)
    return TouchCurve(track.part, track.object, active, gap, place, uncovered, before, area, faces)


def _touching_skin(
    view: Comparison, track: ContactTrack, distances: ObjectDistances, frames: Int[np.ndarray, "K"]
) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K"]]:
    """Return the area of palmar skin in touch [m^2], and the distance of touching skin from the person's place [m]."""
    model, placed = view.kinematics.model, distances.objects[track.object]
    there = replace(placed, pose=placed.pose.at(frames))
    human = placed.scale * placed.shape.surface.closest_points(track.contact_points[frames])
    area, away = np.zeros(len(frames)), np.full(len(frames), np.inf)
    for skin in part_skins(model, track.part):
        points, close = near_surface(there, distances.poses[skin.link].at(frames), skin.points, _MAX_TOUCH_GAP_M)
        away = np.minimum(away, np.where(close, norms(points - human[:, None]), np.inf).min(axis=1))
        if track.part in HAND_SITES:
            palmar = palmar_points(model, PART_SITES[track.part], skin)
            area += close[:, palmar] @ skin.areas[palmar]
    return area, away


def _palm_cosines(
    view: Comparison, palm: str, placed: PosedObject, touching: Float[np.ndarray, "F 3"], near: Int[np.ndarray, "K"]
) -> Float[np.ndarray, "K"]:
    """Return the cosine between the way that a palm faces and the way into the surface where the hand touches."""
    _, outward = placed.shape.field.distances_and_normals(touching[near] / placed.scale)
    facing = view.robot_rotation(palm)[near][:, None, :, 1] * (-1.0 if palm.startswith("left") else 1.0)
    return -(placed.pose.at(near).vectors_inside(facing)[:, 0] * outward).sum(axis=1)


def _place_distances(
    placed: PosedObject, robot: Float[np.ndarray, "F 3"], human: Float[np.ndarray, "F 3"]
) -> Float[np.ndarray, "F"]:
    """Return the distance between two points' nearest places on the surface [m]; NaN where one is missing.

    The robot's are in the frame of the scaled object, the human's in that of the object at captured size [m].
    """
    surface, found = placed.shape.surface, np.full(len(robot), np.nan)
    both = np.flatnonzero(np.isfinite(robot + human).all(axis=1))
    here, there = (surface.closest_points(points) for points in (robot[both] / placed.scale, human[both]))
    found[both] = placed.scale * norms(here - there)
    return found
