"""Contact targets moved out of and onto the object, until the robot's own skin touches there.

A contact target is a point inside the human's hand. Moved there, a robot's hand is somewhere inside the object or
off it. Each contact is moved, with the robot's hand as it is turned, along the contact's side until nothing of the
hand is inside, and towards the nearest point of the surface until it touches. The moves are smoothed over time.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from hoi_retarget.numerics.arrays import frozen, runs
from hoi_retarget.numerics.filters import frames_in
from hoi_retarget.retargeting.surfaces.moving_object import MovingObject
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin, Skin

SKIN_POINTS = 150
"""Of the coarse skin that is moved: the last millimetres are left to the optimization."""
STEPS = 8
TOWARDS_PLACE = 0.45
"""Share of the mean way, over a run of contact, from where the hand touches to where the human's does."""
SMOOTHING_SECONDS = 0.4
STRIDE_SECONDS = 0.1
OVERSHOOT = 1.15
"""A step out is longer than the depth: where the side is oblique to the surface, the depth shrinks by less."""
LEFT = 0.001
"""[m] of an object may be left in a link."""
LARGEST_MOVE = 0.2
"""[m]; a hand that would have to go further stays as it is."""


def touching_targets(
    targets: Targets,
    objects: tuple[MovingObject, ...],
    sides: Float[np.ndarray, "T C 3"],
    skin: Skin,
    kinematics: Kinematics,
) -> Targets:
    """Return the targets with contact points moved for links that are turned as in a trajectory."""
    points = targets.carried_contact_points.copy()
    for link, site in enumerate(targets.contact_links):
        of_link = skin.by_link.get(kinematics.model.body_of(site))
        if of_link is None:
            continue
        for first, stop in runs(targets.contact_weights[:, link] > 0):
            # Moves are smoothed anyway: some frames of each stretch are enough.
            frames = np.unique(np.append(np.arange(first, stop, frames_in(STRIDE_SECONDS, targets.fps)), stop - 1))
            moves = np.zeros((len(frames), 3))
            for index in np.unique(targets.carried_contact_object[frames, link]):
                at = targets.carried_contact_object[frames, link] == index
                goals, outward = points[frames[at], link], sides[frames[at], link]
                moves[at] = _moves(goals.T, outward.T, objects[index], of_link, kinematics, site, frames[at]).T
            every, sigma = np.arange(first, stop), frames_in(SMOOTHING_SECONDS, targets.fps)
            between = np.stack([np.interp(every, frames, along) for along in moves.T], axis=1)
            points[every, link] += gaussian_filter1d(between, sigma, axis=0, mode="nearest")
    return replace(targets, carried_contact_points=frozen(points))


def _moves(  # noqa: PLR0913, PLR0917 - what decides a move
    goals: Float[np.ndarray, "3 F"],
    outward: Float[np.ndarray, "3 F"],
    thing: MovingObject,
    skin: LinkSkin,
    kinematics: Kinematics,
    site: str,
    frames: np.ndarray,
) -> Float[np.ndarray, "3 F"]:
    """Return by how much each goal moves, in the object's frame [m]."""
    to_object = thing.rotation[:, :, frames]
    turned = np.einsum("jif,jkf->ikf", to_object, kinematics.orientation(skin.frame)[:, :, frames])
    to_link = kinematics.point(skin.frame)[:, frames] - kinematics.point(site)[:, frames]
    lever = np.einsum("ijf,kj->ikf", turned, skin.points[:SKIN_POINTS])
    lever += np.einsum("jif,jf->if", to_object, to_link)[:, None]
    moves, touched = _settled(np.zeros_like(goals), goals, lever, outward, thing)
    distances, normals = thing.distances_and_normals(goals)
    apart = (goals - distances * normals - touched).mean(axis=1, keepdims=True)
    moves, _ = _settled(moves + TOWARDS_PLACE * apart, goals, lever, outward, thing)
    origins = np.einsum("jif,jf->if", to_object, to_link) + goals
    moves = _outside(moves, origins, turned, outward, thing, skin)
    return np.where(np.linalg.norm(moves, axis=0) < LARGEST_MOVE, moves, 0.0)


def _settled(
    moves: Float[np.ndarray, "3 F"],
    goals: Float[np.ndarray, "3 F"],
    lever: Float[np.ndarray, "3 K F"],
    outward: Float[np.ndarray, "3 F"],
    thing: MovingObject,
) -> tuple[Float[np.ndarray, "3 F"], Float[np.ndarray, "3 F"]]:
    """Return moves with which skin touches, and where it does, in the object's frame [m]."""
    every, touched = np.arange(goals.shape[1]), goals
    for _ in range(STEPS):
        points = (goals + moves)[:, None] + lever
        nearest = thing.distances(points).argmin(axis=0)
        touched = points[:, nearest, every]
        distances, normals = thing.distances_and_normals(touched)
        moves = moves + np.where(distances < 0.0, -OVERSHOOT * distances * outward, -distances * normals)
    return moves, touched


def _outside(  # noqa: PLR0913, PLR0917 - what decides a move
    moves: Float[np.ndarray, "3 F"],
    origins: Float[np.ndarray, "3 F"],
    turned: Float[np.ndarray, "3 3 F"],
    outward: Float[np.ndarray, "3 F"],
    thing: MovingObject,
    skin: LinkSkin,
) -> Float[np.ndarray, "3 F"]:
    """Return moves that are longer where something of the object is in the link, between its skin points."""
    moves = moves.copy()
    surface = np.asarray(thing.samples.data)
    for frame in range(moves.shape[1]):
        turn, side = turned[:, :, frame], outward[:, frame]
        origin = origins[:, frame] + moves[:, frame]
        samples = surface[thing.samples.query_ball_point(origin + turn @ skin.centre, skin.radius)]
        seen, back, way = (samples - origin) @ turn, turn.T @ side, 0.0
        for _ in range(STEPS):
            depth = -skin.solid.distances(seen - way * back).min(initial=np.inf)
            if depth < LEFT:
                break
            way += OVERSHOOT * depth
        moves[:, frame] += way * side
    return moves
