"""A reference at a controller's ticks, simulations of the robot's drives that follow it, and the cost of deviations.

Targets of the drives are the reference's angles, shifted such that the drive gives the feedforward torque where the
robot is on the reference. With feedback gains they also answer to deviations of robot and objects.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from hoi_retarget.dynamics.contact_forces import Forces
from hoi_retarget.dynamics.inverse_dynamics import GRAVITY, mass_centres, movement_of
from hoi_retarget.dynamics.physics_scene import PhysicsScene
from hoi_retarget.dynamics.physics_settings import Physics
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.robots.mjcf import quiet
from hoi_retarget.robots.spec import SIDES

_GRIP_SHARE = 0.4
TICK = 0.02  # Of the controller [s]: robots take targets 50 times a second.
FALLEN, LYING_DEG = 0.6, 60.0
"""A robot has fallen with its base below this share of the reference's height, or tilted by more from it [deg]."""
_BASE, _BASE_TURN, _TURNING, _JOINT, _JOINT_SPEED = 10.0, 2.0, 0.05, 0.3, 0.006  # [1/m^2], [1/rad^2], [s^2/rad^2]
_OBJECT, _OBJECT_TURN, _OBJECT_SPEED = 60.0, 3.0, 0.3
_PLACES = {"head": 15.0} | {f"{side}_foot": 10.0 for side in SIDES} | {f"{side}_palm": 10.0 for side in SIDES}
_TILT = 1.0  # Of a foot's axis, a unit vector.
_CAPTURE = 15.0
_TOUCH, _SPAN = 30.0, 0.2  # Of three points so far from a link [m], in the frame of the object that it touches,
_SOON = 25  # or will touch within so many ticks: where it lands is where it stays.
MAX_OBJECT_COST = 8.0
"""Bound of an object's cost, reached in the limit: half of it when it is 26 cm off hands that stay in place."""
_FALLING = 50.0
_DIFFERENCE_S = 1e-4  # [s]


@dataclass(frozen=True, eq=False)
class Reference:
    """A motion to be followed by a controller, at K ticks, in the scene's coordinates."""

    qpos: Float[np.ndarray, "K nq"]
    qvel: Float[np.ndarray, "K nv"]
    torques: Float[np.ndarray, "K n"]  # Feedforward [N m].
    links: tuple[str, ...]  # Sites of the robot that may touch objects.
    touched: Int[np.ndarray, "K C"]  # Index of the object that each of them is labelled to touch; -1 for none.

    @property
    def seconds(self) -> float:
        """From the first tick to the last [s]."""
        return TICK * (len(self.qpos) - 1)


def with_weaker_grip(physics: Physics) -> Physics:
    """Return physics with less friction at the hands: forces found with it hold firmly in the given one."""
    return replace(physics, hand_friction=_GRIP_SHARE * physics.hand_friction)


def reference_of(scene: PhysicsScene, motion: Motion, forces: Forces) -> Reference:
    """Return a motion at a controller's ticks, with the torques that its forces need; it has two frames or more."""
    times = np.arange(motion.frames) / motion.fps
    ticks = TICK * np.arange(int(times[-1] / TICK + 1e-9) + 1)
    poses = np.concatenate([motion.object_pos, motion.object_quat], axis=2)
    paths = [motion.qpos, *np.moveaxis(poses, 1, 0)]
    moved = [movement_of(path, motion.fps, scene.physics.smoothing) for path in paths]
    bodies = [interpolated(body.qpos, body.qvel, times, ticks) for body in moved]
    # The scene has the robot's coordinates first, then each object's.
    qpos = np.concatenate([body[0] for body in bodies], axis=1)
    qvel = np.concatenate([body[1] for body in bodies], axis=1)
    # Recorded objects stand some millimetres in the floor, which would throw them.
    for index, item in enumerate(scene.objects):
        place = 7 * (index + 1) + scene.model.n
        qpos[0, place + 2] -= min(0.0, item.height(qpos[0, place : place + 7]))
    torques = CubicSpline(times, forces.torques)(ticks)
    touched = np.where(motion.contact_flags, motion.contact_object, -1)[np.round(ticks * motion.fps).astype(int)]
    return Reference(frozen(qpos), frozen(qvel), frozen(torques), motion.contact_links, frozen(touched, int))


def interpolated(
    qpos: Float[np.ndarray, "T nq"], qvel: Float[np.ndarray, "T nv"], times: np.ndarray, wanted: np.ndarray
) -> tuple[Float[np.ndarray, "K nq"], Float[np.ndarray, "K nv"]]:
    """Return configurations and velocities of a body with a free base at other times.

    `qpos`: at `times`, of which there are two or more; `qvel`: likewise; `times`: [s]; `wanted`: the other times [s].
    """
    curve = CubicHermiteSpline(times, np.delete(qpos, np.s_[3:7], axis=1), np.delete(qvel, np.s_[3:6], axis=1))
    value, speed = curve(wanted), curve.derivative()(wanted)
    quats = CubicSpline(times, se3.quat_continuous(qpos[:, 3:7]))(wanted)
    turning = CubicSpline(times, qvel[:, 3:6])(wanted)
    return (
        np.concatenate([value[:, :3], se3.quat_normalize(quats), value[:, 3:]], axis=1),
        np.concatenate([speed[:, :3], turning, speed[:, 3:]], axis=1),
    )


@dataclass(frozen=True, eq=False)
class Rollout:
    """A simulated motion at the controller's ticks, up to its end or the fall."""

    qpos: Float[np.ndarray, "K nq"]
    qvel: Float[np.ndarray, "K nv"]
    targets: Float[np.ndarray, "K n"]  # Of the drives [rad], held for one tick each.
    fell_after: float | None  # [s]; None when it did not fall.

    @property
    def seconds(self) -> float:
        """Duration up to the end or the fall [s]."""
        return self.fell_after if self.fell_after is not None else TICK * (len(self.qpos) - 1)


def drive_targets(scene: PhysicsScene, reference: Reference, *, feedforward: bool = True) -> Float[np.ndarray, "K n"]:
    """Return the targets of the drives [rad] along a reference; without feedforward, its angles."""
    drives, n = scene.actuators, scene.model.n
    angles = reference.qpos[:, 7 : 7 + n]
    if not feedforward:
        return angles
    torques = np.clip(reference.torques, -drives.torque, drives.torque)
    return angles + (torques + drives.damping * reference.qvel[:, 6 : 6 + n]) / drives.stiffness


def track(
    simulated: mujoco.MjModel,
    reference: Reference,
    targets: Float[np.ndarray, "K n"],
    gains: Float[np.ndarray, "K n x"] | None = None,
    push: tuple[int, Float[np.ndarray, "3"]] | None = None,
) -> Rollout:
    """Return the simulation of drives that follow targets, from the reference's first state on.

    Args: `simulated`: the compiled scene; `reference`: the reference; `targets`: of the drives [rad]; `gains`: from
    deviations of the state (2 nv numbers: configuration, then velocity) to changes of the targets; `push`: a tick, and
    the change of the base's velocity in it [m/s].
    """
    data = mujoco.MjData(simulated)
    data.qpos[:], data.qvel[:] = reference.qpos[0], reference.qvel[0]
    qpos, qvel, applied = [data.qpos.copy()], [data.qvel.copy()], []
    fell_after = None
    for tick in range(len(reference.qpos) - 1):
        if push is not None and tick == push[0]:
            data.qvel[:3] += push[1]
        target = targets[tick]
        if gains is not None:
            apart = deviations(reference, len(target), tick, data.qpos[None], data.qvel[None])[0]
            target = target + gains[tick] @ apart
        data.ctrl[:] = target
        applied.append(data.ctrl.copy())
        if not step_tick(simulated, data) or has_fallen(reference, tick + 1, data):
            fell_after = TICK * (tick + 1)
            break
        qpos.append(data.qpos.copy())
        qvel.append(data.qvel.copy())
    applied = [*applied, targets[-1]][: len(qpos)]
    return Rollout(frozen(qpos), frozen(qvel), frozen(applied), fell_after)


def steps_of(simulated: mujoco.MjModel) -> int:
    """Return the number of steps of a simulation in a tick."""
    return max(1, round(TICK / simulated.opt.timestep))


def step_tick(simulated: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Simulate one tick; return whether numbers stayed finite and small, without which a robot falls."""
    kinds = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
    with quiet():
        mujoco.mj_step(simulated, data, steps_of(simulated))
    return not any(data.warning[kind].number for kind in kinds)


def has_fallen(reference: Reference, tick: int, data: mujoco.MjData) -> bool:
    """Return whether a robot's base is too low for a tick of a reference, or tilted too far from it."""
    expected = reference.qpos[tick]
    return bool(data.qpos[2] < FALLEN * expected[2]) or tilt_deg(data.qpos[3:7], expected[3:7]) > LYING_DEG


def tilt_deg(quat: Float[np.ndarray, "4"], expected: Float[np.ndarray, "4"]) -> float:
    """Return the angle between the upward axes of two orientations [deg]."""
    ups = [se3.rotate(item, np.array([0.0, 0.0, 1.0])) for item in (quat, expected)]
    return float(np.degrees(np.arccos(np.clip(ups[0] @ ups[1], -1.0, 1.0))))


def deviations(
    reference: Reference, joints: int, tick: int, qpos: Float[np.ndarray, "N nq"], qvel: Float[np.ndarray, "N nv"]
) -> Float[np.ndarray, "N x"]:
    """Return the deviations of states from the reference: 2 nv numbers [m, rad, per s], configuration and velocity.

    Args: `reference`: the reference; `joints`: number of the robot's joints; `tick`: the tick of the reference; `qpos`:
    configurations of the states; `qvel`: their velocities.
    """
    expected = reference.qpos[tick]
    free = [0, *range(7 + joints, len(expected), 7)]
    apart = []
    for first in free:
        turn = se3.quat_multiply(se3.quat_conjugate(expected[first + 3 : first + 7]), qpos[:, first + 3 : first + 7])
        apart += [qpos[:, first : first + 3] - expected[first : first + 3], se3.log(turn)]
    apart.insert(2, qpos[:, 7 : 7 + joints] - expected[7 : 7 + joints])
    return np.concatenate([*apart, qvel - reference.qvel[tick]], axis=1)


def object_errors(rollout: Rollout, reference: Reference, joints: int) -> Float[np.ndarray, "K O"]:
    """Return the distances of objects from their places in the reference [m]."""
    apart = object_poses(rollout.qpos, joints) - object_poses(reference.qpos[: len(rollout.qpos)], joints)
    return np.linalg.norm(apart[:, :, :3], axis=2)


def object_poses(qpos: Float[np.ndarray, "K nq"], joints: int) -> Float[np.ndarray, "K O 7"]:
    """Return the poses of a scene's objects: position [m] and rotation, after those of the robot."""
    return qpos[:, 7 + joints :].reshape(len(qpos), (qpos.shape[1] - 7 - joints) // 7, 7)


def base_errors_deg(rollout: Rollout, reference: Reference) -> Float[np.ndarray, "K"]:
    """Return the angles between the base and the reference's [deg]."""
    return np.degrees(se3.angle_between(rollout.qpos[:, 3:7], reference.qpos[: len(rollout.qpos), 3:7]))


@dataclass(frozen=True, eq=False)
class _Postures:
    """The compared places and axes of N states."""

    places: Float[np.ndarray, "N P 3"]
    tilts: Float[np.ndarray, "N 2 3"]  # Up-axes of the feet.
    capture: Float[np.ndarray, "N 2"]
    touching: Float[np.ndarray, "N C 3 3"]
    """Three points on the axes of each link that may touch, in the world: its place and how it is turned."""


class TrackingCost:
    """The cost of states at the ticks of one reference.

    Squares of deviations, weighted: of joints, base, head, feet and palms; of the capture point, which is the centre of
    mass and its velocity over the pendulum's frequency; of objects; and of hands in the frames of the objects that they
    are labelled to touch. An object's cost is bounded: no robot should fall for a lost object.
    """

    def __init__(self, scene: PhysicsScene, reference: Reference) -> None:
        self._model, self._reference, self._n = scene.model, reference, scene.model.n
        heights = mass_centres(scene.model.forward(reference.qpos[:, : 7 + self._n]))[:, 2]
        self._pendulum = np.sqrt(GRAVITY / np.median(heights))
        self._goals = self._postures(reference.qpos, reference.qvel)
        self._weights = np.array(list(_PLACES.values()))
        self._paths = object_poses(reference.qpos, self._n)
        self._touched = reference.touched.copy()
        for _ in range(_SOON):
            self._touched[:-1] = np.where(self._touched[:-1] >= 0, self._touched[:-1], self._touched[1:])

    def __call__(
        self, tick: int, qpos: Float[np.ndarray, "N nq"], qvel: Float[np.ndarray, "N nv"]
    ) -> Float[np.ndarray, "N"]:
        """Return the cost of states at a tick of the reference; infinite where numbers are not finite."""
        finite = np.isfinite(qpos).all(axis=1) & np.isfinite(qvel).all(axis=1)
        cost = np.full(len(qpos), np.inf)
        if finite.any():
            cost[finite] = self._finite(tick, qpos[finite], qvel[finite])
        return cost

    def _finite(self, tick: int, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        n, goals, found = self._n, self._goals, self._postures(qpos, qvel)
        expected, expected_speed = self._reference.qpos[tick], self._reference.qvel[tick]
        joints, speeds = slice(7, 7 + n), slice(6, 6 + n)
        cost = _JOINT * _squares(qpos[:, joints] - expected[joints])
        cost += _JOINT_SPEED * _squares(qvel[:, speeds] - expected_speed[speeds])
        cost += _BASE * _squares(qpos[:, :3] - expected[:3])
        cost += _BASE_TURN * se3.angle_between(expected[None, 3:7], qpos[:, 3:7]) ** 2
        cost += _TURNING * _squares(qvel[:, 3:6] - expected_speed[3:6])
        cost += ((found.places - goals.places[tick]) ** 2).sum(axis=2) @ self._weights
        cost += _TILT * _squares((found.tilts - goals.tilts[tick]).reshape(len(qpos), -1))
        cost += _CAPTURE * _squares(found.capture - goals.capture[tick])
        poses = object_poses(qpos, n)
        for index, goal in enumerate(self._paths[tick]):
            pose, moving = poses[:, index], slice(6 + n + 6 * index, 9 + n + 6 * index)
            lost = _OBJECT * _squares(pose[:, :3] - goal[:3])
            lost += _OBJECT_TURN * se3.angle_between(goal[None, 3:], pose[:, 3:]) ** 2
            lost += _OBJECT_SPEED * _squares(qvel[:, moving] - expected_speed[moving])
            touching = self._touched[tick] == index
            here = se3.rotate_inverse(pose[:, None, None, 3:], found.touching[:, touching] - pose[:, None, None, :3])
            there = se3.rotate_inverse(goal[3:], goals.touching[tick, touching] - goal[:3])
            lost += _TOUCH / 3.0 * _squares((here - there).reshape(len(qpos), -1))
            cost += MAX_OBJECT_COST * lost / (MAX_OBJECT_COST + lost)
        return cost + _FALLING * (qpos[:, 2] < FALLEN * expected[2])

    def _postures(self, qpos: np.ndarray, qvel: np.ndarray) -> _Postures:
        n = self._n
        kinematics = self._model.forward(qpos[:, : 7 + n])
        later = self._model.forward(self._model.integrate(qpos[:, : 7 + n], _DIFFERENCE_S * qvel[:, : 6 + n]))
        centres = mass_centres(kinematics)
        capture = centres + (mass_centres(later) - centres) / (_DIFFERENCE_S * self._pendulum)
        places = [kinematics.point(name) for name in _PLACES]
        tilts = [kinematics.orientation(f"{side}_foot")[:, 2] for side in SIDES]
        links = self._reference.links
        spans = [kinematics.point(name)[:, None] + _SPAN * kinematics.orientation(name) for name in links]
        touching = np.stack(spans).transpose(3, 0, 2, 1) if spans else np.zeros((len(qpos), 0, 3, 3))
        at, ups = (np.stack(items).transpose(2, 0, 1) for items in (places, tilts))
        return _Postures(at, ups, capture[:, :2], touching)


def _squares(apart: np.ndarray) -> np.ndarray:
    return np.einsum("ni,ni->n", apart, apart)
