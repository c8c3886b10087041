"""Contact targets at which the robot's own skin touches the object, each on the human's side of it.

A contact target is a point inside the human's foot or another part that touches; hands have holds. Moved there, the
robot's part is somewhere inside the object or off it. Each contact is moved, with the part as it is turned, along its
side where skin is inside, and towards the nearest surface until it touches. The moves are smoothed over time.
"""

from dataclasses import replace

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Float

from hoi_retarget.numerics.arrays import frozen, runs
from hoi_retarget.numerics.filters import seconds_to_frames
from hoi_retarget.retargeting.surfaces.skin_points import MovingObject, at_points
from hoi_retarget.retargeting.targets import Targets, finger_touch
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.skin import LinkSkin, contact_skins
from hoi_retarget.robots.spec import BODY_SITES, PALMS

APPROACH_SECONDS = 1 / 3
"""Before and after a contact, in which the human's part is outside the object on the side from which it came."""
STEADY_SECONDS = 0.27  # A side turns over this time, as where a hand slips around an edge.
CLEARLY_OUTSIDE = 0.04  # [m]; a part that is so far outside shows its side as well as any.
EDITED = 0.03  # [m]; a contact point that is so far from the human's part was placed by somebody.


RESTING_SITES = frozenset(BODY_SITES.values())  # Of parts that rest on what is below them, whatever is beside them.


def contact_sides(targets: Targets, objects: tuple[MovingObject, ...]) -> Float[np.ndarray, "T C 3"]:
    """Return the outward unit vector of every contact, in the object's frame; zero in frames without.

    In each run of contact it is the mean of the surface's normals nearest to the human's part, in frames of the run and
    of its approach, weighted by how far outside the part is and by nearness in time. So a part inside a thin wall
    has the side on which it was before. What rests is on top.
    """
    sides = np.zeros_like(targets.part_points)
    margin = seconds_to_frames(APPROACH_SECONDS, targets.fps)
    for link in range(len(targets.contact_links)):
        for first, stop in runs(targets.contact_weights[:, link] > 0):
            window = slice(max(0, first - margin), min(targets.frames, stop + margin))
            for index in np.unique(targets.carried_contact_object[first:stop, link]):
                inside = np.flatnonzero(targets.carried_contact_object[first:stop, link] == index) + first
                if targets.contact_links[link] in RESTING_SITES:
                    sides[inside, link] = objects[index].rotation[2][:, inside].T
                    continue
                sides[inside, link] = _sides(targets, objects[index], link, window)[inside - window.start]
    return sides


def _sides(targets: Targets, moving_object: MovingObject, link: int, window: slice) -> Float[np.ndarray, "F 3"]:
    points, placed = targets.part_points[window, link], np.nan_to_num(targets.contact_points[window, link])
    edited = targets.contact_flags[window, link] & (np.linalg.norm(placed - points, axis=1) > EDITED)
    points = np.where(edited[:, None], placed, points)
    distances, normals = at_points(moving_object.field.distances_and_normals, points.T)
    shown = np.clip(distances, 1e-5, CLEARLY_OUTSIDE) * normals
    time = np.arange(len(points)) / seconds_to_frames(STEADY_SECONDS, targets.fps)
    # Falls slowly: in the midst of a long contact inside a wall, only the approach shows the side.
    nearness = 1.0 / (1.0 + (time[:, None] - time) ** 2)
    mean = nearness @ shown.T
    lengths = np.linalg.norm(mean, axis=1, keepdims=True)
    return np.where(lengths > 1e-9, mean / np.maximum(lengths, 1e-9), normals.T)


SKIN_POINTS = 150  # Of the coarse skin that is moved: the last millimetres are left to the optimization.
STEPS = 8
SMOOTHING_SECONDS = 0.4
STRIDE_SECONDS = 0.1
OVERSHOOT = 1.15
"""A step out is longer than the depth: where the side is oblique to the surface, the depth shrinks by less."""
LARGEST_MOVE = 0.2  # [m]; a part that would have to go further stays as it is.
REST_FACTOR = 10.0  # Of the weight of a palm that fingers lead.


def touching_targets(
    targets: Targets, objects: tuple[MovingObject, ...], sides: Float[np.ndarray, "T C 3"], kinematics: Kinematics
) -> Targets:
    """Return the targets with contact points moved for links that are turned as in a trajectory.

    `targets`: with the human's contact points; `objects`: of the robot's world; `sides`: side of the object for each
    contact, in the object's frame; `kinematics`: of the trajectory.
    """
    points = targets.carried_contact_points.copy()
    for link, site in enumerate(targets.contact_links):
        links = contact_skins(kinematics.model, site)
        if not links or site in PALMS:  # Hands have holds, or fingers lead them.
            continue
        for first, stop in runs(targets.contact_weights[:, link] > 0):
            # Moves are smoothed anyway: some frames of each stretch are enough.
            frames = np.unique(
                np.append(np.arange(first, stop, seconds_to_frames(STRIDE_SECONDS, targets.fps)), stop - 1)
            )
            moves = np.zeros((len(frames), 3))
            for index in np.unique(targets.carried_contact_object[frames, link]):
                at = targets.carried_contact_object[frames, link] == index
                goals, outward = points[frames[at], link].T, sides[frames[at], link].T
                found = [_moves(goals, outward, objects[index], own, kinematics, site, frames[at]) for own in links]
                # Of several links the one that must go farthest touches first.
                farthest = np.argmax([np.einsum("if,if->f", move, outward) for move in found], axis=0)
                moves[at] = np.stack(found)[farthest, :, np.arange(len(farthest))]
            every, sigma = np.arange(first, stop), seconds_to_frames(SMOOTHING_SECONDS, targets.fps)
            between = np.stack([np.interp(every, frames, along) for along in moves.T], axis=1)
            points[every, link] += scipy.ndimage.gaussian_filter1d(between, sigma, axis=0, mode="nearest")
    return replace(targets, carried_contact_points=frozen(points))


def resting_palms(targets: Targets, objects: tuple[MovingObject, ...], kinematics: Kinematics) -> Targets:
    """Return the targets with palms that fingers lead held about where a trajectory has them, a median over a contact.

    Fingers that cannot all reach the person's places would pull the hand along the surface.
    """
    points, weights = targets.carried_contact_points.copy(), targets.contact_weights.copy()
    for link, site in enumerate(targets.contact_links):
        led = finger_touch(targets, link) & (site in PALMS)
        for first, stop in runs(led):
            frames, off = np.arange(first, stop), np.zeros((stop - first, 3))
            for index in np.unique(targets.carried_contact_object[frames, link]):
                at = targets.carried_contact_object[frames, link] == index
                palm = kinematics.site_position(site)[frames[at]].T[:, None]
                off[at] = objects[index].inside(palm, frames[at])[:, 0].T - points[frames[at], link]
            points[frames, link] += np.median(off, axis=0)
        weights[led, link] *= REST_FACTOR
    return replace(targets, carried_contact_points=frozen(points), contact_weights=frozen(weights))


def _moves(  # noqa: PLR0913, PLR0917  # the parts of a move
    goals: Float[np.ndarray, "3 F"],
    outward: Float[np.ndarray, "3 F"],
    moving_object: MovingObject,
    skin: LinkSkin,
    kinematics: Kinematics,
    site: str,
    frames: np.ndarray,
) -> Float[np.ndarray, "3 F"]:
    """Return moves of the goals with which skin touches, in the object's frame [m]; what rests moves up and down."""
    to_object = moving_object.rotation[:, :, frames]
    turned = np.einsum("jif,jkf->ikf", to_object, kinematics.orientation(skin.frame)[:, :, frames])
    to_link = kinematics.point(skin.frame)[:, frames] - kinematics.point(site)[:, frames]
    lever = np.einsum("ijf,kj->ikf", turned, skin.points[:SKIN_POINTS])
    lever += np.einsum("jif,jf->if", to_object, to_link)[:, None]
    moves, every = np.zeros_like(goals), np.arange(goals.shape[1])
    for _ in range(STEPS):
        points = (goals + moves)[:, None] + lever
        nearest = moving_object.distances(points).argmin(axis=0)
        distances, normals = at_points(moving_object.field.distances_and_normals, points[:, nearest, every])
        towards = outward if site in RESTING_SITES else normals
        moves = moves - np.where(distances < 0.0, OVERSHOOT * distances * outward, distances * towards)
    return np.where(np.linalg.norm(moves, axis=0) < LARGEST_MOVE, moves, 0.0)
