"""Marks in the scene: contacts with gaps, standing feet, penetrations, a robot's sites and contact forces.

A penetration of an object, the robot itself or the floor has dots on the surface above it, so that they are visible: at
the deepest place of each frame and link, as the figures have it, and at some of a link's skin points.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.spatial import KDTree

from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.evaluation.penetration import self_collision_pairs
from hoi_retarget.evaluation.surface_distances import distances_of_motion
from hoi_retarget.motion.motion import ContactForces, Motion
from hoi_retarget.motion.motion_report import ELSEWHERE_M
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.objects.track import ObjectGeometry, ObjectTrack
from hoi_retarget.robots.link_depths import RigidPoses, least_in_solid, pair_depths, posed_links, tree_of
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import LinkSkin, skin_of
from hoi_retarget.robots.spec import FINGER_SITES, SIDES, SOLE_CORNERS
from hoi_retarget.studio.scene.drawing import Colour, Kind, Lines, Shapes

COLOURS: tuple[Colour, ...] = ((205, 60, 55), (70, 160, 75), (60, 100, 200))


def axes(
    positions: Float[np.ndarray, "T K 3"], quats: Float[np.ndarray, "T K 4"], length: float, radius: float
) -> Shapes:
    """Return the axes of K frames over time as cylinders: x red, y green, z blue.

    `positions`: [m]; `quats`: wxyz; `length`: of a cylinder [m]; `radius`: of a cylinder [m].
    """
    frames, count = positions.shape[:2]
    half = 0.5 * length
    turns = se3.exp(0.5 * np.pi * np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    places = positions[:, :, None] + se3.rotate(quats[:, :, None], half * np.eye(3))
    return Shapes.of(
        Kind.CYLINDER,
        (radius, radius, half),
        np.tile(COLOURS, (count, 1)),
        places.reshape(frames, 3 * count, 3),
        se3.quat_multiply(quats[:, :, None], turns).reshape(frames, 3 * count, 4),
    )


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
        shapes.append(Shapes.of(Kind.SPHERE, _RADIUS, colour, places, visible=visible))
    return tuple(shapes)


def _in_floor(kinematics: Kinematics) -> Iterator[_Dots]:
    for skin in skin_of(kinematics.model).links:
        pose = RigidPoses.of_link(kinematics, skin)
        if ((pose.positions + pose.rotations @ skin.centre)[:, 2] < skin.radius).any():
            lowest = skin.extreme_points[(skin.extreme_points @ pose.rotations[:, 2].T).argmin(axis=0)]
            world = _placed(pose, _with(skin.points[:POINTS], lowest))
            yield world * [1.0, 1.0, 0.0], np.maximum(-world[..., 2], 0.0)


def _in_links(kinematics: Kinematics) -> Iterator[_Dots]:
    links = posed_links(kinematics)
    depths, pairs = pair_depths(links, links, self_collision_pairs(kinematics.model))
    for depth, (one, other) in zip(depths, pairs, strict=True):
        frames = np.flatnonzero(depth >= LEVELS[0][0])
        if len(frames):
            yield from (_in_link(kinematics, *pair, frames) for pair in ((one, other), (other, one)))


def _in_link(kinematics: Kinematics, skin: LinkSkin, around: LinkSkin, frames: np.ndarray) -> _Dots:
    outer = RigidPoses.of_link(kinematics, around).at(frames)
    pose = RigidPoses.of_link(kinematics, skin).at(frames).relative_to(outer)
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
            points = _with(skin.points[:POINTS], skin.points[pair.point[frames]])
            local = _placed(own.relative_to(outer), points) / scale
            depths = np.maximum(-scale * shape.field.distances(local.reshape(-1, 3)).reshape(local.shape[:2]), 0.0)
            exact = np.maximum(-pair.skin[frames, None], 0.0)
            depths = np.append(np.minimum(depths[:, :-1], exact), exact, axis=1)
            deep = depths >= LEVELS[0][0]
            local[deep] = shape.surface.closest_points(local[deep])
            # A thin board goes through a link with no skin point inside it.
            tree = shape.tree_near(own.relative_to(outer), skin, scale)
            sunk, through = least_in_solid(tree, skin, outer.relative_to(own), scale)
            local = np.append(local, through[:, None], axis=1)
            depths = np.append(depths, -scale * sunk[:, None], axis=1)
            yield _at(frames, motion.frames, _placed(outer, scale * local), depths)


def _with(points: Float[np.ndarray, "P 3"], each: Float[np.ndarray, "F 3"]) -> Float[np.ndarray, "F Q 3"]:
    """Return points for each frame, and one more of its own."""
    return np.append(np.broadcast_to(points, (len(each), *points.shape)), each[:, None], axis=1)


def _placed(pose: RigidPoses, points: Float[np.ndarray, "*frames P 3"]) -> Float[np.ndarray, "F P 3"]:
    return points @ pose.rotations.swapaxes(1, 2) + pose.positions[:, None]


def _at(frames: np.ndarray, count: int, places: np.ndarray, depths: np.ndarray) -> _Dots:
    """Return dots of some frames as those of all; in others they are nowhere deep."""
    every = np.zeros((count, *places.shape[1:])), np.zeros((count, *depths.shape[1:]))
    every[0][frames], every[1][frames] = places, depths
    return every


SMALL_GAP, LARGE_GAP = 0.01, 0.05  # [m]
_GREEN, _YELLOW, _RED = (46, 178, 82), (245, 196, 40), (222, 52, 44)
_LEVELS = 9  # Shapes keep their colour: a ball that changes its own is one of so many.
_TARGET_RADIUS, _SITE_RADIUS = 0.035, 0.012  # [m]
_PATCH = np.array([0.035, 0.035, 0.003])  # Half extents of a round one [m].
_OF_FINGERS = 0.25  # Size of their marks over that of hands'.
_DOWN = -1.0 + 1e-9
_STANCE: Colour = (60, 150, 200)
_STANCE_MARGIN, _STANCE_HALF_HEIGHT = 0.012, 0.006  # [m]


def gap_colour(gap: Float[np.ndarray, "*batch"]) -> UInt8[np.ndarray, "*batch 3"]:
    """Return the colour of a distance [m]: green up to 1 cm, through yellow, to red from 5 cm on."""
    share = (gap - SMALL_GAP) / (LARGE_GAP - SMALL_GAP)
    mixed = [np.interp(share, (0.0, 0.5, 1.0), stops) for stops in zip(_GREEN, _YELLOW, _RED, strict=True)]
    return np.round(np.stack(mixed, axis=-1)).astype(np.uint8)


def contact_marks(
    motion: Motion, kinematics: Kinematics, geometries: Sequence[ObjectGeometry] | None
) -> tuple[Shapes, Shapes, Lines] | tuple[()]:
    """Return, for each active contact, a patch on the object's surface, a ball at the robot's site, and a line.

    The patch is where the surface is nearest to the target, which the line leads to from the site. Where shapes are not
    known, a ball is at the target itself. Where nothing is ever touched, there is nothing.
    """
    active = motion.contact_flags & (motion.contact_object >= 0)
    links = np.flatnonzero(active.any(axis=0))
    if len(links) == 0:
        return ()
    active, touched = active[:, links], np.where(active, motion.contact_object, 0)[:, links]
    frames = np.arange(motion.frames)[:, None]
    points = np.where(active[..., None], motion.contact_points[:, links], 0.0)
    place, turn = motion.object_pos[frames, touched], motion.object_quat[frames, touched]
    sites = np.stack([kinematics.site_position(motion.contact_links[link]) for link in links], axis=1)
    targets = np.where(active[..., None], place + se3.rotate(turn, points), sites)
    gaps = np.linalg.norm(targets - sites, axis=-1)
    if motion.report.touches_with_surfaces and geometries is not None:
        # Sites lie under the skin, which touches; contacts elsewhere keep the sites' distances.
        skin = np.abs(distances_of_motion(motion, kinematics.model, tuple(geometries))[1][:, links])
        gaps = np.where(np.isfinite(skin) & (gaps <= ELSEWHERE_M), skin, gaps)
    still = np.broadcast_to(se3.IDENTITY_QUAT, turn.shape)
    sizes = np.array([[_OF_FINGERS if motion.contact_links[link] in FINGER_SITES else 1.0] for link in links])
    if geometries is None:
        aims = _coloured(Kind.SPHERE, sizes * np.full(3, _TARGET_RADIUS), targets, still, gaps, active)
    else:
        scales = motion.object_scale[touched][..., None]
        on_surface, tilts = _patches(points / scales, touched, active, geometries)
        patches = place + se3.rotate(turn, scales * on_surface)
        aims = _coloured(Kind.CYLINDER, sizes * _PATCH, patches, se3.quat_multiply(turn, tilts), gaps, active)
    radius = _TARGET_RADIUS if geometries is None else _SITE_RADIUS
    balls = _coloured(Kind.SPHERE, sizes * np.full(3, radius), sites, still, gaps, active)
    return aims, balls, Lines(targets.astype(np.float32), sites.astype(np.float32), gap_colour(gaps), active)


def stance_marks(motion: Motion, kinematics: Kinematics) -> Shapes:
    """Return a plate around the sole of each foot, there while the foot is to stand."""
    middles, quats, sizes = [], [], []
    for side in SIDES:
        corners = np.stack([kinematics.site_position(f"{side}_sole_{corner}") for corner in SOLE_CORNERS], axis=1)
        turn = kinematics.site_rotation(f"{side}_foot")
        within = corners @ turn  # In the foot's axes: the same in every frame.
        low, high = within.min(axis=1), within.max(axis=1)
        middle = 0.5 * (low + high)
        middle[:, 2] += _STANCE_HALF_HEIGHT
        middles.append(np.einsum("tij,tj->ti", turn, middle))
        quats.append(se3.matrix_to_quat(turn))
        half = 0.5 * (high - low)[0] + _STANCE_MARGIN
        sizes.append([half[0], half[1], _STANCE_HALF_HEIGHT])
    places, turns = np.stack(middles, axis=1), np.stack(quats, axis=1)
    return Shapes.of(Kind.BOX, sizes, _STANCE, places, turns, motion.stance_flags)


def human_contact_marks(contacts: tuple[ContactTrack, ...], objects: tuple[ObjectTrack, ...]) -> tuple[Shapes, ...]:
    """Return a patch on the surface next to each contact of a person; none where nothing is touched."""
    touching = [track for track in contacts if track.active.any()]
    if not touching:
        return ()
    active = np.stack([track.active for track in touching], axis=1)
    points = np.where(active[..., None], np.stack([track.contact_points for track in touching], axis=1), 0.0)
    touched = np.broadcast_to([track.object for track in touching], active.shape)
    on_surface, tilts = _patches(points, touched, active, [track.geometry for track in objects])
    place = np.stack([objects[track.object].positions for track in touching], axis=1)
    turn = np.stack([objects[track.object].quats for track in touching], axis=1)
    patches = place + se3.rotate(turn, on_surface)
    return (_coloured(Kind.CYLINDER, _PATCH, patches, se3.quat_multiply(turn, tilts), np.zeros(active.shape), active),)


def _patches(
    points: Float[np.ndarray, "T C 3"],
    touched: Int[np.ndarray, "T C"],
    active: Bool[np.ndarray, "T C"],
    geometries: Sequence[ObjectGeometry],
) -> tuple[Float[np.ndarray, "T C 3"], Float[np.ndarray, "T C 4"]]:
    """Return the place next to points on the surfaces of the objects they belong to [m], and rotations that lie on it.

    Everything in the objects' frames at captured size; a rotation takes z to the surface's normal.
    """
    places, normals = np.zeros(points.shape), np.tile([0.0, 0.0, 1.0], (*active.shape, 1))
    for index, geometry in enumerate(geometries):
        own = active & (touched == index)
        if own.any():
            surface = surface_of(geometry)
            places[own], normals[own] = surface.closest_points(points[own]), surface.normals(points[own])
    return places, rotations_to(normals)


def rotations_to(normals: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 4"]:
    """Return the shortest rotation that takes z to each unit vector."""
    x, y, z = np.moveaxis(normals, -1, 0)
    # Straight down, half a turn about x.
    down = z < _DOWN
    quats = np.stack([1.0 + z, -y, x, np.zeros_like(z)], axis=-1)
    return se3.quat_normalize(np.where(down[..., None], [0.0, 1.0, 0.0, 0.0], quats))


def _coloured(  # noqa: PLR0913, PLR0917 - what a mark is made of
    kind: Kind,
    size: Float[np.ndarray, "C 3"] | Float[np.ndarray, "3"],
    places: Float[np.ndarray, "T C 3"],
    quats: Float[np.ndarray, "T C 4"],
    gaps: Float[np.ndarray, "T C"],
    active: Bool[np.ndarray, "T C"],
) -> Shapes:
    """Return a mark for each contact, one of every colour, of which the one of the gap's colour is there."""
    levels = np.linspace(SMALL_GAP, LARGE_GAP, _LEVELS)
    level = np.abs(gaps[..., None] - levels).argmin(axis=-1)
    there = active[..., None] & (level[..., None] == np.arange(_LEVELS))
    used = np.flatnonzero(there.any(axis=(0, 1)))
    count, contacts = len(used), active.shape[1]
    return Shapes.of(
        kind,
        np.repeat(np.broadcast_to(size, (contacts, 3)), count, axis=0),
        np.tile(gap_colour(levels[used]), (contacts, 1)),
        np.repeat(places, count, axis=1),
        np.repeat(quats, count, axis=1),
        there[..., used].reshape(len(active), contacts * count),
    )


_BALL: Colour = (30, 32, 38)
_BALL_RADIUS, _AXIS_RADIUS = 0.16, 0.06  # In lengths of the axes.


def site_marks(kinematics: Kinematics, sites: Sequence[str], length: float) -> tuple[Shapes, Shapes]:
    """Return marks of sites over time, with axes of a length [m]."""
    places = np.stack([kinematics.site_position(site) for site in sites], axis=1)
    quats = np.stack([se3.matrix_to_quat(kinematics.site_rotation(site)) for site in sites], axis=1)
    balls = Shapes.of(Kind.SPHERE, _BALL_RADIUS * length, _BALL, places, quats)
    return balls, axes(places, quats, length, _AXIS_RADIUS * length)


ARROW_LENGTH = 0.002  # Of an arrow [m/N]: the weight of a robot of 33 kg is 65 cm long.
_MIN_FORCE_N = 2.0  # Of an arrow.
_FORCE_COLOUR: Colour = (196, 40, 170)
_HEAD, _MAX_HEAD_LENGTH = 0.25, 0.05  # Of an arrow, and [m].
_MIN_NORM = 1e-9


def force_arrows(forces: ContactForces) -> tuple[Lines, ...]:
    """Return an arrow for each body, from where its force acts; none where nothing is touched.

    An arrow is a shaft and two strokes of a head.
    """
    sizes = np.linalg.norm(forces.forces, axis=2)
    there = sizes >= _MIN_FORCE_N
    if not there.any():
        return ()
    ends = forces.points + ARROW_LENGTH * forces.forces
    along = forces.forces / np.maximum(sizes, _MIN_NORM)[..., None]
    # Across the arrow and level, or along y where the arrow is upright.
    across = np.stack([-along[..., 1], along[..., 0], np.zeros_like(sizes)], axis=2)
    level = np.linalg.norm(across, axis=2, keepdims=True)
    across = np.where(level > 0.1, across / np.maximum(level, _MIN_NORM), [0.0, 1.0, 0.0])
    head = np.minimum(_HEAD * ARROW_LENGTH * sizes, _MAX_HEAD_LENGTH)[..., None]
    strokes = [ends - head * (along + side * 0.5 * across) for side in (1.0, -1.0)]
    starts = np.concatenate([forces.points, ends, ends], axis=1)
    stops = np.concatenate([ends, *strokes], axis=1)
    colours = np.broadcast_to(np.array(_FORCE_COLOUR, dtype=np.uint8), starts.shape)
    return (Lines(starts.astype(np.float32), stops.astype(np.float32), colours, np.tile(there, (1, 3))),)
