"""Links and joints of a robot over a whole motion, as simulators and the robot's own description have them.

Formats differ in the point whose linear velocity they store: MuJoCo's link frame has its origin at the joint, and
simulators built on PhysX store the velocity of the centre of mass. A description may have more joints than the robot
moves: held ones, and ones that are coupled to others.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.motion.resample import ResampledMotion
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen
from hoi_retarget.robots.model import Kinematics, RobotModel


@dataclass(frozen=True, eq=False)
class LinkStates:
    """Bodies over time in the world; T frames, B bodies in MuJoCo's order, which is depth first."""

    names: tuple[str, ...]
    pos: Float[np.ndarray, "T B 3"]  # Link origins [m].
    quat: Float[np.ndarray, "T B 4"]  # wxyz, without jumps of sign over time.
    lin_vel: Float[np.ndarray, "T B 3"]  # Of the link origins [m/s].
    com_lin_vel: Float[np.ndarray, "T B 3"]  # Of the centres of mass [m/s].
    ang_vel: Float[np.ndarray, "T B 3"]  # [rad/s]


def link_states(motion: ResampledMotion) -> LinkStates:
    """Return poses and velocities of all bodies, by forward kinematics."""
    kinematics = motion.model.forward(motion.qpos)
    bodies = motion.model.bodies
    angular, linear = _node_twists(kinematics, motion)
    turn = kinematics.node_rotation[:, :, bodies.nodes]
    lever = np.einsum("ijkt,jk->ikt", turn, bodies.positions)
    rotation = np.einsum("ijkt,jlk->ilkt", turn, bodies.rotations)
    to_com = np.einsum("ijkt,jk->ikt", rotation, motion.model.inertias.centres.T)
    spin = angular[:, bodies.nodes]
    velocity = linear[:, bodies.nodes] + np.cross(spin, lever, axis=0)
    quat = se3.quat_continuous(se3.matrix_to_quat(rotation.transpose(3, 2, 0, 1)))
    return LinkStates(
        names=bodies.names,
        pos=frozen((kinematics.node_position[:, bodies.nodes] + lever).transpose(2, 1, 0)),
        quat=frozen(quat),
        lin_vel=frozen(velocity.transpose(2, 1, 0)),
        com_lin_vel=frozen((velocity + np.cross(spin, to_com, axis=0)).transpose(2, 1, 0)),
        ang_vel=frozen(spin.transpose(2, 1, 0)),
    )


def breadth_first(model: RobotModel) -> tuple[Int[np.ndarray, "B"], Int[np.ndarray, "n"]]:
    """Return the order of bodies and of joints as Isaac Lab has them: level by level down the tree."""
    hinges = np.concatenate([np.asarray(level) for level in model.levels])
    depth = np.zeros(model.n + 1, dtype=int)
    for number, level in enumerate(model.levels, start=1):
        depth[level + 1] = number
    # Within a level, the joints stand as in the MJCF.
    return np.argsort(depth[model.bodies.nodes], kind="stable"), hinges


def _node_twists(kinematics: Kinematics, motion: ResampledMotion) -> tuple[np.ndarray, np.ndarray]:
    """Return every node's angular velocity and that of its origin, (3, N, T)."""
    model, position = kinematics.model, kinematics.node_position
    angular, linear = np.empty_like(position), np.empty_like(position)
    angular[:, 0], linear[:, 0] = motion.root_ang_vel.T, motion.root_lin_vel.T
    axes = np.einsum("ijkt,jk->ikt", kinematics.node_rotation[:, :, 1:], model.axes)
    turning = axes * motion.joint_vel.T
    for hinges in model.levels:
        parents = model.parents[hinges]
        lever = position[:, hinges + 1] - position[:, parents]
        angular[:, hinges + 1] = angular[:, parents] + turning[:, hinges]
        linear[:, hinges + 1] = linear[:, parents] + np.cross(angular[:, parents], lever, axis=0)
    return angular, linear


@dataclass(frozen=True, eq=False)
class SourceJoints:
    """All joints of a robot's description over time, in its order."""

    names: tuple[str, ...]
    pos: Float[np.ndarray, "T m"]  # [rad], of a slide [m].
    vel: Float[np.ndarray, "T m"]  # [rad/s], of a slide [m/s].


def source_joint_names(model: RobotModel) -> tuple[str, ...]:
    """Return the names of all joints of a robot's description, in its order."""
    return model.spec.joint_order or model.joint_names


def source_joints(motion: ResampledMotion) -> SourceJoints:
    """Return all joints of a motion: held ones are constant, coupled ones follow as in the description."""
    model = motion.model
    pos = dict(zip(model.joint_names, motion.qpos[:, 7:].T, strict=True))
    vel = dict(zip(model.joint_names, motion.joint_vel.T, strict=True))
    waiting = list(model.spec.held)
    still = np.zeros(motion.frames)
    while waiting:
        ready = [one for one in waiting if not one.other or one.other in pos]
        # Joints that are coupled in a circle follow none: they stay at their offset.
        for one in ready or waiting:
            ratio = one.ratio if one.other in pos else 0.0
            pos[one.joint] = one.offset + ratio * pos.get(one.other, still)
            vel[one.joint] = ratio * vel.get(one.other, still)
        waiting = [one for one in waiting if one.joint not in pos]
    names = source_joint_names(model)
    return SourceJoints(names, *(np.stack([of[name] for name in names], axis=1) for of in (pos, vel)))


def held_joints(model: RobotModel, names: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return the offsets and couplings of the held joints among some names, as plain values."""
    return [
        {"name": one.joint, "value": one.offset}
        | ({"follows": one.other, "ratio": one.ratio} if one.other and one.ratio else {})
        for one in model.spec.held
        if one.joint in names
    ]
