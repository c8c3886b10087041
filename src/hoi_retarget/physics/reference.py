"""A motion at the ticks of a controller: configurations, velocities and torques of a scene's robot and objects."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.physics.forces import Forces
from hoi_retarget.physics.movement import Movement, movement_of
from hoi_retarget.physics.scene import Scene
from hoi_retarget.physics.settings import Physics

_GRIP = 0.4
TICK = 0.02
"""Of the controller [s]: robots take targets 50 times a second."""


@dataclass(frozen=True, eq=False)
class Reference:
    """What a controller follows, at K ticks; coordinates are the scene's."""

    qpos: Float[np.ndarray, "K nq"]
    qvel: Float[np.ndarray, "K nv"]
    torques: Float[np.ndarray, "K n"]
    """Feedforward [N m]."""
    links: tuple[str, ...]
    """Sites of the robot that may touch objects."""
    touched: Int[np.ndarray, "K C"]
    """Which object each of them is labelled to touch; -1 for none."""

    @property
    def seconds(self) -> float:
        """From the first tick to the last [s]."""
        return TICK * (len(self.qpos) - 1)


def held_firmly(physics: Physics) -> Physics:
    """Return physics with less friction at the hands: forces that just hold there hold firmly in the given one."""
    return replace(physics, hand_friction=_GRIP * physics.hand_friction)


def reference_of(scene: Scene, motion: Motion, forces: Forces) -> Reference:
    """Return a motion at a controller's ticks, with the torques that its forces need; it has two frames or more."""
    times = np.arange(motion.frames) / motion.fps
    ticks = TICK * np.arange(int(times[-1] / TICK + 1e-9) + 1)
    poses = np.concatenate([motion.object_pos, motion.object_quat], axis=2)
    paths = [motion.qpos, *np.moveaxis(poses, 1, 0)]
    bodies = [_at(movement_of(path, motion.fps, scene.physics.smoothing), times, ticks) for path in paths]
    # The scene has the robot's coordinates first, then each object's.
    qpos = np.concatenate([body[0] for body in bodies], axis=1)
    qvel = np.concatenate([body[1] for body in bodies], axis=1)
    torques = CubicSpline(times, forces.torques)(ticks)
    touched = np.where(motion.contact_flags, motion.contact_object, -1)[np.round(ticks * motion.fps).astype(int)]
    return Reference(frozen(qpos), frozen(qvel), frozen(torques), motion.contact_links, frozen(touched, int))


def _at(movement: Movement, times: np.ndarray, ticks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    straight = np.delete(movement.qpos, np.s_[3:7], axis=1)
    speeds = np.delete(movement.qvel, np.s_[3:6], axis=1)
    curve = CubicHermiteSpline(times, straight, speeds)
    value, speed = curve(ticks), curve.derivative()(ticks)
    quats = CubicSpline(times, se3.quat_continuous(movement.qpos[:, 3:7]))(ticks)
    turning = CubicSpline(times, movement.qvel[:, 3:6])(ticks)
    return (
        np.concatenate([value[:, :3], se3.quat_normalize(quats), value[:, 3:]], axis=1),
        np.concatenate([speed[:, :3], turning, speed[:, 3:]], axis=1),
    )
