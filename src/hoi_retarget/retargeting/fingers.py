"""Joint angles of a robot's fingers with which their pads are where a person's fingertips are, seen from the palm.

The person's hand is scaled to the robot's by the mean reach of the fingers beside the thumb. Gauss-Newton steps of all
frames at once, within the joints' ranges; paths are smoothed. Touch is left to the trajectory.
"""

from collections.abc import Iterable

import numpy as np
import scipy  # its modules are loaded where they are first used
from jaxtyping import Bool, Float, Int

from hoi_retarget.human.person import Person
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import seconds_to_frames
from hoi_retarget.retargeting.targets import Targets
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SIDES

STEPS, DAMPING = 20, 1e-4  # Number of steps, and what a joint's step costs [m^2/rad^2].
REST = 2e-5  # What angles from the home pose cost [m^2/rad^2]: decides what pads leave free.
TIP = 0.8  # Of the last bone but one: how far a fingertip is beyond the last joint.
SMOOTHING_SECONDS = 0.05


def with_fingers(
    model: RobotModel, targets: Targets, person: Person, qpos: Float[np.ndarray, "T nq"]
) -> Float[np.ndarray, "T nq"]:
    """Return a trajectory [m, rad] with fingers bent as the person's; the same one where these are not recorded.

    `model`: the robot; `targets`: of the same frames, for the rotations of the palms; `person`: the person; `qpos`: the
    trajectory.
    """
    if not (model.spec.fingers and person.fingers_recorded):
        return qpos
    for side in SIDES:
        if goals := _pads(model, side, person, targets):
            qpos = _bent(model, f"{side}_palm", goals, qpos, targets.fps)
    return qpos


def _pads(model: RobotModel, side: str, person: Person, targets: Targets) -> dict[str, Float[np.ndarray, "T 3"]]:
    """Return the places of pads in the frame of the palm [m], by site."""
    sites = {part: site for part, site in model.spec.fingers.items() if part.startswith(side)}
    turns = targets.palm_quats[:, SIDES.index(side)]
    tips = {part: _fingertip(person, part) - person.position(f"{side}_wrist") for part in sites}
    home = model.forward(model.home_qpos[None])
    wrist, palm = (home.site_position(f"{side}_{site}")[0] for site in ("wrist", "palm"))
    reaches = [
        (float(np.linalg.norm(home.site_position(site)[0] - wrist)), _straight_reach(person, part, f"{side}_wrist"))
        for part, site in sites.items()
        if not part.endswith("thumb")
    ]
    scale = np.divide(*np.sum(reaches, axis=0)) if reaches else 1.0
    from_wrist = home.site_rotation(f"{side}_palm")[0].T @ (palm - wrist)
    return {site: scale * se3.rotate_inverse(turns, tips[part]) - from_wrist for part, site in sites.items()}


def _fingertip(person: Person, part: str) -> Float[np.ndarray, "T 3"]:
    """Return the middle of a fingertip, beyond the last joint [m]."""
    last, before = person.position(f"{part}3"), f"{part}2"
    bone = se3.rotate_inverse(person.quat(before), last - person.position(before))
    return last + TIP * se3.rotate(person.quat(f"{part}3"), bone)


def _straight_reach(person: Person, part: str, wrist: str) -> float:
    """Return the reach of a person's straight finger from the wrist, by its bones, in any pose [m]."""
    joints = np.array([person.position(name)[0] for name in (wrist, f"{part}1", f"{part}2", f"{part}3")])
    bones = np.linalg.norm(np.diff(joints, axis=0), axis=1)
    return float(bones.sum() + TIP * bones[-1])


def finger_joints(model: RobotModel, palm: str, pads: Iterable[str]) -> Bool[np.ndarray, "n"]:
    """Return which joints are between a palm and pads."""
    nodes = [model.sites.frames[site].node for site in pads]
    return model.supports[1:, nodes].any(axis=1) & (model.supports[1:, model.sites.frames[palm].node] == 0)


def _bent(
    model: RobotModel, palm: str, goals: dict[str, Float[np.ndarray, "T 3"]], qpos: np.ndarray, fps: float
) -> Float[np.ndarray, "T nq"]:
    """Return a trajectory with the joints between a palm and pads bent such that pads are at their goals."""
    columns, qpos = np.flatnonzero(finger_joints(model, palm, goals)), qpos.copy()
    along, offset = driven_joints(model, columns)
    leads = along.any(axis=0)
    along, driven = along[:, leads], columns[leads]
    home, lower, upper = (ends[driven] for ends in (model.home_qpos[7:], model.lower, model.upper))
    angles = np.repeat(np.clip(home, lower, upper)[None], len(qpos), axis=0)
    for _ in range(STEPS):
        qpos[:, 7 + columns] = angles @ along.T + offset
        kinematics = model.forward(qpos)
        turn, place = kinematics.site_rotation(palm), kinematics.site_position(palm)
        matrix = np.tile((DAMPING + REST) * np.eye(len(driven)), (len(qpos), 1, 1))
        gradient = REST * (angles - home)
        for site, goal in goals.items():
            residual = np.einsum("tji,tj->ti", turn, kinematics.site_position(site) - place) - goal
            by_angles = np.einsum("tji,tjk->tik", turn, kinematics.jacobian(site)[:, :3, 6 + columns]) @ along
            matrix += np.einsum("tik,til->tkl", by_angles, by_angles)
            gradient += np.einsum("tik,ti->tk", by_angles, residual)
        angles = np.clip(angles - np.linalg.solve(matrix, gradient[..., None])[..., 0], lower, upper)
    angles = scipy.ndimage.gaussian_filter1d(angles, seconds_to_frames(SMOOTHING_SECONDS, fps), axis=0, mode="nearest")
    qpos[:, 7 + columns] = angles @ along.T + offset
    return qpos


def driven_joints(
    model: RobotModel, columns: Int[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n"]]:
    """Return a matrix and an offset [rad] that give followers' angles too, from the angles of the other joints."""
    names = [model.joint_names[column] for column in columns]
    along, offset = np.eye(len(names)), np.zeros(len(names))
    for one in model.spec.couplings:
        if one.joint in names and one.other in names:
            row = names.index(one.joint)
            along[row], offset[row] = one.ratio * np.eye(len(names))[names.index(one.other)], one.offset
    return along, offset
