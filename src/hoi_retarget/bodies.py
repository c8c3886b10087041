"""Parametric human bodies, SMPL-X and SMPL-H: joints and skin from shape and pose, for all frames at once.

A body is blend shapes on a template, a regressor from vertices to joints, and linear blend skinning. The numbers are
licensed by their makers and are not part of this package; `readers.body_models` reads their files.

Frames are those of the model: rest pose along +y, looking along +z, metres. Rotations go in as rotation vectors, a row
for each joint, root first.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget import se3
from hoi_retarget.arrays import frozen
from hoi_retarget.errors import ArgumentError, ReadError

Family = Literal["smplx", "smplh"]
Gender = Literal["neutral", "male", "female"]

JOINT_COUNT: dict[Family, int] = {"smplx": 55, "smplh": 52}
_FACE = 3  # Jaw and eyes stand between the body's and the hands' joints in SMPL-X.
_BODY_JOINTS, _HAND_JOINTS = 22, 15
_CHUNK = 64  # Frames whose vertices are made at once: bounds the memory, and fits caches.


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A body's template, blend shapes and skinning; V vertices, J joints, B shape components.

    Raises `ReadError` when arrays disagree in shape or are not finite, or parents are not a tree in order.
    """

    family: Family
    gender: Gender
    template: Float[np.ndarray, "V 3"]
    """Vertices of the mean body in the rest pose [m]."""
    shape_directions: Float[np.ndarray, "V 3 B"]
    """Displacement of vertices for each shape component [m]."""
    pose_directions: Float[np.ndarray, "V 3 P"]
    """Displacement of vertices for each entry of the joints' rotation matrices less identity, root left out [m]."""
    regressor: Float[np.ndarray, "J V"]
    """Joints from the vertices of the rest pose."""
    weights: Float[np.ndarray, "V J"]
    """How much each joint moves each vertex."""
    parents: Int[np.ndarray, "J"]
    """-1 for the root."""
    faces: Int[np.ndarray, "F 3"]
    left_components: Float[np.ndarray, "C 45"]
    """Principal components of the left hand's pose [rad]; without rows where the file has none."""
    right_components: Float[np.ndarray, "C 45"]
    left_mean: Float[np.ndarray, "45"]
    """Mean pose of the left hand [rad]."""
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
            "shape_directions": (vertices, 3, np.shape(self.shape_directions)[-1]),
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
        """Number of shape components there are."""
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
        """Return rotation vectors of all joints [rad] from those of the body, root first, and of the hands.

        Hands of 45 numbers are rotation vectors; of fewer, weights of as many principal components. Both are counted
        from the model's mean hand, unless `flat_hands`. Jaw and eyes rest.

        Raises:
            ArgumentError: hands of more numbers than there are components, or none of either kind.
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
        self,
        betas: Float[np.ndarray, "b"],
        pose: Float[np.ndarray, "T J 3"],
        translation: Float[np.ndarray, "T 3"],
    ) -> tuple[Float[np.ndarray, "T J 3"], Float[np.ndarray, "T J 4"]]:
        """Return positions [m] and rotations, wxyz, of all joints.

        The root is the rest pose's pelvis plus the translation: it turns about itself, not about the origin.

        Raises:
            ArgumentError: more betas than the model has, or a pose of another number of joints.
        """
        self._check_pose(pose)
        return self._posed(self.rest_joints(betas), pose, translation)

    def vertices(
        self,
        betas: Float[np.ndarray, "b"],
        pose: Float[np.ndarray, "T J 3"],
        translation: Float[np.ndarray, "T 3"],
    ) -> Float[np.ndarray, "T V 3"]:
        """Return the skin [m].

        Raises:
            ArgumentError: more betas than the model has, or a pose of another number of joints.
        """
        self._check_pose(pose)
        shaped = self.template + self.shape_directions[..., : self._checked(betas)] @ betas
        rest = self.regressor @ shaped
        positions, quats = self._posed(rest, pose, translation)
        local = se3.quat_to_matrix(se3.exp(pose[:, 1:])) - np.eye(3)
        turns = se3.quat_to_matrix(quats)
        moves = positions - np.einsum("tjab,jb->tja", turns, rest)
        skin = np.empty((len(pose), *self.template.shape))
        directions = self.pose_directions.reshape(-1, self.pose_directions.shape[-1])
        # A rotation and a translation for each vertex, as one row of twelve numbers for each joint.
        rigid = np.concatenate([turns, moves[..., None]], axis=-1).reshape(len(pose), -1, 12)
        for first in range(0, len(pose), _CHUNK):
            chunk = slice(first, first + _CHUNK)
            features = local[chunk].reshape(len(local[chunk]), -1)
            bent = shaped + (features @ directions.T).reshape(-1, *shaped.shape)
            blended = (self.weights @ rigid[chunk]).reshape(*bent.shape[:2], 3, 4)
            skin[chunk] = np.einsum("tvab,tvb->tva", blended[..., :3], bent) + blended[..., 3]
        return skin

    def _posed(
        self, rest: np.ndarray, pose: np.ndarray, translation: np.ndarray
    ) -> tuple[Float[np.ndarray, "T J 3"], Float[np.ndarray, "T J 4"]]:
        local = se3.exp(pose)
        quats, positions = np.empty_like(local), np.empty_like(pose)
        quats[:, 0], positions[:, 0] = local[:, 0], rest[0] + translation
        for joint, parent in list(enumerate(self.parents))[1:]:
            quats[:, joint] = se3.quat_multiply(quats[:, parent], local[:, joint])
            positions[:, joint] = positions[:, parent] + se3.rotate(quats[:, parent], rest[joint] - rest[parent])
        return positions, quats

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
