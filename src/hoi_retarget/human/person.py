"""One person over time: world poses of the skeleton's joints, and stance from geometry.

World frame: z up, floor at z = 0, metres, seconds. All arrays are read-only copies.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.human.body_model import BodyShape
from hoi_retarget.human.skeleton import ALL_PARTS, HEIGHT_OVER_CHAIN, JOINT_INDEX, JOINTS
from hoi_retarget.human.skinned_mesh import SkinnedMesh
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import check_finite, check_shape, frozen, unit_quats
from hoi_retarget.numerics.filters import speeds


@dataclass(frozen=True, eq=False)
class Person:
    """One human: world poses of the 52 joints of `skeleton.JOINTS`."""

    name: str
    joint_positions: Float[np.ndarray, "T 52 3"]  # World positions [m].
    joint_quats: Float[np.ndarray, "T 52 4"]
    """World rotations, wxyz, identity in the T-pose that stands along +y and looks along +z."""
    fingers_recorded: bool = True
    """Whether the finger joints are the person's own; otherwise they are straight and made up."""
    shape: BodyShape | SkinnedMesh | None = None
    """The person's skin, where the source has it, or its body model is at hand."""
    stature: float | None = None  # Standing height [m], where the source has it; otherwise it is estimated.
    toe_height: float | None = None
    """Of the toe joints over the soles [m], where the source's skeleton is known; otherwise that of SMPL-X's."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint_positions", frozen(self.joint_positions))
        frames = len(self.joint_positions)
        check_shape(f"person {self.name!r}", "joint_positions", self.joint_positions, (frames, len(JOINTS), 3))
        check_shape(f"person {self.name!r}", "joint_quats", np.asarray(self.joint_quats), (frames, len(JOINTS), 4))
        check_finite(f"person {self.name!r}", {"joint_positions": self.joint_positions})
        object.__setattr__(self, "joint_quats", unit_quats(f"person {self.name!r}", "joint_quats", self.joint_quats))

    def window(self, start: int, stop: int) -> "Person":
        """Return the person in some consecutive frames, as tall as in all of them."""
        frames = slice(start, stop)
        joints = {"joint_positions": self.joint_positions[frames], "joint_quats": self.joint_quats[frames]}
        return replace(self, **joints, stature=self.height)

    def position(self, joint: str) -> Float[np.ndarray, "T 3"]:
        """Return the world position of a joint [m]."""
        return self.joint_positions[:, JOINT_INDEX[joint]]

    def quat(self, joint: str) -> Float[np.ndarray, "T 4"]:
        """Return the world rotation of a joint (quaternion, wxyz)."""
        return self.joint_quats[:, JOINT_INDEX[joint]]

    def part_position(self, part: str) -> Float[np.ndarray, "T 3"]:
        """Return the world position of a part's contact point [m]."""
        return np.mean([self.position(joint) for joint in ALL_PARTS[part].point_joints], axis=0)

    def part_quat(self, part: str) -> Float[np.ndarray, "T 4"]:
        """Return the world rotation of a part (quaternion, wxyz)."""
        return self.quat(ALL_PARTS[part].rotation_joint)

    @cached_property
    def height(self) -> float:
        """Standing height [m]: the source's, or estimated from the skeleton's legs, their mean, and its trunk."""
        if self.stature is not None:
            return self.stature
        legs = [self._length(f"{side}_hip", f"{side}_knee", f"{side}_ankle") for side in ("left", "right")]
        trunk = self._length("pelvis", "spine1", "spine2", "spine3", "neck", "head")
        return HEIGHT_OVER_CHAIN * (float(np.mean(legs)) + trunk)

    def _length(self, *chain: str) -> float:
        """Return the length of a chain of joints [m], its mean over time."""
        bones = [np.linalg.norm(self.position(b) - self.position(a), axis=-1) for a, b in pairwise(chain)]
        return float(np.mean(np.sum(bones, axis=0)))


_STANCE_HEIGHT = 0.10  # [m] of the toe joint
_STANCE_HEIGHT_OVER_LOWEST = 0.04  # [m] over that toe's own lowest height
STANCE_SPEED = 0.30  # [m/s]
LARGEST_TILT = np.radians(60.0)  # Standing feet have 35 degrees at most; those of people who sit or kneel lie over.
LARGEST_DIFFERENCE = 0.05  # [m] between the lowest heights of two feet that both stand in a clip


def stance(person: Person, fps: float) -> Bool[np.ndarray, "T 2"]:
    """Return when the left and the right foot stand: toe joint low and slow, the sole underneath.

    The thresholds of height and speed are those of the authors' public release.
    """
    flags = []
    joints = ("left_foot", "right_foot")
    toes = [person.position(joint) for joint in joints]
    floor = min(float(toe[:, 2].min()) for toe in toes)
    for joint, toe in zip(joints, toes, strict=True):
        speed = speeds(toe, fps)
        # A foot that is held up all the time has a lowest height, too, but does not stand there.
        lowest = min(float(toe[:, 2].min()), floor + LARGEST_DIFFERENCE)
        limit = max(_STANCE_HEIGHT, lowest + _STANCE_HEIGHT_OVER_LOWEST)
        upright = se3.quat_to_matrix(person.quat(joint))[:, 2, 1] > np.cos(LARGEST_TILT)
        flags.append((toe[:, 2] < limit) & (speed < STANCE_SPEED) & upright)
    return np.stack(flags, axis=1)
