"""Where all bodies of a robot are and how they move, over a whole motion.

Formats differ in the point whose linear velocity they store: MuJoCo's link frame has its origin at
the joint, simulators built on PhysX tell the velocity of the centre of mass.
"""

from dataclasses import dataclass

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
    pos: Float[np.ndarray, "T B 3"]
    """Link origins [m]."""
    quat: Float[np.ndarray, "T B 4"]
    """wxyz, without jumps of sign over time."""
    lin_vel: Float[np.ndarray, "T B 3"]
    """Of the link origins [m/s]."""
    com_lin_vel: Float[np.ndarray, "T B 3"]
    """Of the centres of mass [m/s]."""
    ang_vel: Float[np.ndarray, "T B 3"]
    """[rad/s]"""


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
