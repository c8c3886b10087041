"""A performed motion made smoother: followed with feedback along its own smoothed path, where that loses nothing.

Plans that follow each other, and the noise in them, jerk a motion. What was performed, with its high frequencies taken
out of path and targets, is performed again in several ways, and the smoothest of them is kept that still has the
objects where they were.
"""

from collections.abc import Iterator
from dataclasses import replace

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.signal import savgol_filter

from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.physics.movement import movement_of
from hoi_retarget.physics.performed_gains import performed_gains
from hoi_retarget.physics.reference import TICK, Reference
from hoi_retarget.physics.rollout import Rollout, object_errors, tracked
from hoi_retarget.physics.scene import Scene

_WAYS = ((0.14, 0.3), (0.3, 0.3), (0.14, 0.14))  # Of path and targets [s].
_PASSES = 3
_WORSE, _SLACK = 1.05, 0.002  # How much further off objects may be: a share, and more [m].
_CUBIC = 3


def smoother(
    scene: Scene, simulated: mujoco.MjModel, reference: Reference, rollout: Rollout, gains: Float[np.ndarray, "K n x"]
) -> tuple[Rollout, Float[np.ndarray, "K n x"]]:
    """Return a smoother simulated motion than one that did not fall, or the same, and the gains about it.

    Args:
        scene: What was simulated.
        simulated: The same, compiled.
        reference: What was to be performed: it tells where objects should be.
        rollout: What was performed; the other begins in the same state.
        gains: About it.
    """
    n = scene.model.n
    allowed = _WORSE * object_errors(rollout, reference, n).mean(axis=0) + _SLACK
    for _ in range(_PASSES):
        found = [tracked(simulated, path, targets, gains) for path, targets in _paths(scene, reference, rollout)]
        kept = [item for item in found if item.fell_after is None]
        kept = [item for item in kept if (object_errors(item, reference, n).mean(axis=0) <= allowed).all()]
        best = min([rollout, *kept], key=lambda item: jerk(scene, item))
        if best is rollout:
            break
        rollout, gains = best, performed_gains(scene, simulated, best)
    return rollout, gains


def jerk(scene: Scene, rollout: Rollout) -> float:
    """Return the mean jerk of the robot's bodies [m/s^3]."""
    if len(rollout.qpos) < 4:
        return 0.0
    places = scene.model.forward(rollout.qpos[:, : 7 + scene.model.n]).body_positions
    return float(np.linalg.norm(np.diff(places, 3, axis=0), axis=2).mean() / TICK**3)


def _paths(scene: Scene, reference: Reference, rollout: Rollout) -> Iterator[tuple[Reference, np.ndarray]]:
    n = scene.model.n
    bodies = [
        rollout.qpos[:, : 7 + n],
        *(rollout.qpos[:, at : at + 7] for at in range(7 + n, rollout.qpos.shape[1], 7)),
    ]
    for of_path, of_targets in _WAYS:
        moved = [movement_of(body, 1.0 / TICK, of_path) for body in bodies]
        qpos = np.concatenate([body.qpos for body in moved], axis=1)
        qvel = np.concatenate([body.qvel for body in moved], axis=1)
        qpos[0], qvel[0] = rollout.qpos[0], rollout.qvel[0]
        window = 2 * round(0.5 * (of_targets / TICK - 1.0)) + 1
        targets = rollout.targets
        if len(targets) > window > _CUBIC:
            targets = np.asarray(savgol_filter(targets, window, _CUBIC, axis=0))
        yield replace(reference, qpos=frozen(qpos), qvel=frozen(qvel)), targets
