"""Feedback gains along a reference: a time-varying linear-quadratic regulator (Riccati's recursion, backwards).

The simulator is linearized by finite differences every tenth of a second. Feet and objects on the floor are sunk into
it a little first: contacts that only just touch, or only just do not, have no useful derivative. Where others are such,
the linearization of a time near by stands in.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.physics.reference import TICK, Reference
from hoi_retarget.physics.scene import SOLES, Scene

_EVERY = 5  # Ticks between linearizations.
_SUNK = 0.0015  # [m]
_EFFORT = 0.5  # Cost of a target's change [1/rad^2].
_FORGOTTEN = 0.99  # What is left of later costs after one tick: contacts change.
_LAST = 5.0  # What the last tick counts, over others.
_LARGEST = 1e8
_NEAR = 0.005  # An object so near to the floor is on it [m].
_WILD = 500.0  # Numbers in a linearization are some ten; across the onset of a contact, many thousands.
_BASE, _BASE_TURN, _JOINT = 25.0, 3.5, 0.6  # [1/m^2], [1/rad^2]
_OBJECT, _OBJECT_TURN = 30.0, 1.5
_BASE_SPEED, _SINKING, _TURNING, _JOINT_SPEED = 1.07, 0.5, 0.1, 0.004
_OBJECT_SPEED, _OBJECT_TURNING = 0.3, 0.02

Linear = tuple[np.ndarray, np.ndarray]
"""How a state follows the one before it, and the targets."""


def feedback_gains(
    scene: Scene, simulated: mujoco.MjModel, reference: Reference, *, objects: bool = True
) -> Float[np.ndarray, "K n x"]:
    """Return the gains at every tick, from deviations (`rollout.deviations`) to changes of the drives' targets.

    Where objects do not count, the robot minds itself alone.
    """
    ticks = list(range(0, len(reference.qpos), _EVERY))
    steps = max(1, round(TICK / simulated.opt.timestep))
    linear = tame(_linearized(scene, simulated, reference, ticks, steps))
    nearest = [linear[min(round(tick / _EVERY), len(linear) - 1)] for tick in range(len(reference.qpos))]
    return gains_of(scene, nearest, objects=1.0 if objects else 0.0)


def gains_of(scene: Scene, linear: Sequence[Linear], *, objects: float) -> Float[np.ndarray, "K n x"]:
    """Return the gains at every tick by Riccati's recursion.

    Args:
        scene: Robot and objects.
        linear: How the state after each tick follows the state and the targets before it.
        objects: What deviations of objects count; 0 is a robot that minds itself alone.
    """
    cost = np.diag(_costs(scene.model.n, len(scene.objects), objects))
    effort = _EFFORT * np.eye(scene.model.n)
    ahead = _LAST * cost
    gains = np.zeros((len(linear), scene.model.n, len(cost)))
    for tick in range(len(linear) - 1, -1, -1):
        a, b = linear[tick]
        pulled = b.T @ ahead
        gains[tick] = -np.linalg.solve(effort + pulled @ b, pulled @ a)
        ahead = cost + a.T @ ahead @ (a + b @ gains[tick])
        ahead = 0.5 * _FORGOTTEN * (ahead + ahead.T)
        if not np.isfinite(ahead).all() or np.abs(ahead).max() > _LARGEST:
            ahead = _LAST * cost
    return gains


def tame(linear: list[Linear]) -> list[Linear]:
    """Return the linearizations, with the nearest one that is not wild in the place of wild ones."""
    sizes = np.array([np.abs(a).max() for a, _ in linear])
    good = np.flatnonzero(sizes < max(_WILD, sizes.min() + 1.0))
    return [linear[good[np.abs(good - index).argmin()]] for index in range(len(linear))]


def _linearized(
    scene: Scene, simulated: mujoco.MjModel, reference: Reference, ticks: Sequence[int], steps: int
) -> list[Linear]:
    """Return how the state after a tick follows the state and the targets before it."""
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
            height = pose[2] + (item.corners @ se3.quat_to_matrix(pose[3:])[2]).min()
            if height < _NEAR:
                pose[2] -= height + _SUNK
        data.ctrl[:] = reference.qpos[tick, 7 : 7 + simulated.nu]
        mujoco.mj_forward(simulated, data)
        once, given = np.zeros((2 * nv, 2 * nv)), np.zeros((2 * nv, simulated.nu))
        mujoco.mjd_transitionFD(simulated, data, 1e-6, False, once, given, None, None)
        a, b = once, given
        for _ in range(steps - 1):
            a, b = once @ a, once @ b + given
        found.append((a, b))
    return found


def _costs(joints: int, objects: int, share: float) -> Float[np.ndarray, "x"]:
    places = (
        [_BASE] * 3
        + [_BASE_TURN] * 3
        + [_JOINT] * joints
        + ([share * _OBJECT] * 3 + [share * _OBJECT_TURN] * 3) * objects
    )
    speeds = [_BASE_SPEED, _BASE_SPEED, _SINKING] + [_TURNING] * 3 + [_JOINT_SPEED] * joints
    return np.array([*places, *speeds, *([share * _OBJECT_SPEED] * 3 + [share * _OBJECT_TURNING] * 3) * objects])
