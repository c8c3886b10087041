"""Targets of a body with hands that keep their holds, and go from one to the next as the person's do.

A hold does not move on its object while the person's hand stays about its place; beyond, it moves as the person's does.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import ContactTrack
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.errors import RobotError
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen, runs
from hoi_retarget.numerics.filters import nearest_active, seconds_to_frames, smoothstep_around
from hoi_retarget.retargeting.holds.episodes import Episode, episodes, joined
from hoi_retarget.retargeting.holds.hand_settling import PLACED_REACHES, pull, settled, touching
from hoi_retarget.retargeting.holds.hand_shape import HandPoses, hand_shape
from hoi_retarget.retargeting.holds.hold import Hold, PersonHold
from hoi_retarget.retargeting.holds.hold_choice import chosen_holds
from hoi_retarget.retargeting.holds.object_path import given_way
from hoi_retarget.retargeting.holds.simulated_holds import simulated_holds
from hoi_retarget.retargeting.surfaces.contact_targets import EDITED
from hoi_retarget.retargeting.surfaces.skin_points import HELD_SHELL_SPACING, MovingObject, moving_objects
from hoi_retarget.retargeting.targets import Targets, finger_touch
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.skin import skins_from
from hoi_retarget.robots.spec import PALMS

LEVER = 0.05  # [m]; a hand that turns has moved as its points at this distance have.
SMOOTHING_SECONDS = 0.1  # Of the person's path on the object.
STILL = (0.03, np.radians(25.0))  # A person's hand within this of its place keeps its hold [m, rad].
TAKING_SECONDS = 0.5  # A person's hand that is not still for so long from the start of a contact takes hold.
REGRASP_SECONDS, REGRASP_MPS = 0.2, 0.25
"""Shortest time from one hold to the next, and the speed of a hand that needs longer [m/s]."""
ON_ITS_WAY = (0.01, 0.1)  # Distances from its path that a hand on its way gives for touch, as those of a hold [m, rad].
WAY_SHARE = 0.1  # Of a hold's weight, on the way to another.
OUT_OF_REACH = 0.02  # [m]; a hold that the arm misses by this has half of its weight: more would turn the arm over.
LED_BY_FINGERS = 0.01  # Of a hold's weight, where fingers touch: they say where the hand is.
WAY_RAMP = 3  # [frames]
POSES_AT_ONCE = 400  # Of hands on their way: their skins take memory.
APPROACH_SECONDS, APPROACH_POWER = 0.12, 4
"""In which a hold's weight grows before and falls after contact, and the power of that ramp."""
APPROACH_MPS2 = 4.0  # A hand comes from off the surface, and leaves, with this acceleration [m/s^2].


@dataclass(frozen=True, eq=False)
class PalmPath:
    """A palm's path in the frame of the object that it touches, or is nearest in time to touching."""

    positions: Float[np.ndarray, "T 3"]  # [m]
    quats: Float[np.ndarray, "T 4"]


def with_holds(  # noqa: PLR0913  # the last two are options
    targets: Targets,
    model: RobotModel,
    ik_qpos: Float[np.ndarray, "T nq"],
    physics: Physics,
    simulated: Collection[int] = (),
    *,
    gives_way: bool = False,
    contacts: Sequence[ContactTrack] = (),
) -> tuple[Targets, tuple[Hold, ...]]:
    """Return the targets of hands that keep holds, and the holds.

    Args: `targets`: with the person's contacts; `model`: the robot; `ik_qpos`: where the body is about [m, rad];
    `physics`: masses and frictions; `simulated`: indices of the objects whose holds are to keep them in a simulation;
    `contacts`: the person's, which tell what somebody chose; `gives_way`: whether the path of the targets' only object
    may change where arms cannot reach it. Raises `GeometryError`: an object's mesh cannot be read; `RobotError`: the
    robot's hands have no shapes.
    """
    if not all(skins_from(model, palm) for palm in PALMS):
        raise RobotError(
            f"{model.spec.name}: its hands have no shapes, so surfaces cannot touch. Use --contact landmark, "
            "or add the robot again with its meshes."
        )
    objects, start = moving_objects(targets, HELD_SHELL_SPACING), model.forward(ik_qpos)
    columns = [column for column, site in enumerate(targets.contact_links) if site in PALMS]
    columns = [column for column in columns if targets.contact_flags[:, column].any()]
    by_fingers = [column for column in columns if finger_touch(targets, column).any()]
    columns = [column for column in columns if column not in by_fingers]
    paths = {column: person_path(targets, objects, column) for column in columns}
    persons = [
        _person_hold(targets, episode, path, contacts)
        for column, path in paths.items()
        for episode in _episodes(targets, column, path)
    ]
    holds = chosen_holds(targets, objects, persons, start)
    chosen = {held.episode.object for held in persons if held.chosen}
    for index in sorted({hold.episode.object for hold in holds}.intersection(simulated) - chosen):
        holds = simulated_holds(targets, objects, holds, start, physics, index)
    if gives_way:
        targets = given_way(targets, objects[0], holds, start)
    points, quats = targets.carried_contact_points.copy(), targets.contact_quats.copy()
    weights, turn_weights = targets.contact_weights.copy(), targets.contact_rotation_weights.copy()
    for column, path in paths.items():
        own = [hold for hold in holds if hold.episode.link == column]
        held, share = _held_path(targets, objects, model, path, own)
        points[:, column] = held.positions
        palm = PALMS.index(targets.contact_links[column])
        quats[:, palm] = se3.quat_multiply(_object_quats(targets, column), held.quats)
        weights[:, column] = turn_weights[:, column] = share
    for column in by_fingers:
        points[:, column] = person_path(targets, objects, column).positions
        weights[:, column] *= LED_BY_FINGERS
        turn_weights[:, column] *= LED_BY_FINGERS
    return replace(
        targets,
        carried_contact_points=frozen(points),
        contact_quats=frozen(quats),
        contact_weights=frozen(weights),
        contact_rotation_weights=frozen(turn_weights),
    ), holds


def person_path(targets: Targets, objects: tuple[MovingObject, ...], column: int) -> PalmPath:
    """Return the person's path on the object, smoothed, through contact points where these were placed elsewhere."""
    positions, flags = targets.part_points[:, column].copy(), targets.contact_flags[:, column]
    positions[flags] = targets.contact_points[flags, column]
    palm = targets.palm_quats[:, PALMS.index(targets.contact_links[column])]
    quats = se3.quat_multiply(se3.quat_conjugate(_object_quats(targets, column)), palm)
    touched, sigma = targets.carried_contact_object[:, column], seconds_to_frames(SMOOTHING_SECONDS, targets.fps)
    for index in range(len(objects)):
        _smooth_runs(positions, touched == index, sigma)
    return PalmPath(positions, quats)


def _object_quats(targets: Targets, column: int) -> Float[np.ndarray, "T 4"]:
    return targets.object_quat[np.arange(targets.frames), targets.carried_contact_object[:, column]]


def _smooth_runs(values: np.ndarray, active: Bool[np.ndarray, "T"], sigma: int) -> None:
    """Smooth values over time, in place, each run of active frames by itself."""
    for first, stop in runs(active):
        values[first:stop] = scipy.ndimage.gaussian_filter1d(values[first:stop], sigma, axis=0, mode="nearest")


def _episodes(targets: Targets, column: int, path: PalmPath) -> tuple[Episode, ...]:
    turns = se3.quat_to_matrix(path.quats)
    ends = [path.positions, *(path.positions + LEVER * turns[:, :, axis] for axis in (0, 2))]
    active = joined(targets.contact_flags[:, column], targets.fps)
    touched = np.where(active, targets.carried_contact_object[:, column], -1)
    return episodes(column, touched, np.concatenate(ends, axis=1) / np.sqrt(len(ends)), targets.fps)


def _person_hold(targets: Targets, episode: Episode, path: PalmPath, contacts: Sequence[ContactTrack]) -> PersonHold:
    place, rotation = np.median(path.positions[episode.frames], axis=0), se3.mean_rotation(path.quats[episode.frames])
    points, flags = (values[episode.frames, episode.link] for values in (targets.part_points, targets.contact_flags))
    off = np.linalg.norm(points - targets.contact_points[episode.frames, episode.link], axis=1)[flags]
    part = targets.contact_links[episode.link].replace("palm", "hand")
    own = [track for track in contacts if (track.part, track.object) == (part, episode.object)]
    asked = max(own, key=lambda track: int(track.active[episode.frames].sum()), default=None)
    turn, rank = ((0.0, 0.0, 0.0), 0) if asked is None else (asked.turn, asked.hold)
    edited = bool(np.median(off) > EDITED)
    return PersonHold(episode, HandPoses(place[None], rotation[None]), edited, turn, rank)


def _held_path(
    targets: Targets, objects: tuple[MovingObject, ...], model: RobotModel, person: PalmPath, holds: list[Hold]
) -> tuple[PalmPath, Float[np.ndarray, "T"]]:
    """Return the palm's path on the object, and the share of a hold's weight in every frame."""
    column, fps = holds[0].episode.link, targets.fps
    touched = targets.carried_contact_object[:, column]
    active = np.zeros(targets.frames, dtype=bool)
    for hold in holds:
        active[hold.episode.frames] = True
    rest = _rests(person, [(hold.episode, hold.person_position, hold.person.palm.rotations[0]) for hold in holds], fps)
    held = _rests(person, [(hold.episode, hold.touch.position, hold.touch.rotation) for hold in holds], fps)
    normals = _normals(objects, touched, held.positions, active)
    away = person.positions - rest.positions
    away -= np.einsum("ti,ti->t", away, normals)[:, None] * normals
    turn = se3.log(se3.quat_multiply(person.quats, se3.quat_conjugate(rest.quats)))
    ways = np.concatenate([_beyond(away, STILL[0]), _beyond(turn, STILL[1])], axis=1) * active[:, None]
    simulated = any(hold.kept for hold in holds)
    for first, stop in runs(active):
        _without_start(ways[first:stop], stop if simulated else seconds_to_frames(TAKING_SECONDS, fps), simulated)
    _smooth_runs(ways, active, seconds_to_frames(SMOOTHING_SECONDS, fps))
    positions, quats = held.positions + ways[:, :3], se3.quat_multiply(se3.exp(ways[:, 3:]), held.quats)
    moves = np.abs(np.diff(np.concatenate([positions, quats], axis=1), axis=0, append=np.inf)).max(axis=1) > 1e-6
    moving = active & moves & np.append(active[1:], False)
    for index, moving_object in enumerate(objects):
        at = np.flatnonzero(moving & (touched == index))
        if at.size:
            hand, shifts = hand_shape(model, targets.contact_links[column]), np.zeros((targets.frames, 6))
            for block in np.split(at, range(POSES_AT_ONCE, len(at), POSES_AT_ONCE)):
                wanted = HandPoses(positions[block], se3.quat_to_matrix(quats[block]))
                placed = settled(hand, moving_object, wanted, wanted, pull(ON_ITS_WAY), PLACED_REACHES)
                placed = touching(hand, moving_object, placed)
                shifts[block, :3] = placed.positions - wanted.positions
                turned = placed.rotations @ wanted.rotations.transpose(0, 2, 1)
                shifts[block, 3:] = se3.log(se3.matrix_to_quat(turned))
            _smooth_runs(shifts, active, WAY_RAMP)
            positions[at] += shifts[at, :3]
            quats[at] = se3.quat_multiply(se3.exp(shifts[at, 3:]), quats[at])
    nearest = nearest_active(active)
    seconds = (np.abs(np.arange(targets.frames) - nearest) / fps)[:, None]
    positions = positions[nearest] + 0.5 * APPROACH_MPS2 * seconds**2 * normals[nearest]
    reachable = np.ones(targets.frames)
    for hold in holds:
        off = np.interp(np.arange(hold.episode.first, hold.episode.stop), hold.frames, hold.off)
        reachable[hold.episode.frames] = 1.0 / (1.0 + (off / OUT_OF_REACH) ** 2)
    ramp = smoothstep_around(active, seconds_to_frames(APPROACH_SECONDS, fps)) ** APPROACH_POWER
    share = reachable[nearest] * ramp * (1.0 - (1.0 - WAY_SHARE) * smoothstep_around(moving, WAY_RAMP))
    return PalmPath(positions, quats[nearest]), share


def _without_start(ways: Float[np.ndarray, "F 6"], most: int, through: bool) -> None:
    """Clear the first stretch of ways, in place, where it is so short: a hand that takes hold goes straight to it.

    With `through`, clear all but the last stretch: holds that keep an object in simulation do not slide.
    """
    still = np.flatnonzero(~ways.any(axis=1))
    if still.size and still[0] <= most:
        ways[: still[-1 if through else 0]] = 0.0


def _rests(
    person: PalmPath, rests: list[tuple[Episode, Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]], fps: float
) -> PalmPath:
    """Return a path that rests in each episode, and goes from one to the next about the frame between them."""
    positions, quats = person.positions.copy(), person.quats.copy()
    turns = [se3.matrix_to_quat(rotation) for _, _, rotation in rests]
    for (episode, position, _), quat in zip(rests, turns, strict=True):
        positions[episode.frames], quats[episode.frames] = position, quat
    for number, ((before, start, _), (after, end, _)) in enumerate(pairwise(rests)):
        if before.stop != after.first or before.object != after.object:
            continue
        way = np.linalg.norm(end - start) + LEVER * se3.angle_between(turns[number][None], turns[number + 1][None])[0]
        half = seconds_to_frames(0.5 * max(REGRASP_SECONDS, float(way) / REGRASP_MPS), fps)
        first = max(after.first - half, (before.first + before.stop) // 2)
        stop = min(after.first + half, (after.first + after.stop) // 2)
        share = np.arange(1, stop - first + 1) / (stop - first + 1)
        share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        positions[first:stop] = start + share[:, None] * (end - start)
        quats[first:stop] = se3.slerp(turns[number], turns[number + 1], share)
    return PalmPath(positions, quats)


def _normals(
    objects: tuple[MovingObject, ...],
    touched: np.ndarray,
    positions: Float[np.ndarray, "T 3"],
    active: Bool[np.ndarray, "T"],
) -> Float[np.ndarray, "T 3"]:
    """Return the surface's outward normals nearest to places; zero in other frames."""
    normals = np.zeros_like(positions)
    for index, moving_object in enumerate(objects):
        at = active & (touched == index)
        if at.any():
            normals[at] = moving_object.field.distances_and_normals(positions[at])[1]
    return normals


def _beyond(vectors: Float[np.ndarray, "T 3"], length: float) -> Float[np.ndarray, "T 3"]:
    """Return vectors shortened by a length, shorter ones to nothing."""
    sizes = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors * np.maximum(0.0, 1.0 - length / np.maximum(sizes, 1e-12))
