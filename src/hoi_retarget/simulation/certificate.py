"""Certificates: a simulated motion simulated again, without any change, and with its feedback in other physics.

A controller is given targets and gains. They must hold where the simulator's time step, masses and frictions are not
quite those of the motion, and where somebody pushes.
"""

from collections.abc import Iterator

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.dynamics.physics_scene import PhysicsScene, compiled
from hoi_retarget.motion.performance import Certificate, Replay
from hoi_retarget.numerics import se3
from hoi_retarget.simulation.rollout import TICK, Reference, Rollout, object_errors, track

PUSH = 0.15  # Change of the base's velocity by a push [m/s].
_PUSHES = {"forward": (0.25, (1.0, 0.0)), "left": (0.5, (0.0, 1.0)), "back": (0.75, (-1.0, 0.0))}
"""When, as a share of the motion, and which way, as the robot faces."""
_CHANGES = ("half the time step", "mass +20 %", "mass -20 %", "friction -20 %")
_SHARE = 0.2  # Of masses and frictions.


def certificate_of(scene: PhysicsScene, rollout: Rollout, gains: Float[np.ndarray, "K n x"]) -> Certificate:
    """Return the certificate of a motion that was performed whole; it takes about a second.

    Gains, from deviations from it to changes of the drives' targets, are rounded as in files. Raises `RobotError` where
    MuJoCo cannot compile the robot with the objects.
    """
    path = _path(rollout)
    again = track(compiled(scene), path, rollout.targets)
    repeats = all(getattr(again, name).tobytes() == getattr(rollout, name).tobytes() for name in ("qpos", "qvel"))
    rounded = gains.astype(np.float32).astype(float)
    return Certificate(repeats, tuple(_replays(scene, path, rollout.targets, rounded)))


def _replays(scene: PhysicsScene, path: Reference, targets: np.ndarray, gains: np.ndarray) -> Iterator[Replay]:
    for name in _CHANGES:
        if scene.objects or not name.startswith("mass"):
            yield _replay(name, scene, path, track(_changed(scene, name), path, targets, gains))
    simulated = compiled(scene)
    for way, (share, direction) in _PUSHES.items():
        tick = int(share * (len(targets) - 1))
        push = (tick, PUSH * _horizontal(path.qpos[tick, 3:7], direction))
        name = f"push {way} at {TICK * tick:.1f} s"
        yield _replay(name, scene, path, track(simulated, path, targets, gains, push))


def _replay(name: str, scene: PhysicsScene, path: Reference, found: Rollout) -> Replay:
    errors = object_errors(found, path, scene.model.n)
    base = np.linalg.norm(found.qpos[:, :3] - path.qpos[: len(found.qpos), :3], axis=1)
    object_m = float(errors.max()) if errors.size else None
    return Replay(name, found.seconds, found.fell_after is not None, object_m, float(base.max()))


def _path(rollout: Rollout) -> Reference:
    """Return a simulated motion as a reference, with configurations and velocities alone."""
    ticks = len(rollout.qpos)
    return Reference(rollout.qpos, rollout.qvel, np.zeros((ticks, 0)), (), np.zeros((ticks, 0), dtype=int))


def _horizontal(quat: Float[np.ndarray, "4"], direction: tuple[float, float]) -> Float[np.ndarray, "3"]:
    """Return a direction, as a robot faces, in the world."""
    forward = se3.rotate(quat, np.array([1.0, 0.0, 0.0]))[:2]
    x, y = forward / max(float(np.linalg.norm(forward)), 1e-9)
    return np.array([x * direction[0] - y * direction[1], y * direction[0] + x * direction[1], 0.0])


def _changed(scene: PhysicsScene, change: str) -> mujoco.MjModel:
    """Return a scene in other physics, one of `_CHANGES`."""
    simulated = compiled(scene)
    match change:
        case "half the time step":
            simulated.opt.timestep *= 0.5
        case "mass +20 %" | "mass -20 %":
            bodies = [simulated.body(item.body_name).id for item in scene.objects]
            factor = 1.0 + _SHARE if "+" in change else 1.0 - _SHARE
            simulated.body_mass[bodies] *= factor
            simulated.body_inertia[bodies] *= factor
        case "friction -20 %":
            simulated.geom_friction[:, 0] *= 1.0 - _SHARE
    mujoco.mj_setConst(simulated, mujoco.MjData(simulated))
    return simulated
