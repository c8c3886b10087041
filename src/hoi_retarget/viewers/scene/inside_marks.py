"""Dots where a robot is inside an object or under the floor: on the surface above the place, so that they are seen.

Some points of each link's skin are looked at, by the objects' distance fields; figures look at all, and at triangles.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.objects.distance_field import DistanceField, distance_field
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import LinkSkin, skin_of
from hoi_retarget.viewers.scene.drawing import Colour, Kind, Shapes

POINTS = 100  # Of a link's skin.
LEVELS: tuple[tuple[float, Colour], ...] = ((0.002, (255, 200, 40)), (0.005, (245, 120, 30)), (0.015, (215, 25, 30)))
"""Depth from which on a dot has a colour [m]."""
_RADIUS = 0.006  # [m]
_Sunk = tuple[int | None, Float[np.ndarray, "T P 3"], Float[np.ndarray, "T P"]]


def inside_marks(
    motion: Motion, model: RobotModel, geometries: tuple[ObjectGeometry, ...] | None
) -> tuple[Shapes, ...]:
    """Return the dots of each colour; objects of unknown shape have none."""
    found = [(places, depths) for _, places, depths in _all_sunk(motion, model, geometries or ())]
    bounds = [*(least for least, _ in LEVELS), np.inf]
    shapes = []
    for (least, colour), most in zip(LEVELS, bounds[1:], strict=True):
        there = [(depths >= least) & (depths < most) for _, depths in found]
        ever = [np.flatnonzero(mask.any(axis=0)) for mask in there]
        if not any(len(columns) for columns in ever):
            continue
        places = np.concatenate([item[0][:, columns] for item, columns in zip(found, ever, strict=True)], axis=1)
        visible = np.concatenate([mask[:, columns] for mask, columns in zip(there, ever, strict=True)], axis=1)
        count = places.shape[1]
        shapes.append(
            Shapes(
                Kind.SPHERE,
                np.full((count, 3), _RADIUS, dtype=np.float32),
                np.tile(np.array(colour, dtype=np.uint8), (count, 1)),
                places.astype(np.float32),
                np.broadcast_to(se3.IDENTITY_QUAT.astype(np.float32), (*places.shape[:2], 4)),
                visible,
            )
        )
    return tuple(shapes)


def depth_in_objects(
    motion: Motion, model: RobotModel, geometries: tuple[ObjectGeometry, ...]
) -> Float[np.ndarray, "T"]:
    """Return the depth of the deepest of those points in any object, in every frame [m]."""
    own = (depths.max(axis=1) for what, _, depths in _all_sunk(motion, model, geometries) if what is not None)
    return np.max([np.zeros(motion.frames), *own], axis=0)


@lru_cache(maxsize=2)
def _all_sunk(motion: Motion, model: RobotModel, geometries: tuple[ObjectGeometry, ...]) -> tuple[_Sunk, ...]:
    """Return what `_sunk` yields for all links: marks and curve show the same."""
    kinematics = model.forward(motion.qpos)
    scales = motion.object_scale[: len(geometries)].tolist()
    fields = [distance_field(geometry).scaled(scale) for geometry, scale in zip(geometries, scales, strict=True)]
    return tuple(
        found for skin in skin_of(model).links for found in _sunk(skin, motion, kinematics, geometries, fields)
    )


def _sunk(
    skin: LinkSkin,
    motion: Motion,
    kinematics: Kinematics,
    geometries: Sequence[ObjectGeometry],
    fields: Sequence[DistanceField],
) -> Iterator[_Sunk]:
    """Yield, for each object that a link is ever near to, its index, places on its surface and depths [m].

    For the floor it is None.
    """
    turns = kinematics.orientation(skin.frame).transpose(2, 0, 1)
    origins = kinematics.point(skin.frame).T
    centres = origins + turns @ skin.centre
    objects = []
    for index, field in enumerate(fields):
        away = se3.rotate_inverse(motion.object_quat[:, index], centres - motion.object_pos[:, index])
        objects.append((index, field, np.flatnonzero(field.distances(away) < skin.radius)))
    if (centres[:, 2] >= skin.radius).all() and not any(len(near) for _, _, near in objects):
        return
    world = origins[:, None] + skin.points[:POINTS] @ turns.swapaxes(1, 2)
    yield None, world * [1.0, 1.0, 0.0], np.maximum(-world[..., 2], 0.0)
    for index, field, near in (item for item in objects if len(item[2])):
        place, turn = motion.object_pos[near, None, index], motion.object_quat[near, None, index]
        local = se3.rotate_inverse(turn, world[near] - place)
        depths = np.zeros(world.shape[:2])
        depths[near] = np.maximum(-field.distances(local.reshape(-1, 3)).reshape(local.shape[:2]), 0.0)
        deep = depths[near] >= LEVELS[0][0]
        scale = float(motion.object_scale[index])
        local[deep] = scale * surface_of(geometries[index]).closest_points(local[deep] / scale)
        places = world.copy()
        places[near] = place + se3.rotate(turn, local)
        yield index, places, depths
