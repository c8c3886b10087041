"""The wrenches and torques that a movement needs: inverse dynamics of a robot and of objects, without contacts."""

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.physics.actuators import actuators_of
from hoi_retarget.physics.movement import Movement
from hoi_retarget.physics.object_body import ObjectBody
from hoi_retarget.robots.mjcf import compile_mjcf
from hoi_retarget.robots.model import RobotModel

GRAVITY = 9.81
"""[m/s^2]"""


@dataclass(frozen=True, eq=False)
class Needs:
    """What moves a body: the force [N], and the torque about its centre of mass [N m], in the world."""

    wrench: Float[np.ndarray, "T 6"]
    centre: Float[np.ndarray, "T 3"]
    """[m]"""
    mass: float
    """[kg]"""


@dataclass(frozen=True, eq=False)
class RobotNeeds(Needs):
    """The same of a robot, and its joints' share of it."""

    torques: Float[np.ndarray, "T n"]
    """Of the joints, as if the robot were held at its base alone [N m]."""
    height: float
    """Of the standing robot's centre of mass [m]."""


def robot_needs(model: RobotModel, movement: Movement) -> RobotNeeds:
    """Return what a robot's movement needs; raises `RobotError` as `actuators_of` does."""
    compiled = _dynamics(model)
    data = mujoco.MjData(compiled)
    needed, centres = np.empty_like(movement.qvel), np.empty((len(movement.qpos), 3))
    for frame, (qpos, qvel, qacc) in enumerate(zip(movement.qpos, movement.qvel, movement.qacc, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_inverse(compiled, data)
        needed[frame], centres[frame] = data.qfrc_inverse, data.subtree_com[1]
    data.qpos[:] = model.home_qpos
    mujoco.mj_kinematics(compiled, data)
    mujoco.mj_comPos(compiled, data)
    soles = min(data.site(name).xpos[2] for name in model.site_names if "_sole_" in name)
    torque = se3.rotate(movement.qpos[:, 3:7], needed[:, 3:6])  # MuJoCo's is along the base's axes.
    wrench = _moved(needed[:, :3], torque, movement.qpos[:, :3] - centres)
    height = float(data.subtree_com[1][2] - soles)
    return RobotNeeds(wrench, centres, float(compiled.body_mass.sum()), needed[:, 6:], height)


def object_needs(body: ObjectBody, path: Movement) -> Needs:
    """Return what an object's movement needs."""
    quat, turning, faster = path.qpos[:, 3:7], path.qvel[:, 3:6], path.qacc[:, 3:6]
    inner = np.cross(faster, body.centre) + np.cross(turning, np.cross(turning, body.centre))
    force = body.mass * (path.qacc[:, :3] + se3.rotate(quat, inner) + [0.0, 0.0, GRAVITY])
    torque = faster @ body.inertia + np.cross(turning, turning @ body.inertia)
    centre = path.qpos[:, :3] + se3.rotate(quat, np.broadcast_to(body.centre, (len(quat), 3)))
    return Needs(np.concatenate([force, se3.rotate(quat, torque)], axis=1), centre, body.mass)


@lru_cache(maxsize=8)
def _dynamics(model: RobotModel) -> mujoco.MjModel:
    """Return the robot alone, without contacts and stops."""
    compiled = compile_mjcf(model.spec.mjcf, model.spec.sites)
    compiled.dof_armature[6:] = actuators_of(model).armature
    compiled.dof_damping[:], compiled.dof_frictionloss[:] = 0.0, 0.0
    compiled.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    compiled.opt.gravity[:] = 0.0, 0.0, -GRAVITY
    return compiled


def _moved(force: np.ndarray, torque: np.ndarray, arm: np.ndarray) -> Float[np.ndarray, "T 6"]:
    """Return a wrench about another point, from which its own is an arm away."""
    return np.concatenate([force, torque + np.cross(arm, force)], axis=1)
