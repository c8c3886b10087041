"""Grip margin: the acceleration, in the direction that is worst, with which hands on an object can still move it.

The hands' forces lie in friction cones where they touch, and a hand presses with `LARGEST_PRESS` at most; the floor
helps. Directions are the corners of an icosahedron; an object that cannot be moved as it moves has no margin. Beside it
stands the force closure of the same touch, without weight, floor and largest force (Ferrari and Canny, ICRA 1992).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Bool, Float, Int

from hoi_retarget.clip.clip import Clip
from hoi_retarget.dynamics.feasibility import not_free
from hoi_retarget.dynamics.free_hands import LARGEST_GAP, PATCH_DEPTH, PATCH_POINTS, bent_skin, spread, touch_of
from hoi_retarget.dynamics.inverse_dynamics import GRAVITY
from hoi_retarget.dynamics.object_support import PYRAMID_EDGES, ObjectLoad, friction_edges, object_load
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.human.capsules import PART_CAPSULES, Spheres, spheres
from hoi_retarget.human.person import Person
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import nearest_active, seconds_to_frames
from hoi_retarget.numerics.linear_program import least_costs
from hoi_retarget.objects.distance_field import distance_field
from hoi_retarget.objects.track import ObjectTrack
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import PALMS

LARGEST_PRESS = 40.0  # Of a hand, along the surface's normals [N].
LARGEST_MARGIN = 2.0  # More does not count [g].
STRIDE_SECONDS = 1 / 3  # Between frames that are looked at; others have the margin of the nearest one.
FRAMES_AT_ONCE = 40  # That are looked at together: their memory does not grow with the clip's length.
BLOCK_FRAMES = 1000  # Of a person whose hand is made of spheres at once.
FORCE_COST, MISSING_COST = 1e-5, 100.0
"""Of forces and of what is missing, both in weights of the object, against a margin of 1 g."""
FLAT = 1e-6  # Wrenches that differ less in a direction do nothing in it; a hull with less around nothing is flat.
HELD_SHARE = 1e-3  # Of the object's weight; with more missing it cannot be moved.
GOLDEN = 0.5 * (1.0 + np.sqrt(5.0))
DIRECTIONS = np.array(
    [np.roll([0.0, one, golden], turn) for turn in range(3) for one in (1.0, -1.0) for golden in (GOLDEN, -GOLDEN)]
) / np.hypot(1.0, GOLDEN)
"""Unit vectors."""

Touching = tuple[Float[np.ndarray, "_ 3"], Float[np.ndarray, "_ 3"]]
"""Points of a hand on a surface [m], and directions into the object there."""
NOWHERE = (np.zeros((0, 3)), np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class GripMargin:
    """The grip margin of an object's hands over T frames [g]; NaN where none is labelled to touch, or others do."""

    object: int
    robot: Float[np.ndarray, "T"]
    human: Float[np.ndarray, "T"]
    """That of the person's palms and fingers, as capsules, with the same friction and force."""
    robot_closure: Float[np.ndarray, "T"]
    """Epsilon of all hands' force closure: 0 where some force or moment on the object cannot be met, however small."""
    human_closure: Float[np.ndarray, "T"]

    def text(self, name: str) -> str:
        """Return it in words for an object's name."""
        robot, human = (own[np.isfinite(own)] for own in (self.robot, self.human))
        nothing = 100.0 * np.mean(robot == 0.0)
        lost = f"; none in {nothing:.0f} % of the time" if nothing else ""
        sides = (own[np.isfinite(own)] for own in (self.robot_closure, self.human_closure))
        closed, by_person = (f"{100.0 * np.mean(own > 0.0):.0f} %" for own in sides)
        margins = f"{robot.mean():.2f} g on average{lost} (the person's: {human.mean():.2f} g)"
        return f"grip margin at the {name}: {margins}; force closure in {closed} of the time ({by_person})"


def grip_margins(motion: Motion, clip: Clip, kinematics: Kinematics, physics: Physics) -> tuple[GripMargin, ...]:
    """Return the grip margins of a motion's objects that the robot's hands are labelled to touch, and nobody else.

    Raises `RobotError`: the robot's hands have no shapes; `GeometryError`: an object's mesh cannot be read.
    """
    others, found = not_free(clip, motion.person), []
    columns = [column for column, site in enumerate(motion.contact_links) if site in PALMS]
    sites = [motion.contact_links[column] for column in columns]
    for index, track in enumerate(clip.objects):
        labelled = (motion.labelled(index) & ~others[:, index, None])[:, columns]
        if not labelled.any():
            continue
        sides = (
            (
                (float(motion.object_scale[index]), (motion.object_pos[:, index], motion.object_quat[:, index])),
                [_robot_touching(motion, kinematics, track, index, site) for site in sites],
            ),
            (
                (1.0, (track.positions, track.quats)),
                [_human_touching(clip.people[motion.person], track, site) for site in sites],
            ),
        )
        rest = motion.fps, physics.hand_friction
        margins = (
            _margin(object_load(track.name, track.geometry, *placed, motion.fps, physics), hands, labelled, *rest)
            for placed, hands in sides
        )
        (robot, robot_closure), (human, human_closure) = margins
        found.append(GripMargin(index, robot, human, robot_closure, human_closure))
    return tuple(found)


def _margin(
    load: ObjectLoad,
    hands: Sequence[Callable[[int], Touching]],
    labelled: Bool[np.ndarray, "T H"],
    fps: float,
    friction: float,
) -> Float[np.ndarray, "2 T"]:
    """Return the margin [g] and closure of hands in the frames in which they are labelled; NaN in others."""
    frames = np.flatnonzero(labelled.any(axis=1))
    looked = frames[:: seconds_to_frames(STRIDE_SECONDS, fps)]
    found = []
    for first in range(0, len(looked), FRAMES_AT_ONCE):
        block = looked[first : first + FRAMES_AT_ONCE]
        touching = [
            [at(frame) if labelled[frame, hand] else NOWHERE for frame in block.tolist()]
            for hand, at in enumerate(hands)
        ]
        found.append([grip_margin(load, block, touching, friction), closure(load, block, touching, friction)])
    values, seen = np.full((2, len(labelled)), np.nan), np.zeros(len(labelled), dtype=bool)
    values[:, looked], seen[looked] = np.concatenate(found, axis=1), True
    values[:, frames] = values[:, nearest_active(seen)[frames]]
    return values


def _robot_touching(
    motion: Motion, kinematics: Kinematics, track: ObjectTrack, index: int, site: str
) -> Callable[[int], Touching]:
    """Return where a robot's hand touches in a frame, in the world."""
    field, scale = distance_field(track.geometry), motion.object_scale[index]
    positions, rotations = kinematics.site_position(site), kinematics.site_rotation(site)

    def at(frame: int) -> Touching:
        turn, origin = se3.quat_to_matrix(motion.object_quat[frame, index]), motion.object_pos[frame, index]
        palm = turn.T @ (positions[frame] - origin), turn.T @ rotations[frame]
        touch = touch_of(bent_skin(kinematics, site, frame), field, *palm, float(scale))
        return touch.points @ turn.T + origin, touch.inward @ turn.T

    return at


def _human_touching(person: Person, track: ObjectTrack, site: str) -> Callable[[int], Touching]:
    """Return where a person's palm and fingers touch in a frame, in the world."""
    capsules, field = PART_CAPSULES[site.replace("palm", "hand")], distance_field(track.geometry)

    @lru_cache(maxsize=1)
    def hand_in(block: int) -> Spheres:
        return spheres(person.window(block * BLOCK_FRAMES, (block + 1) * BLOCK_FRAMES), capsules)

    def at(frame: int) -> Touching:
        turn, origin = se3.quat_to_matrix(track.quats[frame]), track.positions[frame]
        hand = hand_in(frame // BLOCK_FRAMES)
        middles = (hand.middles[frame % BLOCK_FRAMES] - origin) @ turn
        away, normals = field.distances_and_normals(middles)
        gaps = away - hand.radii
        near = np.flatnonzero(gaps < PATCH_DEPTH + np.clip(gaps.min(), 0.0, LARGEST_GAP))
        if not near.size:
            return NOWHERE
        kept = near[spread(middles[near], int(gaps[near].argmin()))]
        surface = middles[kept] - away[kept, None] * normals[kept]
        return surface @ turn.T + origin, -normals[kept] @ turn.T

    return at


def grip_margin(
    load: ObjectLoad, frames: Int[np.ndarray, "F"], touching: Sequence[Sequence[Touching]], friction: float
) -> Float[np.ndarray, "F"]:
    """Return the margins of hands on one object in some frames of a load [g].

    `touching` is that of each hand in each of these frames, in the world.
    """
    hands, corners = len(touching), load.floor_points.shape[1]
    of_hand, weight = PATCH_POINTS * PYRAMID_EDGES, load.required.mass * GRAVITY
    forces = hands * of_hand + corners * PYRAMID_EDGES
    margin = forces + hands + 1
    matrix = np.zeros((len(frames), 6 + hands + 1, margin + 1 + 12))
    unit = np.repeat([1.0, 1.0 / load.length], 3)[:, None]
    for row, frame in enumerate(frames.tolist()):
        on_floor, centre = load.on_floor[frame], load.required.centre[frame]
        parts = [(*own[row], friction_edges(own[row][1], friction)) for own in touching]
        for hand, (points, _, edges) in enumerate(parts):
            first = hand * of_hand
            effects = _effects(points, edges, centre) * unit
            matrix[row, :6, first : first + effects.shape[1]] = effects
            matrix[row, 6 + hand, first : first + effects.shape[1]] = 1.0
        floor = _effects(load.floor_points[frame, on_floor], load.floor_edges[frame, on_floor], centre) * unit
        matrix[row, :6, hands * of_hand : hands * of_hand + floor.shape[1]] = floor
    matrix[:, 6:, forces:margin] = np.eye(hands + 1)
    matrix[:, -1, margin] = 1.0
    matrix[:, :6, margin + 1 :] = np.concatenate([np.eye(6), -np.eye(6)], axis=1)
    costs = np.concatenate([np.full(forces, FORCE_COST), np.zeros(hands + 1), [-1.0], np.full(12, MISSING_COST)])
    needed = load.required.wrench[frames] / weight * unit[:, 0]
    targets = np.concatenate(
        [needed, np.tile([*[LARGEST_PRESS / weight] * hands, LARGEST_MARGIN], (len(frames), 1))], axis=1
    )
    every = np.repeat(matrix, len(DIRECTIONS), axis=0)
    every[:, :3, margin] = -np.tile(DIRECTIONS, (len(frames), 1))
    found = least_costs(costs, every, np.repeat(targets, len(DIRECTIONS), axis=0))
    held = found[:, margin + 1 :].sum(axis=1) < HELD_SHARE
    return np.where(held, found[:, margin], 0.0).reshape(len(frames), -1).min(axis=1)


def closure(
    load: ObjectLoad, frames: Int[np.ndarray, "F"], touching: Sequence[Sequence[Touching]], friction: float
) -> Float[np.ndarray, "F"]:
    """Return the radius of the largest ball of wrenches that hands resist with one unit of force among them.

    Moments count by the object's radius. `touching` is that of each hand in each of these frames, in the world.
    """
    found, unit = np.zeros(len(frames)), np.repeat([1.0, 1.0 / load.length], 3)[:, None]
    for row, frame in enumerate(frames.tolist()):
        centre, parts = load.required.centre[frame], [own[row] for own in touching]
        edges = [_effects(points, friction_edges(inward, friction), centre) for points, inward in parts]
        wrenches = np.concatenate([np.zeros((6, 1)), *edges], axis=1) * unit
        if np.linalg.matrix_rank(wrenches - wrenches.mean(axis=1, keepdims=True), tol=FLAT) < len(wrenches):
            continue  # As on one face: all forces push one way.
        hull = scipy.spatial.ConvexHull(wrenches.T, qhull_options="QJ")  # Without joggling, some end in errors.
        found[row] = radius if (radius := float(-hull.equations[:, -1].max())) > FLAT else 0.0
    return found


def _effects(
    points: Float[np.ndarray, "P 3"], edges: Float[np.ndarray, "P 4 3"], centre: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "6 N"]:
    """Return the forces of edges and their torques about a centre."""
    arms = np.broadcast_to((points - centre)[:, None], edges.shape)
    return np.concatenate([edges, np.cross(arms, edges)], axis=2).reshape(-1, 6).T
