"""Parametric human bodies, SMPL-X and SMPL-H: joints and skin from shape and pose, for all frames at once.

A body is blend shapes on a template, a regressor from vertices to joints, and linear blend skinning. The numbers are
licensed by their authors and are not part of this package; `readers.body_models` reads their files.

Frames are those of the model: rest pose along +y, looking along +z, metres. Rotations go in as rotation vectors, a row
for each joint, root first.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import ArgumentError, ReadError
from hoi_retarget.human.skeleton import JOINT_INDEX, PARENTS, world_positions, world_quats
from hoi_retarget.human.skinned_mesh import blended
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import frozen

Family = Literal["smplx", "smplh"]
Gender = Literal["neutral", "male", "female"]

JOINT_COUNT: dict[Family, int] = {"smplx": 55, "smplh": 52}
_FACE = 3  # Jaw and eyes stand between the body's and the hands' joints in SMPL-X.
_BODY_JOINTS, _HAND_JOINTS = 22, 15


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A body's template, blend shapes and skinning; V vertices, J joints, B shape components.

    Raises `ReadError` when arrays disagree in shape or are not finite, or parents are not a tree in order.
    """

    family: Family
    gender: Gender
    template: Float[np.ndarray, "V 3"]  # Vertices of the mean body in the rest pose [m].
    shape_directions: Float[np.ndarray, "V 3 B"]  # Displacement of vertices for each shape component [m].
    pose_directions: Float[np.ndarray, "V 3 P"]
    """Displacement of vertices for each entry of the joints' rotation matrices less identity, root left out [m]."""
    regressor: Float[np.ndarray, "J V"]  # Joints from the vertices of the rest pose.
    weights: Float[np.ndarray, "V J"]  # How much each joint moves each vertex.
    parents: Int[np.ndarray, "J"]  # -1 for the root.
    faces: Int[np.ndarray, "F 3"]
    left_components: Float[np.ndarray, "C 45"]
    """Principal components of the left hand's pose [rad]; without rows where the file has none."""
    right_components: Float[np.ndarray, "C 45"]
    left_mean: Float[np.ndarray, "45"]  # Mean pose of the left hand [rad].
    right_mean: Float[np.ndarray, "45"]

    def __post_init__(self) -> None:
        kinds = {"parents": int, "faces": int}
        for name, shape in self._shapes().items():
            array = np.asarray(getattr(self, name))
            if array.shape != shape:
                raise ReadError(f"body model: {name} has shape {array.shape}, expected {shape}. Download it again.")
            if not np.isfinite(array).all():
                raise ReadError(f"body model: {name} holds numbers that are not finite. Download it again.")
            object.__setattr__(self, name, frozen(array, kinds.get(name, float)))
        ordered = self.parents[0] == -1 and (self.parents[1:] >= 0).all()
        if not ordered or (self.parents[1:] >= np.arange(1, len(self.parents))).any():
            raise ReadError("body model: parents do not come before their children. Download it again.")
        if ((self.faces < 0) | (self.faces >= len(self.template))).any():
            raise ReadError(f"body model: faces name vertices beyond its {len(self.template)}. Download it again.")

    def _shapes(self) -> dict[str, tuple[int, ...]]:
        vertices, joints = len(self.template), JOINT_COUNT[self.family]
        hand = 3 * _HAND_JOINTS
        return {
            "template": (vertices, 3),
            "shape_directions": (vertices, 3, *np.shape(self.shape_directions)[-1:]),
            "pose_directions": (vertices, 3, 9 * (joints - 1)),
            "regressor": (joints, vertices),
            "weights": (vertices, joints),
            "parents": (joints,),
            "faces": (len(self.faces), 3),
            "left_components": (len(self.left_components), hand),
            "right_components": (len(self.left_components), hand),
            "left_mean": (hand,),
            "right_mean": (hand,),
        }

    @property
    def betas(self) -> int:
        """Number of shape components."""
        return self.shape_directions.shape[-1]

    @property
    def skeleton_joints(self) -> Int[np.ndarray, "52"]:
        """Indices of the joints of `skeleton.JOINTS`: all but jaw and eyes."""
        joints = np.arange(JOINT_COUNT[self.family])
        face = (joints >= _BODY_JOINTS) & (joints < len(joints) - 2 * _HAND_JOINTS)
        return joints[~face]

    def pose(
        self,
        body: Float[np.ndarray, "T 66"],
        left_hand: Float[np.ndarray, "T L"],
        right_hand: Float[np.ndarray, "T L"],
        *,
        flat_hands: bool,
    ) -> Float[np.ndarray, "T J 3"]:
        """Return rotation vectors of all joints [rad]; jaw and eyes rest.

        Raises `ArgumentError` for hands of more numbers than there are components, or none of either kind.

        `body`: rotation vectors of the body's joints [rad], root first; `left_hand`: 45 numbers are rotation vectors
        [rad]; fewer, weights of as many principal components; `right_hand`: likewise; `flat_hands`: whether hands are
        counted from flat ones; otherwise from the model's mean hand.
        """
        frames = len(body)
        rows = [body.reshape(frames, _BODY_JOINTS, 3)]
        if self.family == "smplx":
            rows.append(np.zeros((frames, _FACE, 3)))
        for hand, components, mean in (
            (left_hand, self.left_components, self.left_mean),
            (right_hand, self.right_components, self.right_mean),
        ):
            full = self._full_hand(hand, components) + (0.0 if flat_hands else mean)
            rows.append(full.reshape(frames, _HAND_JOINTS, 3))
        return np.concatenate(rows, axis=1)

    def _full_hand(self, hand: np.ndarray, components: np.ndarray) -> np.ndarray:
        count = hand.shape[1]
        if count == 3 * _HAND_JOINTS:
            return hand
        if not 0 < count <= len(components):
            raise ArgumentError(
                f"The hand's pose has {count} numbers a frame; expected 45 rotation components, or at most "
                f"{len(components)}, the principal components that this {self.family} model has."
            )
        return hand @ components[:count]

    def rest_joints(self, betas: Float[np.ndarray, "b"]) -> Float[np.ndarray, "J 3"]:
        """Return the joints of a body at rest [m]; raises `ArgumentError` for more betas than the model has."""
        # The regressor first: joints then cost nothing next to vertices.
        directions = np.einsum("jv,vkb->jkb", self.regressor, self.shape_directions[..., : self._checked(betas)])
        return self.regressor @ self.template + directions @ betas

    def joints(
        self, betas: Float[np.ndarray, "b"], pose: Float[np.ndarray, "T J 3"], translation: Float[np.ndarray, "T 3"]
    ) -> tuple[Float[np.ndarray, "T J 3"], Float[np.ndarray, "T J 4"]]:
        """Return positions [m] and rotations, wxyz, of all joints.

        The root is the rest pose's pelvis plus the translation: it turns about itself, not about the origin. Raises
        `ArgumentError` for more betas than the model has, and a pose of another number of joints.
        """
        self._check_pose(pose)
        rest, parents = self.rest_joints(betas), self.parents.tolist()
        quats = world_quats(pose, parents)
        return world_positions(rest[0] + translation, rest - rest[parents], quats, parents), quats

    def _checked(self, betas: np.ndarray) -> int:
        if len(betas) > self.betas:
            raise ArgumentError(
                f"{len(betas)} betas are given; this {self.gender} {self.family} model has {self.betas}. "
                "Use the model that they were fitted with."
            )
        return len(betas)

    def _check_pose(self, pose: np.ndarray) -> None:
        joints = JOINT_COUNT[self.family]
        if pose.shape[1] != joints:
            other = next((name for name, count in JOINT_COUNT.items() if count == pose.shape[1]), None)
            looks = f", which is {other}'s" if other else ""
            raise ArgumentError(
                f"The pose has {pose.shape[1]} joints{looks}; this {self.family} model has {joints}. "
                "Use the model that it was fitted with."
            )


@dataclass(frozen=True, eq=False)
class BodyShape:
    """One person's skin: a body model with the person's betas, moved by the joints of `skeleton.JOINTS`.

    Jaw and eyes rest, so the skin follows from these joints alone, in any world.
    Raises `ArgumentError` for more betas than the model has.
    """

    model: BodyModel
    betas: Float[np.ndarray, "b"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "betas", frozen(self.betas))
        _ = self.rest_joints  # Checks the betas.

    def skin(
        self,
        positions: Float[np.ndarray, "T 52 3"],
        quats: Float[np.ndarray, "T 52 4"],
        vertices: Int[np.ndarray, "n"] | None = None,
    ) -> Float[np.ndarray, "T n 3"]:
        """Return places of vertices for places and rotations of the joints [m]; of all, unless some are named."""
        chosen = slice(None) if vertices is None else vertices
        shaped, weights = self.rest_vertices[chosen], self._weights[chosen]
        directions = self.model.pose_directions[chosen][..., self._bending].reshape(3 * len(shaped), -1)
        turns = se3.quat_to_matrix(quats)
        local = np.swapaxes(turns[:, PARENTS[1:]], -1, -2) @ turns[:, 1:] - np.eye(3)
        moves = positions - np.einsum("tjab,jb->tja", turns, self.rest_joints)

        def bent(chunk: slice) -> Float[np.ndarray, "t n 3"]:
            return shaped + (local[chunk].reshape(len(local[chunk]), -1) @ directions.T).reshape(-1, *shaped.shape)

        return blended(weights, turns, moves, bent)

    @cached_property
    def owners(self) -> Int[np.ndarray, "V"]:
        """The index of the joint that moves each vertex more than any other does."""
        return self._weights.argmax(axis=1)

    @cached_property
    def rest_vertices(self) -> Float[np.ndarray, "V 3"]:
        """The skin in the T-pose [m]."""
        return self.model.template + self.model.shape_directions[..., : len(self.betas)] @ self.betas

    @cached_property
    def rest_joints(self) -> Float[np.ndarray, "52 3"]:
        """The joints of `skeleton.JOINTS` in the T-pose [m]."""
        return self.model.rest_joints(self.betas)[self.model.skeleton_joints]

    @cached_property
    def _weights(self) -> Float[np.ndarray, "V 52"]:
        """Weights of the skeleton's joints; jaw and eyes are added to the head."""
        weights = self.model.weights[:, self.model.skeleton_joints].copy()
        face = np.setdiff1d(np.arange(JOINT_COUNT[self.model.family]), self.model.skeleton_joints)
        weights[:, JOINT_INDEX["head"]] += self.model.weights[:, face].sum(axis=1)
        return weights

    @property
    def faces(self) -> Int[np.ndarray, "F 3"]:
        """The skin's triangles."""
        return self.model.faces

    @property
    def _bending(self) -> Int[np.ndarray, "459"]:
        """Which of the pose's displacements are of the skeleton's joints."""
        first = 9 * (self.model.skeleton_joints[1:] - 1)
        return (first[:, None] + np.arange(9)).reshape(-1)
