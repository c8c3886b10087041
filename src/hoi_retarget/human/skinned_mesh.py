"""A person's skin as a mesh that is bound to the joints of the skeleton, moved by linear blend skinning."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.human.skeleton import JOINT_INDEX
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen

_CHUNK = 64  # Frames whose vertices are made at once: bounds the memory, and fits caches.


@dataclass(frozen=True, eq=False)
class SkinnedMesh:
    """The skin of a recording's own rig, V vertices in the pose in which they were bound to the joints."""

    rest_vertices: Float[np.ndarray, "V 3"]  # [m]
    faces: Int[np.ndarray, "F 3"]
    weights: Float[np.ndarray, "V 52"]  # How much each joint of `skeleton.JOINTS` moves each vertex; rows sum to 1.
    rest_joints: Float[np.ndarray, "52 3"]  # Places of the joints while the mesh is bound [m].
    rest_quats: Float[np.ndarray, "52 4"]  # Their rotations then, wxyz.

    def __post_init__(self) -> None:
        for name in ("rest_vertices", "weights", "rest_joints", "rest_quats"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "faces", frozen(self.faces, int))

    @cached_property
    def owners(self) -> Int[np.ndarray, "V"]:
        """The index of the joint that moves each vertex more than any other does."""
        return self.weights.argmax(axis=1)

    @property
    def is_rigid(self) -> bool:
        """Whether every vertex goes with one joint alone, as a robot's do."""
        return bool((self.weights.max(axis=1) == 1.0).all())

    def skin(
        self,
        positions: Float[np.ndarray, "T 52 3"],
        quats: Float[np.ndarray, "T 52 4"],
        vertices: Int[np.ndarray, "n"] | None = None,
    ) -> Float[np.ndarray, "T n 3"]:
        """Return places of vertices for places and rotations of the joints [m]; of all, unless some are named."""
        chosen = slice(None) if vertices is None else vertices
        turns = se3.quat_to_matrix(se3.quat_multiply(quats, se3.quat_conjugate(self.rest_quats)))
        moves = positions - np.einsum("tjab,jb->tja", turns, self.rest_joints)
        shape = self.rest_vertices[chosen]
        return blended(self.weights[chosen], turns, moves, lambda chunk: shape[None])


def vertices_of(owners: Int[np.ndarray, "V"], joints: Iterable[str]) -> Int[np.ndarray, "n"]:
    """Return the indices of the vertices that one of these joints moves more than any other does."""
    return np.flatnonzero(np.isin(owners, [JOINT_INDEX[joint] for joint in joints]))


def blended(
    weights: Float[np.ndarray, "n J"],
    turns: Float[np.ndarray, "T J 3 3"],
    moves: Float[np.ndarray, "T J 3"],
    shape_in: Callable[[slice], Float[np.ndarray, "t n 3"]],
) -> Float[np.ndarray, "T n 3"]:
    """Return vertices moved by the weighted mean of their joints' motions [m]; `moves` are added when turned.

    `shape_in` is the rest pose in some frames, or one row for all of them [m].
    """
    # A rotation and a translation for each vertex, as one row of twelve numbers for each joint.
    rigid = np.concatenate([turns, moves[..., None]], axis=-1).reshape(len(turns), -1, 12)
    skin = np.empty((len(turns), len(weights), 3))
    for first in range(0, len(turns), _CHUNK):
        chunk = slice(first, first + _CHUNK)
        motion = (weights @ rigid[chunk]).reshape(-1, len(weights), 3, 4)
        bent = np.broadcast_to(shape_in(chunk), motion.shape[:3])
        skin[chunk] = np.einsum("tvab,tvb->tva", motion[..., :3], bent) + motion[..., 3]
    return skin
