"""Where forces can act on a robot and its objects in each frame of a motion.

- Soles' corners, of a foot that stands or that are on the floor; each other link's lowest point where it is there.
- Up to four points of a hand or foot that is labelled to touch an object, spread over its skin near the surface. Where
  all of it is further off than `REACH`, it touches nothing.
- Up to six of an object's lowest points, where they are on the floor. One that slides there is braked: its friction
  acts against the motion, and pushes nothing.

All are points of contact between two surfaces that may be some millimetres apart or sunk: a force acts on the object's
surface, or on the floor.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.dynamics.object_support import braking_directions
from hoi_retarget.errors import RobotError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.objects.distance_field import DistanceField, distance_field
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.frames import Frame
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin, extreme_points, lowest_skin, skin_of, skins_from
from hoi_retarget.robots.spec import FINGER_SITES, SIDES, SOLE_CORNERS

REACH = 0.02  # A link whose skin is further off an object than this [m] does not touch it.
_MAX_STANCE_HEIGHT, _MAX_FLOOR_HEIGHT = 0.02, 0.005
"""Heights up to which a corner of a foot that stands, and any other point, is on the floor [m]."""
_MAX_OBJECT_HEIGHT = 0.015  # The same of an object, whose shape is known less well.
_PATCH_DEPTH = 0.008  # Skin that is so much further off than the nearest is in contact, too [m].
_SKIN_POINTS = 150  # Of a link: 7 mm apart on a hand.
_HAND_POINTS, _OBJECT_POINTS = 4, 6
_FRAMES_AT_ONCE = 500
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """One possible contact over T frames."""

    name: str  # Site or link of the robot, or the object's name where it is on the floor.
    link: Frame | None  # The robot's frame that a force acts on; None where the robot has no part in it.
    object: int | None
    """The object that the opposite force acts on, or the force itself where there is no link; None for the floor."""
    active: Bool[np.ndarray, "T"]
    position: Float[np.ndarray, "T 3"]  # In the world [m].
    normal: Float[np.ndarray, "T 3"]  # Unit vector into what the force acts on: the robot, or an object on the floor.
    braking: Float[np.ndarray, "T 3"] | None = None
    """Direction of the friction where it slides, and zero where it does not; None for points that never do."""

    @property
    def on_floor(self) -> bool:
        """Whether it is between the floor and something."""
        return self.link is None or self.object is None


def contact_points(
    motion: Motion, kinematics: Kinematics, geometries: Sequence[ObjectGeometry]
) -> tuple[ContactPoint, ...]:
    """Return all points that are in contact in some frame of a motion; `geometries` are the shapes of its objects.

    Raises `GeometryError` when an object's mesh cannot be read.
    """
    found = (
        *_soles(motion, kinematics),
        *_links_on_floor(kinematics),
        *_touching(motion, kinematics, geometries),
        *_objects_on_floor(motion, geometries),
    )
    return tuple(point for point in found if point.active.any())


def _soles(motion: Motion, kinematics: Kinematics) -> Iterator[ContactPoint]:
    for column, side in enumerate(SIDES):
        for corner in SOLE_CORNERS:
            name = f"{side}_sole_{corner}"
            position = kinematics.site_position(name)
            height = position[:, 2]
            active = (height < _MAX_FLOOR_HEIGHT) | (motion.stance_flags[:, column] & (height < _MAX_STANCE_HEIGHT))
            yield ContactPoint(name, kinematics.frame(name), None, active, position, _upward(active))


def _links_on_floor(kinematics: Kinematics) -> Iterator[ContactPoint]:
    feet = {kinematics.frame(f"{side}_foot").node for side in SIDES}
    links = [skin for skin in skin_of(kinematics.model).links if skin.frame.node not in feet]
    places = [[lowest_skin(part, skin) for skin in links] for part in kinematics.parts()]
    for skin, *parts in zip(links, *places, strict=True):
        position = np.concatenate(parts, axis=1).T
        active = position[:, 2] < _MAX_FLOOR_HEIGHT
        yield ContactPoint(skin.link, skin.frame, None, active, position, _upward(active))


def _objects_on_floor(motion: Motion, geometries: Sequence[ObjectGeometry]) -> Iterator[ContactPoint]:
    for index, name in enumerate(motion.object_names):
        corners = motion.object_scale[index] * extreme_points(geometries[index].points)
        places, rotations = motion.object_pos[:, index], se3.quat_to_matrix(motion.object_quat[:, index])
        found = []
        for first in range(0, motion.frames, _FRAMES_AT_ONCE):
            frames = slice(first, first + _FRAMES_AT_ONCE)
            placed = places[frames, None] + np.einsum("tij,kj->tki", rotations[frames], corners)
            height = placed[:, :, 2]
            near = height < np.minimum(_MAX_OBJECT_HEIGHT, height.min(axis=1, keepdims=True) + _MAX_FLOOR_HEIGHT)
            found.append(_spread(placed, near, height, _OBJECT_POINTS))
        before, after = np.arange(-1, motion.frames - 1).clip(0), np.arange(1, motion.frames + 1)
        after = after.clip(0, motion.frames - 1)
        for chosen in map(np.concatenate, zip(*found, strict=True)):
            active, own = chosen >= 0, corners[chosen]
            here, back, ahead = (
                places[at] + np.einsum("tij,tj->ti", rotations[at], own) for at in (np.arange(len(own)), before, after)
            )
            velocity = motion.fps * (ahead - back) / np.maximum(after - before, 1)[:, None]
            yield ContactPoint(name, None, index, active, here, _upward(active), braking_directions(velocity))


def _touching(motion: Motion, kinematics: Kinematics, geometries: Sequence[ObjectGeometry]) -> Iterator[ContactPoint]:
    for column, link in enumerate(motion.contact_links):
        for index in range(len(motion.object_names) if link not in FINGER_SITES else 0):  # They are the hand's.
            labelled = motion.labelled(index)[:, column]
            if labelled.any():
                yield from _patch(motion, kinematics, geometries[index], (column, index), labelled)


def _patch(
    motion: Motion,
    kinematics: Kinematics,
    geometry: ObjectGeometry,
    pair: tuple[int, int],
    labelled: Bool[np.ndarray, "T"],
) -> Iterator[ContactPoint]:
    """Yield the points of one contact link and one object that touch in some of the labelled frames."""
    column, index = pair
    site, frames = motion.contact_links[column], np.flatnonzero(labelled)
    skins = skins_from(kinematics.model, site)
    if not skins:
        raise RobotError(f"{motion.robot}: the link of {site} has no shape, so nothing tells where it touches.")
    shape = distance_field(geometry), float(motion.object_scale[index])
    blocks = [frames[first : first + _FRAMES_AT_ONCE] for first in range(0, len(frames), _FRAMES_AT_ONCE)]
    found = [_patch_in(motion, kinematics, skins, shape, index, block) for block in blocks]
    for number in range(_HAND_POINTS):
        patches = [item[number] for item in found]
        link, surface, outward = (np.concatenate(parts) for parts in zip(*patches, strict=True))
        for which, skin in enumerate(skins):
            active, position = np.zeros(motion.frames, dtype=bool), np.zeros((motion.frames, 3))
            normal = _upward(active)
            active[frames], position[frames], normal[frames] = link == which, surface, outward
            yield ContactPoint(site, skin.frame, index, active, position, normal)


def _patch_in(  # noqa: PLR0913, PLR0917  # the parts of a patch
    motion: Motion,
    kinematics: Kinematics,
    skins: tuple[LinkSkin, ...],
    shape: tuple[DistanceField, float],
    index: int,
    frames: Int[np.ndarray, "F"],
) -> list[tuple[Int[np.ndarray, "F"], Float[np.ndarray, "F 3"], Float[np.ndarray, "F 3"]]]:
    """Return the points of a patch in some frames: the skin of each, or -1, its place and its normal in the world."""
    field, scale = shape
    placed = np.concatenate(
        [
            kinematics.point(skin.frame).T[frames, None]
            + np.einsum("ijt,kj->tki", kinematics.orientation(skin.frame)[:, :, frames], skin.points[:_SKIN_POINTS])
            for skin in skins
        ],
        axis=1,
    )
    links = np.concatenate([np.full(len(skin.points[:_SKIN_POINTS]), number) for number, skin in enumerate(skins)])
    rotations, origin = se3.quat_to_matrix(motion.object_quat[frames, index]), motion.object_pos[frames, index, None]
    inside = (placed - origin) @ rotations
    distance = scale * field.distances(inside.reshape(-1, 3) / scale).reshape(inside.shape[:2])
    near = distance < np.minimum(REACH, distance.min(axis=1, keepdims=True) + _PATCH_DEPTH)
    rows, found = np.arange(len(frames)), []
    for chosen in _spread(inside, near, distance, _HAND_POINTS):
        away, outward = field.distances_and_normals(inside[rows, chosen] / scale)
        surface = inside[rows, chosen] - scale * away[:, None] * outward
        place, normal = (np.einsum("tij,tj->ti", rotations, part) for part in (surface, outward))
        found.append((np.where(chosen >= 0, links[chosen], -1), origin[:, 0] + place, normal))
    return found


def _spread(
    points: Float[np.ndarray, "T K 3"], near: Bool[np.ndarray, "T K"], first: Float[np.ndarray, "T K"], count: int
) -> list[Int[np.ndarray, "T"]]:
    """Return the indices of near points: the one with the least value, then the farthest from the chosen ones each.

    They are -1 where no point is left.
    """
    rows = np.arange(len(points))
    chosen = np.where(near, first, np.inf).argmin(axis=1)
    away = np.where(near, np.inf, -1.0)
    found = []
    for _ in range(count):
        left = away[rows, chosen] > _MAX_FLOOR_HEIGHT
        found.append(np.where(left, chosen, -1))
        away = np.minimum(away, np.linalg.norm(points - points[rows, chosen][:, None], axis=2))
        chosen = away.argmax(axis=1)
    return found


def _upward(active: Bool[np.ndarray, "T"]) -> Float[np.ndarray, "T 3"]:
    return np.tile(_UP, (len(active), 1))
