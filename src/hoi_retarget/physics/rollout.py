"""A motion tracked in simulation by the robot's own joint drives: how long it stands, and how near it stays.

Targets of the drives are the reference's angles, shifted such that the drive gives the feedforward torque where the
robot is on the reference. With feedback gains they also answer to where robot and objects are.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.physics.reference import TICK, Reference
from hoi_retarget.physics.scene import Scene
from hoi_retarget.robots.mujoco_warnings import quiet

FALLEN, LYING_DEG = 0.6, 60.0
"""A robot has fallen whose base is lower than this share of the reference's, or tilted so much further [deg]."""


@dataclass(frozen=True, eq=False)
class Rollout:
    """A simulated motion at the controller's ticks, up to its end or the fall."""

    qpos: Float[np.ndarray, "K nq"]
    qvel: Float[np.ndarray, "K nv"]
    targets: Float[np.ndarray, "K n"]
    """Of the drives [rad], held for one tick each."""
    fell_after: float | None
    """[s]; None when it did not fall."""

    @property
    def seconds(self) -> float:
        """How long it stood [s]."""
        return self.fell_after if self.fell_after is not None else TICK * (len(self.qpos) - 1)


def drive_targets(scene: Scene, reference: Reference, *, feedforward: bool = True) -> Float[np.ndarray, "K n"]:
    """Return the targets of the drives [rad] along a reference; without feedforward, its angles."""
    drives, n = scene.actuators, scene.model.n
    angles = reference.qpos[:, 7 : 7 + n]
    if not feedforward:
        return angles
    torques = np.clip(reference.torques, -drives.torque, drives.torque)
    return angles + (torques + drives.damping * reference.qvel[:, 6 : 6 + n]) / drives.stiffness


def tracked(
    simulated: mujoco.MjModel,
    reference: Reference,
    targets: Float[np.ndarray, "K n"],
    gains: Float[np.ndarray, "K n x"] | None = None,
    push: tuple[int, Float[np.ndarray, "3"]] | None = None,
) -> Rollout:
    """Return the simulation of drives that follow targets, from the reference's first state on.

    Args:
        simulated: The compiled scene.
        reference: What is followed.
        targets: Of the drives.
        gains: From deviations of the state (2 nv numbers: configuration, then velocity) to changes of the targets.
        push: A tick, and by how much the base's velocity changes then [m/s].
    """
    data = mujoco.MjData(simulated)
    data.qpos[:], data.qvel[:] = reference.qpos[0], reference.qvel[0]
    qpos, qvel, given = [data.qpos.copy()], [data.qvel.copy()], []
    fell_after = None
    for tick in range(len(reference.qpos) - 1):
        if push is not None and tick == push[0]:
            data.qvel[:3] += push[1]
        target = targets[tick]
        if gains is not None:
            apart = deviations(reference, len(target), tick, data.qpos[None], data.qvel[None])[0]
            target = target + gains[tick] @ apart
        data.ctrl[:] = target
        given.append(data.ctrl.copy())
        if not stepped(simulated, data) or has_fallen(reference, tick + 1, data):
            fell_after = TICK * (tick + 1)
            break
        qpos.append(data.qpos.copy())
        qvel.append(data.qvel.copy())
    given = [*given, targets[-1]][: len(qpos)]
    return Rollout(frozen(qpos), frozen(qvel), frozen(given), fell_after)


def steps_of(simulated: mujoco.MjModel) -> int:
    """Return how many steps of a simulation a tick has."""
    return max(1, round(TICK / simulated.opt.timestep))


def stepped(simulated: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Simulate one tick; return whether numbers stayed finite and small, without which a robot falls."""
    kinds = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
    with quiet():
        mujoco.mj_step(simulated, data, steps_of(simulated))
    return not any(data.warning[kind].number for kind in kinds)


def has_fallen(reference: Reference, tick: int, data: mujoco.MjData) -> bool:
    """Return whether a robot's base is too low for a tick of a reference, or tilted too far from it."""
    wanted = reference.qpos[tick]
    return bool(data.qpos[2] < FALLEN * wanted[2]) or tilt_deg(data.qpos[3:7], wanted[3:7]) > LYING_DEG


def tilt_deg(quat: Float[np.ndarray, "4"], wanted: Float[np.ndarray, "4"]) -> float:
    """Return the angle between the upward axes of two orientations [deg]."""
    ups = [se3.rotate(item, np.array([0.0, 0.0, 1.0])) for item in (quat, wanted)]
    return float(np.degrees(np.arccos(np.clip(ups[0] @ ups[1], -1.0, 1.0))))


def deviations(
    reference: Reference, joints: int, tick: int, qpos: Float[np.ndarray, "N nq"], qvel: Float[np.ndarray, "N nv"]
) -> Float[np.ndarray, "N x"]:
    """Return where states are beside the reference's: 2 nv numbers each, configuration and velocity."""
    wanted = reference.qpos[tick]
    free = [0, *range(7 + joints, len(wanted), 7)]
    apart = []
    for first in free:
        turn = se3.quat_multiply(se3.quat_conjugate(wanted[first + 3 : first + 7]), qpos[:, first + 3 : first + 7])
        apart += [qpos[:, first : first + 3] - wanted[first : first + 3], se3.log(turn)]
    apart.insert(2, qpos[:, 7 : 7 + joints] - wanted[7 : 7 + joints])
    return np.concatenate([*apart, qvel - reference.qvel[tick]], axis=1)


def object_errors(rollout: Rollout, reference: Reference, joints: int) -> Float[np.ndarray, "K O"]:
    """Return how far objects are from where the reference has them [m]."""
    first = 7 + joints
    count = (reference.qpos.shape[1] - first) // 7
    frames = len(rollout.qpos)
    places = [slice(first + 7 * index, first + 7 * index + 3) for index in range(count)]
    found = [np.linalg.norm(rollout.qpos[:, at] - reference.qpos[:frames, at], axis=1) for at in places]
    return np.stack(found, axis=1) if found else np.zeros((frames, 0))


def base_errors_deg(rollout: Rollout, reference: Reference) -> Float[np.ndarray, "K"]:
    """Return how far the base is turned from the reference's [deg]."""
    return np.degrees(se3.angle_between(rollout.qpos[:, 3:7], reference.qpos[: len(rollout.qpos), 3:7]))
