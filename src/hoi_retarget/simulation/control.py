"""Feedback along a reference, and many simulations at once that follow it, each with its own changes of the targets.

Feedback gains are those of a time-varying linear-quadratic regulator (Riccati's recursion, backwards).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Float
from mujoco import rollout

from hoi_retarget.dynamics.physics_scene import SOLES, PhysicsScene, compiled
from hoi_retarget.robots.mjcf import quiet
from hoi_retarget.simulation.rollout import Reference, Rollout, TrackingCost, deviations, steps_of

KNOT = 10  # Ticks between knots of changes.
_TIME = 1.0  # At the begin of each tick; a state that MuJoCo resets has less [s].
_EVERY = 5  # Ticks between costs, and between linearizations.
_LAST_COST_WEIGHT = 2.0  # Over others.
_MAX_COST = 60.0  # Of a tick: a worse fall is no worse.
_RANGE_SLACK = 0.5  # Of targets beyond the joints' ranges [rad].
_SUNK = 0.0015  # [m]
EFFORTS = (0.5, 2.0)  # Costs of a target's change [1/rad^2]: of the usual feedback, and of a calmer one.
_DISCOUNT = 0.99  # Of later costs in each tick: contacts change.
_LAST_WEIGHT = 5.0  # Of the last tick, over others.
_MAX_RICCATI = 1e8
_ON_FLOOR = 0.005  # Up to this height an object is on the floor [m].
_OUTLIER_NORM = 500.0  # Numbers in a linearization are some ten; across the onset of a contact, many thousands.
_BASE, _BASE_TURN, _JOINT = 25.0, 3.5, 0.6  # [1/m^2], [1/rad^2]
_OBJECT, _OBJECT_TURN = 30.0, 1.5
_BASE_SPEED, _SINKING, _TURNING, _JOINT_SPEED = 1.07, 0.5, 0.1, 0.004
_OBJECT_SPEED, _OBJECT_TURNING = 0.3, 0.02
Linear = tuple[np.ndarray, np.ndarray]  # Derivatives of a state by the one before it, and by the targets.
_OBJECTS = 0.2  # Weight of deviations of objects: with 1, hands reach for boxes that slip.
_DIFFERENCE = 1e-6


@dataclass(frozen=True, eq=False)
class TrackingProblem:
    """A reference with the drives' targets and the feedback that follow it, and the cost of deviations."""

    scene: PhysicsScene
    simulated: mujoco.MjModel
    reference: Reference
    targets: Float[np.ndarray, "K n"]  # Of the drives where the robot is on the reference [rad].
    gains: Float[np.ndarray, "K n x"]
    cost: TrackingCost

    @property
    def steps(self) -> int:
        """Steps of the simulation in a tick."""
        return steps_of(self.simulated)

    def targets_at(
        self, tick: int, qpos: Float[np.ndarray, "N nq"], qvel: Float[np.ndarray, "N nv"], changes: np.ndarray
    ) -> Float[np.ndarray, "N n"]:
        """Return the drives' targets at a tick, in states [rad].

        `tick`: the tick; `qpos`: configurations of the states; `qvel`: their velocities; `changes`: of the targets,
        then of the base's pose in the feedback: six numbers as in a deviation.
        """
        model = self.scene.model
        apart = deviations(self.reference, model.n, tick, qpos, qvel)
        apart[:, :6] -= changes[:, model.n :]
        targets = self.targets[tick] + changes[:, : model.n] + apart @ self.gains[tick].T
        return np.clip(targets, model.lower - _RANGE_SLACK, model.upper + _RANGE_SLACK)


def changes_at(knots: Float[np.ndarray, "N M n"], tick: int) -> Float[np.ndarray, "N n"]:
    """Return the changes at a tick after the first knot [rad]: from knot to knot without a kink, which would jerk."""
    first, part = divmod(tick, KNOT)
    if part == 0:
        return knots[:, first]
    share = (3.0 - 2.0 * part / KNOT) * (part / KNOT) ** 2
    return (1.0 - share) * knots[:, first] + share * knots[:, first + 1]


def simulated_costs(
    problem: TrackingProblem, data: mujoco.MjData, tick: int, knots: Float[np.ndarray, "N M n"], length: int
) -> Float[np.ndarray, "N"]:
    """Return the mean cost, without a unit, of N simulations from one state on; infinite where MuJoCo cannot continue.

    Args: `problem`: the reference and its feedback; `data`: the state; `tick`: of the reference, at the state; `knots`:
    changes (`TrackingProblem.targets_at`), the first at this tick; `length`: of the simulations, in ticks.
    """
    simulated, scratch = problem.simulated, mujoco.MjData(problem.simulated)
    count, nq, nv = len(knots), simulated.nq, simulated.nv
    start = np.empty(mujoco.mj_stateSize(simulated, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(simulated, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states = np.tile(start, (count, 1))
    warm = np.tile(data.qacc_warmstart, (count, 1))
    cost, weight = np.zeros(count), 0.0
    alive = np.ones(count, dtype=bool)
    for ahead in range(length):
        qpos, qvel = states[:, 1 : 1 + nq], states[:, 1 + nq : 1 + nq + nv]
        targets = problem.targets_at(tick + ahead, qpos, qvel, changes_at(knots, ahead))
        states[:, 0] = _TIME
        with quiet():
            path, _ = rollout.rollout(
                simulated, [scratch], states, np.repeat(targets[:, None], problem.steps, axis=1), initial_warmstart=warm
            )
        before = path[:, -2, 1 + nq : 1 + nq + nv] if problem.steps > 1 else qvel
        warm = (path[:, -1, 1 + nq : 1 + nq + nv] - before) / simulated.opt.timestep
        states = path[:, -1].copy()
        alive &= states[:, 0] > _TIME  # MuJoCo resets what it cannot continue, and its time.
        if (ahead + 1) % _EVERY == 0 or ahead == length - 1:
            counts = _LAST_COST_WEIGHT if ahead == length - 1 else 1.0
            found = problem.cost(tick + ahead + 1, states[:, 1 : 1 + nq], states[:, 1 + nq : 1 + nq + nv])
            cost += counts * np.minimum(found, _MAX_COST)
            weight += counts
    return np.where(alive, cost / weight, np.inf)


def feedback_gains(
    scene: PhysicsScene, simulated: mujoco.MjModel, reference: Reference, *, objects: bool = True
) -> Float[np.ndarray, "K n x"]:
    """Return the gains along a reference, from deviations (`rollout.deviations`) to drives' targets [rad].

    The simulator is linearized by finite differences every tenth of a second. Feet and objects on the floor are sunk
    into it a little first: contacts that only just touch have no useful derivative.

    `scene`: robot and objects; `simulated`: the same, compiled; `reference`: the reference; `objects`: whether
    deviations of objects count.
    """
    ticks = list(range(0, len(reference.qpos), _EVERY))
    linear = replace_outliers(_linearized(scene, simulated, reference, ticks))
    nearest = [linear[min(round(tick / _EVERY), len(linear) - 1)] for tick in range(len(reference.qpos))]
    return gains_of(scene, nearest, objects=1.0 if objects else 0.0)


def gains_of(
    scene: PhysicsScene, linear: Sequence[Linear], *, objects: float, effort: float = EFFORTS[0]
) -> Float[np.ndarray, "K n x"]:
    """Return the gains at every tick [rad per unit of the state] by Riccati's recursion.

    `scene`: robot and objects; `linear`: the linearizations of all ticks; `objects`: weight of objects' deviations, 0
    to 1; `effort`: cost of a target's change [1/rad^2].
    """
    cost = np.diag(_costs(scene.model.n, len(scene.objects), objects))
    efforts = effort * np.eye(scene.model.n)
    ahead = _LAST_WEIGHT * cost
    gains = np.zeros((len(linear), scene.model.n, len(cost)))
    for tick in range(len(linear) - 1, -1, -1):
        a, b = linear[tick]
        pulled = b.T @ ahead
        gains[tick] = -np.linalg.solve(efforts + pulled @ b, pulled @ a)
        ahead = cost + a.T @ ahead @ (a + b @ gains[tick])
        ahead = 0.5 * _DISCOUNT * (ahead + ahead.T)
        if not np.isfinite(ahead).all() or np.abs(ahead).max() > _MAX_RICCATI:
            ahead = _LAST_WEIGHT * cost
    return gains


def replace_outliers(linear: list[Linear]) -> list[Linear]:
    """Return the linearizations with each outlier, as at the onset of a contact, replaced by the nearest other one."""
    sizes = np.array([np.abs(a).max() for a, _ in linear])
    good = np.flatnonzero(sizes < max(_OUTLIER_NORM, sizes.min() + 1.0))
    return [linear[good[np.abs(good - index).argmin()]] for index in range(len(linear))]


def _linearized(
    scene: PhysicsScene, simulated: mujoco.MjModel, reference: Reference, ticks: Sequence[int]
) -> list[Linear]:
    """Return the derivatives of the states after some ticks of a reference."""
    data = mujoco.MjData(simulated)
    nv, soles = simulated.nv, [simulated.geom(name).id for name in sorted(SOLES)]
    found: list[Linear] = []
    for tick in ticks:
        mujoco.mj_resetData(simulated, data)
        data.qpos[:], data.qvel[:] = reference.qpos[tick], reference.qvel[tick]
        mujoco.mj_kinematics(simulated, data)
        lowest = (data.geom_xpos[soles, 2] - simulated.geom_size[soles, 0]).min()
        data.qpos[2] -= lowest + _SUNK
        for index, item in enumerate(scene.objects):
            pose = data.qpos[7 * (index + 1) + scene.model.n :][:7]
            if (height := item.height(pose)) < _ON_FLOOR:
                pose[2] -= height + _SUNK
        data.ctrl[:] = reference.qpos[tick, 7 : 7 + simulated.nu]
        mujoco.mj_forward(simulated, data)
        once, by_targets = np.zeros((2 * nv, 2 * nv)), np.zeros((2 * nv, simulated.nu))
        mujoco.mjd_transitionFD(simulated, data, _DIFFERENCE, False, once, by_targets, None, None)
        a, b = once, by_targets
        for _ in range(steps_of(simulated) - 1):
            a, b = once @ a, once @ b + by_targets
        found.append((a, b))
    return found


def _costs(joints: int, objects: int, share: float) -> Float[np.ndarray, "x"]:
    places = [_BASE] * 3 + [_BASE_TURN] * 3 + [_JOINT] * joints
    of_objects = ([share * _OBJECT] * 3 + [share * _OBJECT_TURN] * 3) * objects
    speeds = [_BASE_SPEED, _BASE_SPEED, _SINKING] + [_TURNING] * 3 + [_JOINT_SPEED] * joints
    speeds += ([share * _OBJECT_SPEED] * 3 + [share * _OBJECT_TURNING] * 3) * objects
    return np.array([*places, *of_objects, *speeds])


def rollout_gains(scene: PhysicsScene, rollout: Rollout, effort: float = EFFORTS[0]) -> Float[np.ndarray, "K n x"]:
    """Return the gains about a simulated motion: changes of the drives' targets [rad] by deviations from it.

    A simulated motion has its contacts, with feet and objects as deep in each other as their forces need, so the
    derivatives in every tick are of use as they are; those of a reference, which only just touches, are not.
    """
    return gains_of(scene, _linearized_rollout(scene, rollout), objects=_OBJECTS, effort=effort)


@lru_cache(maxsize=1)
def _linearized_rollout(scene: PhysicsScene, rollout: Rollout) -> list[Linear]:
    """Return the derivatives of the state after each tick, without outliers."""
    simulated, found = compiled(scene), []
    data, aside = mujoco.MjData(simulated), mujoco.MjData(simulated)
    data.qpos[:], data.qvel[:] = rollout.qpos[0], rollout.qvel[0]
    size = 2 * simulated.nv
    for target in rollout.targets:
        data.ctrl[:] = target
        after, by_targets = np.eye(size), np.zeros((size, simulated.nu))
        for _ in range(steps_of(simulated)):
            once, pushed = np.zeros((size, size)), np.zeros((size, simulated.nu))
            mujoco.mj_copyData(aside, simulated, data)
            with quiet():
                mujoco.mjd_transitionFD(simulated, aside, _DIFFERENCE, False, once, pushed, None, None)
                mujoco.mj_step(simulated, data)
            after, by_targets = once @ after, once @ by_targets + pushed
        found.append((after, by_targets))
    return replace_outliers(found)
