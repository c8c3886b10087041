"""Inverse dynamics of a robot and of objects without contacts: velocities, accelerations and the wrenches they require.

Velocities and accelerations are those of cubics that are fitted to a few frames around each. Configurations are those
of the cubics, too, so that all three belong together.
"""

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Float

from hoi_retarget.dynamics.actuators import actuators_of
from hoi_retarget.dynamics.object_bodies import ObjectBody
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.filters import savitzky_golay
from hoi_retarget.robots.mjcf import compile_mjcf
from hoi_retarget.robots.model import Kinematics, RobotModel

GRAVITY = 9.81  # [m/s^2]
_CUBIC = 3


@dataclass(frozen=True, eq=False)
class Movement:
    """A free body with n joints over T frames, in MuJoCo's coordinates: angular ones are along the body's axes."""

    qpos: Float[np.ndarray, "T nq"]  # Position [m], rotation wxyz, joints [rad].
    qvel: Float[np.ndarray, "T nv"]
    qacc: Float[np.ndarray, "T nv"]


@dataclass(frozen=True, eq=False)
class RequiredWrench:
    """The force [N] and the torque about the centre of mass [N m] that move a body, in the world."""

    wrench: Float[np.ndarray, "T 6"]
    centre: Float[np.ndarray, "T 3"]  # [m]
    mass: float  # [kg]


@dataclass(frozen=True, eq=False)
class RequiredRobotWrench(RequiredWrench):
    """The same of a robot, and its joints' share of it."""

    torques: Float[np.ndarray, "T n"]  # Of the joints, as if the robot were held at its base alone [N m].
    height: float  # Of the standing robot's centre of mass [m].


def movement_of(qpos: Float[np.ndarray, "T nq"], fps: float, seconds: float) -> Movement:
    """Return the movement along configurations, smoothed over a time; motions of two frames and fewer are at rest."""
    quats = se3.quat_continuous(qpos[:, 3:7])
    path = np.concatenate([qpos[:, :3], quats, qpos[:, 7:]], axis=1)
    value, first, second = (_fitted(path, fps, seconds, order) for order in range(3))
    square = np.sum(value[:, 3:7] ** 2, axis=1, keepdims=True)
    # Fitted quaternions are no unit ones: what turns is their direction.
    back = se3.quat_conjugate(value[:, 3:7]) / square
    turning = 2.0 * se3.quat_multiply(back, first[:, 3:7])[:, 1:]
    growth = 2.0 * np.sum(value[:, 3:7] * first[:, 3:7], axis=1, keepdims=True) / square
    turning_faster = 2.0 * se3.quat_multiply(back, second[:, 3:7])[:, 1:] - growth * turning
    value[:, 3:7] /= np.sqrt(square)
    return Movement(
        value,
        np.concatenate([first[:, :3], turning, first[:, 7:]], axis=1),
        np.concatenate([second[:, :3], turning_faster, second[:, 7:]], axis=1),
    )


def required_robot_wrench(model: RobotModel, movement: Movement) -> RequiredRobotWrench:
    """Return the wrench that a robot's movement requires; raises `RobotError` as `actuators_of` does."""
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
    # The wrench about the centre of mass, from which the base's is an arm away.
    force, arm = needed[:, :3], movement.qpos[:, :3] - centres
    wrench = np.concatenate([force, torque + np.cross(arm, force)], axis=1)
    height = float(data.subtree_com[1][2] - soles)
    return RequiredRobotWrench(wrench, centres, float(compiled.body_mass.sum()), needed[:, 6:], height)


def required_object_wrench(body: ObjectBody, path: Movement) -> RequiredWrench:
    """Return the wrench that an object's movement requires."""
    quat, turning, faster = path.qpos[:, 3:7], path.qvel[:, 3:6], path.qacc[:, 3:6]
    inner = np.cross(faster, body.centre) + np.cross(turning, np.cross(turning, body.centre))
    force = body.mass * (path.qacc[:, :3] + se3.rotate(quat, inner) + [0.0, 0.0, GRAVITY])
    torque = faster @ body.inertia + np.cross(turning, turning @ body.inertia)
    centre = path.qpos[:, :3] + se3.rotate(quat, np.broadcast_to(body.centre, (len(quat), 3)))
    return RequiredWrench(np.concatenate([force, se3.rotate(quat, torque)], axis=1), centre, body.mass)


def mass_centres(kinematics: Kinematics) -> Float[np.ndarray, "T 3"]:
    """Return the robot's centres of mass [m]."""
    bodies = kinematics.model.bodies
    shares, inside = _mass_shares(kinematics.model)
    turned = np.einsum("ijbn,jb,b->ni", kinematics.node_rotation[:, :, bodies.nodes], inside, shares, optimize=True)
    return turned + np.einsum("ibn,b->ni", kinematics.node_position[:, bodies.nodes], shares)


def mass_jacobian(kinematics: Kinematics) -> Float[np.ndarray, "T 3 nv"]:
    """Return the Jacobian of the centre of mass by the tangent [m/m, m/rad]."""
    model = kinematics.model
    bodies = model.bodies
    shares, inside = _mass_shares(model)
    arms = np.einsum("ijbt,jb->ibt", kinematics.node_rotation[:, :, bodies.nodes], inside)
    arms += kinematics.node_position[:, bodies.nodes] - kinematics.node_position[:, :1]
    moved = shares * np.concatenate([np.ones((6, len(shares))), model.supports[1:, bodies.nodes]])
    axes = kinematics.motion_axes
    turning = np.cross(axes[3:], np.einsum("cb,ibt->ict", moved, arms), axis=0)
    return np.ascontiguousarray((axes[:3] * moved.sum(axis=1)[:, None] + turning).transpose(2, 0, 1))


def _fitted(path: np.ndarray, fps: float, seconds: float, derivative: int) -> np.ndarray:
    """Return a derivative of the cubics."""
    frames = len(path)
    window = min(2 * round(0.5 * (seconds * fps - 1.0)) + 1, frames - 1 + frames % 2)
    window = max(window, min(_CUBIC + 2, frames - 1 + frames % 2))
    if window < 3:
        return path.copy() if derivative == 0 else np.zeros_like(path)
    order = min(_CUBIC, window - 1)
    return savitzky_golay(path, window, order, derivative, 1.0 / fps)


@lru_cache(maxsize=8)
def _dynamics(model: RobotModel) -> mujoco.MjModel:
    """Return the robot alone, without contacts and stops."""
    compiled = compile_mjcf(model.spec.mjcf, model.spec.sites)
    compiled.dof_armature[6:] = actuators_of(model).armature
    compiled.dof_damping[:], compiled.dof_frictionloss[:] = 0.0, 0.0
    compiled.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    compiled.opt.gravity[:] = 0.0, 0.0, -GRAVITY
    return compiled


def _mass_shares(model: RobotModel) -> tuple[Float[np.ndarray, "B"], Float[np.ndarray, "3 B"]]:
    """Return the bodies' masses over the robot's, and their centres of mass in the frames of their nodes [m]."""
    bodies, inertias = model.bodies, model.inertias
    shares = inertias.masses / inertias.masses.sum()
    return shares, bodies.positions + np.einsum("ijb,bj->ib", bodies.rotations, inertias.centres)
