"""Feedback gains about a motion that was simulated: linearized where it is, in every tick.

What was simulated has its contacts, with feet and objects as deep in each other as their forces need. Its derivatives
there, with the drives' targets of that tick, are of use as they are; those of a reference, which only just touches, are
not (`feedback.feedback_gains`).
"""

from collections.abc import Iterator

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.physics.feedback import Linear, gains_of, tame
from hoi_retarget.physics.rollout import Rollout, steps_of
from hoi_retarget.physics.scene import Scene
from hoi_retarget.robots.mujoco_warnings import quiet

_OBJECTS = 0.2  # What deviations of objects count: with all of it, hands reach for boxes that slip.
_MOVED = 1e-6  # For finite differences.


def performed_gains(scene: Scene, simulated: mujoco.MjModel, rollout: Rollout) -> Float[np.ndarray, "K n x"]:
    """Return the gains at every tick, from deviations from a simulated motion to changes of the drives' targets.

    Args:
        scene: What was simulated.
        simulated: The same, compiled.
        rollout: The motion; its targets alone repeat it.
    """
    return gains_of(scene, tame(list(_linearized(simulated, rollout))), objects=_OBJECTS)


def _linearized(simulated: mujoco.MjModel, rollout: Rollout) -> Iterator[Linear]:
    """Yield how the state after each tick follows the state and the targets before it."""
    data, aside = mujoco.MjData(simulated), mujoco.MjData(simulated)
    data.qpos[:], data.qvel[:] = rollout.qpos[0], rollout.qvel[0]
    size = 2 * simulated.nv
    for target in rollout.targets:
        data.ctrl[:] = target
        after, given = np.eye(size), np.zeros((size, simulated.nu))
        for _ in range(steps_of(simulated)):
            once, pushed = np.zeros((size, size)), np.zeros((size, simulated.nu))
            mujoco.mj_copyData(aside, simulated, data)
            with quiet():
                mujoco.mjd_transitionFD(simulated, aside, _MOVED, False, once, pushed, None, None)
                mujoco.mj_step(simulated, data)
            after, given = once @ after, once @ given + pushed
        yield after, given
