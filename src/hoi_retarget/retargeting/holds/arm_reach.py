"""Reach of an arm: its palm at poses on an object, with the body near that of inverse kinematics."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.numerics import se3
from hoi_retarget.objects.surface_samples import SolidPoses
from hoi_retarget.retargeting.holds.hand_shape import HandPoses
from hoi_retarget.retargeting.surfaces.skin_points import MovingObject
from hoi_retarget.robots.model import Kinematics, RobotModel
from hoi_retarget.robots.skin import skin_of, skins_from

ITERATIONS, DAMPING, LARGEST_STEP = 12, 1e-3, 0.3  # Of damped least squares; steps are of joints [rad].
WAIST_SHARE = 0.15  # How readily joints move that carry both arms.
TURN_LENGTH = 0.1  # [m]; an angle off counts as the way off that it is at this distance.
LINK_POINTS = 60  # Of the skin of each link of the arm.


@dataclass(frozen=True, eq=False)
class Reach:
    """The nearest that an arm comes to N poses in F frames."""

    off: Float[np.ndarray, "N F"]  # [m]
    turned: Float[np.ndarray, "N F"]  # [rad]
    depth: Float[np.ndarray, "N F"]  # Of the arm's links, without the hand, in the object [m].
    bent: Float[np.ndarray, "N F"]  # Length of the change of the arm's joints [rad].
    missing: Float[np.ndarray, "N F 3"]  # From where the palm ends to its pose, in the world [m].


def reach(
    start: Kinematics, site: str, moving_object: MovingObject, frames: Int[np.ndarray, "F"], poses: HandPoses
) -> Reach:
    """Return how near the arm of a palm comes to poses on an object in some frames.

    Args: `start`: of the robot, in all frames; `site`: the palm; `moving_object`: the object; `frames`: frames that
    count; `poses`: of the palm on the object.
    """
    model, count = start.model, len(poses.positions)
    columns, first = _hinges(model, site)
    turn, place = moving_object.rotation[:, :, frames], moving_object.position[:, frames]
    positions = (np.einsum("ijf,nj->nfi", turn, poses.positions) + place.T).reshape(-1, 3)
    rotations = np.einsum("ijf,njk->nfik", turn, poses.rotations).reshape(-1, 3, 3)
    share = np.where(columns < first, WAIST_SHARE, 1.0)
    qpos, every = np.tile(start.qpos[frames], (count, 1)), np.tile(frames, count)
    for _ in range(ITERATIONS):
        kinematics = model.forward(qpos)
        error = _error(kinematics, site, positions, rotations)
        jacobian = kinematics.jacobian(site)[:, :, 6 + columns] * share
        jacobian[:, 3:] *= TURN_LENGTH
        square = jacobian @ jacobian.transpose(0, 2, 1) + DAMPING * np.eye(6)
        step = share * np.einsum("tij,ti->tj", jacobian, np.linalg.solve(square, error[:, :, None])[:, :, 0])
        moved = qpos[:, 7 + columns] + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        qpos[:, 7 + columns] = np.clip(moved, model.lower[columns], model.upper[columns])
    kinematics = model.forward(qpos)
    error = _error(kinematics, site, positions, rotations)
    off, turned = np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1) / TURN_LENGTH
    depth = _depths(kinematics, site, moving_object, every)
    arm = 7 + columns[columns >= first]
    bent = np.linalg.norm(qpos[:, arm] - np.tile(start.qpos[frames][:, arm], (count, 1)), axis=1)
    values = (own.reshape(count, len(frames)) for own in (off, turned, depth, bent))
    return Reach(*values, missing=error[:, :3].reshape(count, len(frames), 3))


def _error(
    kinematics: Kinematics, site: str, positions: Float[np.ndarray, "T 3"], rotations: Float[np.ndarray, "T 3 3"]
) -> Float[np.ndarray, "T 6"]:
    turned = se3.log(se3.matrix_to_quat(rotations @ kinematics.site_rotation(site).transpose(0, 2, 1)))
    return np.concatenate([positions - kinematics.site_position(site), TURN_LENGTH * turned], axis=1)


def _hinges(model: RobotModel, site: str) -> tuple[Int[np.ndarray, "K"], int]:
    """Return the hinges that carry a palm, and the first hinge of its arm alone."""
    other = site.replace("left", "right") if site.startswith("left") else site.replace("right", "left")
    own, others = (np.flatnonzero(model.supports[1:, model.sites.frames[palm].node]) for palm in (site, other))
    return own, int(np.setdiff1d(own, others).min())


def _depths(
    kinematics: Kinematics, site: str, moving_object: MovingObject, frames: Int[np.ndarray, "T"]
) -> Float[np.ndarray, "T"]:
    """Return the depth of the arm's links but for the hand in an object [m]."""
    model = kinematics.model
    hinges, first = _hinges(model, site)
    hand = {skin.link for skin in skins_from(model, site)}
    deepest, turned = np.zeros(len(frames)), moving_object.rotation[:, :, frames]
    for skin in skin_of(model).links:
        # The first link of an arm is the shoulder, which does not reach the object.
        if skin.link in hand or skin.frame.node - 1 not in hinges or skin.frame.node - 1 <= first:
            continue
        turn, origin = kinematics.orientation(skin.frame), kinematics.point(skin.frame)
        points = np.einsum("ijt,kj->ikt", turn, skin.points[:LINK_POINTS]) + origin[:, None]
        deepest = np.maximum(deepest, -moving_object.distances(moving_object.inside(points, frames)).min(axis=0))
        # Rods and boards pass between the points of the skin: their own points are seen from the link.
        turns = turned.transpose(2, 1, 0) @ turn.transpose(2, 0, 1)
        origins = moving_object.inside(origin[:, None], frames)[:, 0].T
        poses = SolidPoses(skin.solid, turns, origins, skin.centre, skin.radius)
        deepest = np.maximum(deepest, -moving_object.samples.least_distances(poses))
    return deepest
