"""Chains of joints: rotations in the world from those to the parents, and whether bones keep their place."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.skeleton import JOINT_INDEX, JOINTS, PARENT
from hoi_retarget.numerics import se3

PARENTS: tuple[int, ...] = tuple(-1 if PARENT[joint] is None else JOINT_INDEX[str(PARENT[joint])] for joint in JOINTS)
"""Of the joints in the order of `skeleton.JOINTS`; -1 for the root."""
BODY_PARENTS = PARENTS[:22]
"""Of those of the body, whose order is also SMPL-X's."""


def world_quats(pose: Float[np.ndarray, "T J 3"], parents: Sequence[int]) -> Float[np.ndarray, "T J 4"]:
    """Return joint rotations in the world, wxyz, from rotation vectors to the parents [rad], root first."""
    local = se3.exp(pose)
    quats = np.empty_like(local)
    for joint, parent in enumerate(parents):
        quats[:, joint] = local[:, joint] if parent < 0 else se3.quat_multiply(quats[:, parent], local[:, joint])
    return quats


def world_positions(
    root: Float[np.ndarray, "T 3"],
    bones: Float[np.ndarray, "J 3"],
    quats: Float[np.ndarray, "T J 4"],
    parents: Sequence[int],
) -> Float[np.ndarray, "T J 3"]:
    """Return joint positions in the world [m] from joints' places in their parents' frames; the root's is unused."""
    positions = np.empty((*quats.shape[:2], 3))
    for joint, parent in enumerate(parents):
        if parent < 0:
            positions[:, joint] = root
        else:
            positions[:, joint] = positions[:, parent] + se3.rotate(quats[:, parent], bones[joint][None])
    return positions


def bones_in_parents(
    positions: Float[np.ndarray, "T J 3"], quats: Float[np.ndarray, "T J 4"], parents: Sequence[int]
) -> Float[np.ndarray, "T J 3"]:
    """Return each joint's place in its parent's frame [m], the same in all frames of rigid bones; zero for the root."""
    bones = np.zeros_like(positions)
    children = [joint for joint, parent in enumerate(parents) if parent >= 0]
    above = [parents[joint] for joint in children]
    bones[:, children] = se3.rotate_inverse(quats[:, above], positions[:, children] - positions[:, above])
    return bones


def wandering(bones: Float[np.ndarray, "T J 3"]) -> Float[np.ndarray, "T J"]:
    """Return how far each joint is from its mean place in its parent's frame [m]."""
    return np.linalg.norm(bones - bones.mean(axis=0), axis=-1)
