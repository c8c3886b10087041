"""Fingers that close on an object from a hold, where the person's were not recorded.

From the hold's palm each finger closes until one of its links touches; the links beyond go on until they touch, too. A
finger that meets nothing stays open, and so do those whose contacts are labelled: they follow the person's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.human.person import Person
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.numerics.filters import seconds_to_frames, smoothstep_around
from hoi_retarget.retargeting.fingers import driven_joints, finger_joints
from hoi_retarget.retargeting.holds.hold import Hold
from hoi_retarget.retargeting.surfaces.skin_points import HELD_SHELL_SPACING, MovingObject, moving_objects
from hoi_retarget.retargeting.targets import Targets, finger_links
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.skin import LinkSkin, skins_from
from hoi_retarget.robots.spec import PALMS

STEPS, POINTS = 32, 150  # Number of poses of a closing finger, and of points of each link's skin.
TOUCHING = 0.001  # [m]
IN_FRONT = 0.05  # [m]; closing pads come nearer to a point so far in front of the palm.
CLOSES = 0.3  # Joints that bring a pad there less than this share as fast as the fastest one stay where they are.
RAMP_SECONDS = 0.2  # In which a hand closes, about the start of a contact, and opens, about its end.


@dataclass(frozen=True, eq=False)
class ClosingFinger:
    """The joints of a finger, in their order from the palm, and their way to close."""

    columns: Int[np.ndarray, "k"]
    followed: Float[np.ndarray, "k m"]  # Angles by those of the m joints that close.
    opened: Float[np.ndarray, "k"]  # Angles of the open hand [rad].
    travel: Float[np.ndarray, "m"]  # From there to the ends of their ranges [rad].
    nodes: Int[np.ndarray, "m"]  # Of the links that these joints move.
    links: tuple[LinkSkin, ...]

    def angles(self, shares: Float[np.ndarray, "N m"]) -> Float[np.ndarray, "N k"]:
        """Return the angles of a finger that is closed by shares [rad]."""
        return self.opened + (shares * self.travel) @ self.followed.T


def with_grasps(
    model: RobotModel, targets: Targets, person: Person, holds: Sequence[Hold], qpos: Float[np.ndarray, "T nq"]
) -> Float[np.ndarray, "T nq"]:
    """Return a trajectory [m, rad] with fingers closed on the objects in their hands, and open in between.

    The same one where the robot has no fingers, or the person's were recorded. Raises `GeometryError` when an object's
    mesh cannot be read.

    Args: `model`: the robot; `targets`: of the same frames; `person`: the person; `holds`: of the hands; `qpos`: the
    trajectory.
    """
    if not model.spec.fingers or person.fingers_recorded:
        return qpos
    qpos, objects = qpos.copy(), moving_objects(targets, HELD_SHELL_SPACING)
    for palm in PALMS:
        own = [hold for hold in holds if targets.contact_links[hold.episode.link] == palm]
        weights = [_closed(hold, targets.frames, seconds_to_frames(RAMP_SECONDS, targets.fps)) for hold in own]
        total = np.maximum(np.sum(weights, axis=0), 1.0) if own else 1.0
        for finger in () if any(finger_links(targets, palm)) else closing_fingers(model, palm):
            shares = np.zeros((targets.frames, len(finger.travel)))
            for hold, weight in zip(own, weights, strict=True):
                closed = closed_shares(model, palm, finger, hold, objects[hold.episode.object])
                shares += (weight / total)[:, None] * closed
            qpos[:, 7 + finger.columns] = finger.angles(shares)
    return qpos


def _closed(hold: Hold, frames: int, ramp: int) -> Float[np.ndarray, "T"]:
    """Return how closed a hand is by a hold: 1 within it, 0 a ramp's half before and after."""
    first, stop, closed = hold.episode.first, hold.episode.stop, np.zeros(frames, dtype=bool)
    half = min(ramp // 2, (stop - first - 1) // 2)
    closed[first + half : stop - half] = True
    return smoothstep_around(closed, ramp)


def closing_fingers(model: RobotModel, palm: str) -> tuple[ClosingFinger, ...]:
    """Return the fingers of a hand."""
    side = palm.removesuffix("_palm")
    pads = [site for part, site in model.spec.fingers.items() if part.startswith(side)]
    return tuple(_closing(model, palm, pad) for pad in pads)


def _closing(model: RobotModel, palm: str, pad: str) -> ClosingFinger:
    columns, home = np.flatnonzero(finger_joints(model, palm, [pad])), model.forward(model.home_qpos[None])
    followed, _ = driven_joints(model, columns)
    place, turn = home.site_position(palm)[0], home.site_rotation(palm)[0]
    inward = turn[:, 1] * (-1.0 if palm.startswith("left") else 1.0)
    there = place + IN_FRONT * inward - home.site_position(pad)[0]
    nearer = (there / np.linalg.norm(there)) @ home.jacobian(pad)[0][:3, 6 + columns] @ followed
    closes = np.abs(nearer) > CLOSES * np.abs(nearer).max()
    ends = np.where(nearer > 0.0, model.upper[columns], model.lower[columns])
    opened = model.home_qpos[7 + columns]
    nodes = columns[closes] + 1
    links = tuple(link for link in skins_from(model, palm) if model.supports[nodes, link.frame.node].any())
    travel = (ends - opened)[closes]
    return ClosingFinger(columns, frozen(followed[:, closes]), frozen(opened), frozen(travel), nodes, links)


def closed_shares(
    model: RobotModel, palm: str, finger: ClosingFinger, hold: Hold, moving_object: MovingObject
) -> Float[np.ndarray, "m"]:
    """Return how far the joints of a finger close from a hold, as shares of their travel: 0 where nothing is met."""
    shares, moves = np.zeros(len(finger.travel)), np.ones(len(finger.travel), dtype=bool)
    while moves.any():
        tried = np.where(moves, np.maximum(np.linspace(0.0, 1.0, STEPS)[:, None], shares), shares)
        touches = _touches(model, palm, finger, tried, hold, moving_object)
        # Links that stand still have met something before, or are nearer to the palm.
        touches &= model.supports[finger.nodes[moves].min(), [link.frame.node for link in finger.links]] > 0
        met = touches.any(axis=1)
        if not met.any():
            break
        step = int(met.argmax())
        shares = tried[max(step - 1, 0)] if step and touches[0].sum() == 0 else tried[step]
        nodes = [link.frame.node for link, there in zip(finger.links, touches[step], strict=True) if there]
        # Joints between the palm and what touches stop; the others go on.
        moves &= (model.supports[finger.nodes][:, nodes] == 0).all(axis=1)
    return shares


def _touches(  # noqa: PLR0913, PLR0917  # a finger and its place
    model: RobotModel,
    palm: str,
    finger: ClosingFinger,
    shares: Float[np.ndarray, "N m"],
    hold: Hold,
    moving_object: MovingObject,
) -> Bool[np.ndarray, "N links"]:
    """Return which links touch the object, or are inside it, with the hand in its hold."""
    qpos = np.repeat(model.home_qpos[None], len(shares), axis=0)
    qpos[:, 7 + finger.columns] = finger.angles(shares)
    kinematics = model.forward(qpos)
    turn, place = kinematics.site_rotation(palm), kinematics.site_position(palm)
    found = []
    for link in finger.links:
        points = np.einsum("ijn,kj->nki", kinematics.orientation(link.frame), link.points[:POINTS])
        points += (kinematics.point(link.frame).T - place)[:, None]
        inside = np.einsum("nji,nkj->nki", turn, points) @ hold.touch.rotation.T + hold.touch.position
        found.append((moving_object.field.distances(inside.reshape(-1, 3)) < TOUCHING).reshape(len(shares), -1).any(1))
    return np.stack(found, axis=1)
