"""Many simulations at once that follow a reference with feedback, each with changes of its own to the targets."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float
from mujoco import rollout

from hoi_retarget.physics.costs import TrackingCost
from hoi_retarget.physics.reference import Reference
from hoi_retarget.physics.rollout import deviations, steps_of
from hoi_retarget.physics.scene import Scene
from hoi_retarget.robots.mujoco_warnings import quiet

KNOT = 10
"""Ticks between knots of changes."""
_TIME = 1.0  # At the begin of each tick: what was reset has less.
_EVERY = 5  # Ticks between costs.
_LAST = 2.0  # What the last cost counts, over others.
_MOST = 60.0  # Of one cost: a fall is a fall.
_SLACK = 0.5  # How far targets may be beyond the joints' ranges [rad].


@dataclass(frozen=True, eq=False)
class Course:
    """What simulations follow."""

    scene: Scene
    simulated: mujoco.MjModel
    reference: Reference
    targets: Float[np.ndarray, "K n"]
    """Of the drives where the robot is on the reference [rad]."""
    gains: Float[np.ndarray, "K n x"]
    cost: TrackingCost

    @property
    def steps(self) -> int:
        """How many steps of the simulation a tick has."""
        return steps_of(self.simulated)

    def given(
        self, tick: int, qpos: Float[np.ndarray, "N nq"], qvel: Float[np.ndarray, "N nv"], changes: np.ndarray
    ) -> Float[np.ndarray, "N n"]:
        """Return the drives' targets at a tick, in states [rad].

        Changes are of the targets, then of where feedback has the base: six numbers as a deviation has them.
        """
        model = self.scene.model
        apart = deviations(self.reference, model.n, tick, qpos, qvel)
        apart[:, :6] -= changes[:, model.n :]
        given = self.targets[tick] + changes[:, : model.n] + apart @ self.gains[tick].T
        return np.clip(given, model.lower - _SLACK, model.upper + _SLACK)


def changes_at(knots: Float[np.ndarray, "N M n"], tick: int) -> Float[np.ndarray, "N n"]:
    """Return the changes at a tick after the first knot: from knot to knot without a kink, which would jerk."""
    first, part = divmod(tick, KNOT)
    if part == 0:
        return knots[:, first]
    share = (3.0 - 2.0 * part / KNOT) * (part / KNOT) ** 2
    return (1.0 - share) * knots[:, first] + share * knots[:, first + 1]


def simulated_costs(
    course: Course, data: mujoco.MjData, tick: int, knots: Float[np.ndarray, "N M n"], length: int
) -> Float[np.ndarray, "N"]:
    """Return the mean cost of N simulations from one state on; infinite where MuJoCo cannot continue.

    Args:
        course: What is followed.
        data: The state.
        tick: Of the reference, at the state.
        knots: Changes (`Course.given`), the first at this tick.
        length: Of the simulations, in ticks.
    """
    simulated, scratch = course.simulated, mujoco.MjData(course.simulated)
    count, nq, nv = len(knots), simulated.nq, simulated.nv
    start = np.empty(mujoco.mj_stateSize(simulated, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(simulated, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states = np.tile(start, (count, 1))
    warm = np.tile(data.qacc_warmstart, (count, 1))
    cost, weight = np.zeros(count), 0.0
    alive = np.ones(count, dtype=bool)
    for ahead in range(length):
        qpos, qvel = states[:, 1 : 1 + nq], states[:, 1 + nq : 1 + nq + nv]
        given = course.given(tick + ahead, qpos, qvel, changes_at(knots, ahead))
        states[:, 0] = _TIME
        with quiet():
            path, _ = rollout.rollout(
                simulated, [scratch], states, np.repeat(given[:, None], course.steps, axis=1), initial_warmstart=warm
            )
        before = path[:, -2, 1 + nq : 1 + nq + nv] if course.steps > 1 else qvel
        warm = (path[:, -1, 1 + nq : 1 + nq + nv] - before) / simulated.opt.timestep
        states = path[:, -1].copy()
        alive &= states[:, 0] > _TIME  # MuJoCo resets what it cannot continue, and its time.
        if (ahead + 1) % _EVERY == 0 or ahead == length - 1:
            counts = _LAST if ahead == length - 1 else 1.0
            found = course.cost(tick + ahead + 1, states[:, 1 : 1 + nq], states[:, 1 + nq : 1 + nq + nv])
            cost += counts * np.minimum(found, _MOST)
            weight += counts
    return np.where(alive, cost / weight, np.inf)
