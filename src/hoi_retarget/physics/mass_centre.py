"""Where a robot's centre of mass is, and how it moves."""

import numpy as np
from jaxtyping import Float

from hoi_retarget.robots.model import Kinematics


def mass_centres(kinematics: Kinematics) -> Float[np.ndarray, "T 3"]:
    """Return the robot's centres of mass [m]."""
    bodies, inertias = kinematics.model.bodies, kinematics.model.inertias
    shares = inertias.masses / inertias.masses.sum()
    inside = bodies.positions + np.einsum("ijb,bj->ib", bodies.rotations, inertias.centres)
    turned = np.einsum("ijbn,jb,b->ni", kinematics.node_rotation[:, :, bodies.nodes], inside, shares, optimize=True)
    return turned + np.einsum("ibn,b->ni", kinematics.node_position[:, bodies.nodes], shares)


def mass_jacobian(kinematics: Kinematics) -> Float[np.ndarray, "T 3 nv"]:
    """Return how the centre of mass follows the tangent."""
    model = kinematics.model
    bodies, inertias = model.bodies, model.inertias
    shares = inertias.masses / inertias.masses.sum()
    inside = bodies.positions + np.einsum("ijb,bj->ib", bodies.rotations, inertias.centres)
    arms = np.einsum("ijbt,jb->ibt", kinematics.node_rotation[:, :, bodies.nodes], inside)
    arms += kinematics.node_position[:, bodies.nodes] - kinematics.node_position[:, :1]
    moved = shares * np.concatenate([np.ones((6, len(shares))), model.supports[1:, bodies.nodes]])
    axes = kinematics.motion_axes
    turning = np.cross(axes[3:], np.einsum("cb,ibt->ict", moved, arms), axis=0)
    return np.ascontiguousarray((axes[:3] * moved.sum(axis=1)[:, None] + turning).transpose(2, 0, 1))
