"""Dots where a robot is inside an object, itself or the floor: on the surface above the place, so that they are seen.

Frames and links are those of the figures, and the deepest place of each has a dot; others are at some of a link's skin
points.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from hoi_retarget.evaluation.link_depths import pair_depths, placed_links
from hoi_retarget.evaluation.object_distances import distances_of_motion
from hoi_retarget.evaluation.self_penetration import looked_at
from hoi_retarget.evaluation.surface_distances import Poses, least_in_solid, tree_of
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import ObjectGeometry
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import LinkSkin, skin_of
from hoi_retarget.viewers.scene.drawing import Colour, Kind, Shapes

POINTS = 100  # Of a link's skin.
LEVELS: tuple[tuple[float, Colour], ...] = ((0.002, (255, 200, 40)), (0.005, (245, 120, 30)), (0.015, (215, 25, 30)))
"""Depth from which on a dot has a colour [m]."""
_RADIUS = 0.006  # [m]
_Dots = tuple[Float[np.ndarray, "T P 3"], Float[np.ndarray, "T P"]]
"""Places on surfaces in the world, and how deep the robot is under them [m]."""


def inside_marks(
    motion: Motion, model: RobotModel, geometries: tuple[ObjectGeometry, ...] | None
) -> tuple[Shapes, ...]:
    """Return the dots of each colour; objects of unknown shape have none."""
    kinematics = model.forward(motion.qpos)
    found = [*_in_floor(kinematics), *_in_links(kinematics), *_in_objects(motion, model, geometries or ())]
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


def _in_floor(kinematics: Kinematics) -> Iterator[_Dots]:
    for skin in skin_of(kinematics.model).links:
        pose = Poses.of_link(kinematics, skin)
        if ((pose.positions + pose.rotations @ skin.centre)[:, 2] < skin.radius).any():
            lowest = skin.extreme_points[(skin.extreme_points @ pose.rotations[:, 2].T).argmin(axis=0)]
            world = _placed(pose, _with(skin.points[:POINTS], lowest))
            yield world * [1.0, 1.0, 0.0], np.maximum(-world[..., 2], 0.0)


def _in_links(kinematics: Kinematics) -> Iterator[_Dots]:
    links = placed_links(kinematics)
    depths, pairs = pair_depths(links, links, looked_at(kinematics.model))
    for depth, (one, other) in zip(depths, pairs, strict=True):
        frames = np.flatnonzero(depth >= LEVELS[0][0])
        if len(frames):
            yield from (_in_link(kinematics, *pair, frames) for pair in ((one, other), (other, one)))


def _in_link(kinematics: Kinematics, skin: LinkSkin, around: LinkSkin, frames: np.ndarray) -> _Dots:
    outer = Poses.of_link(kinematics, around).at(frames)
    pose = Poses.of_link(kinematics, skin).at(frames).inside(outer)
    _, deepest = least_in_solid(tree_of(skin), around, pose)
    local = _placed(pose, _with(skin.points[:POINTS], deepest))
    depths = np.maximum(-around.solid.distances(local.reshape(-1, 3)).reshape(local.shape[:2]), 0.0)
    deep = depths >= LEVELS[0][0]
    local[deep] = around.points[KDTree(around.points).query(local[deep])[1]]
    return _at(frames, len(kinematics.qpos), _placed(outer, local), depths)


def _in_objects(motion: Motion, model: RobotModel, geometries: tuple[ObjectGeometry, ...]) -> Iterator[_Dots]:
    if not geometries:
        return
    distances, _ = distances_of_motion(motion, model, geometries)
    for index, placed in enumerate(distances.objects):
        shape, scale = placed.shape, placed.scale
        for skin in skin_of(model).links:
            pair = distances.pairs[skin.link, index]
            frames = np.flatnonzero(pair.depth >= LEVELS[0][0])
            if not len(frames):
                continue
            outer, own = placed.pose.at(frames), distances.poses[skin.link].at(frames)
            local = _placed(own.inside(outer), _with(skin.points[:POINTS], skin.points[pair.point[frames]])) / scale
            depths = np.maximum(-scale * shape.field.distances(local.reshape(-1, 3)).reshape(local.shape[:2]), 0.0)
            exact = np.maximum(-pair.skin[frames, None], 0.0)
            depths = np.append(np.minimum(depths[:, :-1], exact), exact, axis=1)
            deep = depths >= LEVELS[0][0]
            local[deep] = shape.surface.closest_points(local[deep])
            # A thin board goes through a link with no skin point inside it.
            back = outer.inside(own)
            sunk, through = least_in_solid(shape.tree, skin, Poses(back.positions / scale, back.rotations), scale)
            local, depths = (
                np.append(local, through[:, None], axis=1),
                np.append(depths, -scale * sunk[:, None], axis=1),
            )
            yield _at(frames, motion.frames, _placed(outer, scale * local), depths)


def _with(points: Float[np.ndarray, "P 3"], each: Float[np.ndarray, "F 3"]) -> Float[np.ndarray, "F Q 3"]:
    """Return points for each frame, and one more of its own."""
    return np.append(np.broadcast_to(points, (len(each), *points.shape)), each[:, None], axis=1)


def _placed(pose: Poses, points: Float[np.ndarray, "*frames P 3"]) -> Float[np.ndarray, "F P 3"]:
    return points @ pose.rotations.swapaxes(1, 2) + pose.positions[:, None]


def _at(frames: np.ndarray, count: int, places: np.ndarray, depths: np.ndarray) -> _Dots:
    """Return dots of some frames as those of all; in others they are nowhere deep."""
    every = np.zeros((count, *places.shape[1:])), np.zeros((count, *depths.shape[1:]))
    every[0][frames], every[1][frames] = places, depths
    return every
