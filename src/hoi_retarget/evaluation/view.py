"""Human and robot side by side, frame by frame: what every figure is computed from.

`Comparison` cuts both sides to the frames that count and gives each side's points and rotations
by name; the figures themselves are in the other files of this package.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import HANDS
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.robots.model import Kinematics

T = TypeVar("T")

HAND_SITES = {"left_hand": "left_palm", "right_hand": "right_palm"}
FOOT_SITES = {"left_foot": "left_foot", "right_foot": "right_foot"}

# A recording's first frame is often a rest pose or a copy; all programs are compared from the second on.
FIRST_COUNTED_SOURCE_FRAME = 1


@dataclass(frozen=True, eq=False)
class ObjectPose:
    """World pose of one object over the counted frames."""

    positions: Float[np.ndarray, "F 3"]
    """[m]"""
    rotations: Float[np.ndarray, "F 3 3"]

    def points_inside(self, points_world: Float[np.ndarray, "F 3"]) -> Float[np.ndarray, "F 3"]:
        """Return world points, one a frame, in the object's frame [m] (paper Eq. 1)."""
        return self.vectors_inside((points_world - self.positions)[:, None])[:, 0]

    def vectors_inside(self, vectors_world: Float[np.ndarray, "F K 3"]) -> Float[np.ndarray, "F K 3"]:
        """Return world vectors, K a frame, along the object's axes."""
        return vectors_world @ self.rotations

    def rotations_inside(self, rotations_world: Float[np.ndarray, "F 3 3"]) -> Float[np.ndarray, "F 3 3"]:
        """Return world rotations, one a frame, relative to the object."""
        return np.swapaxes(self.rotations, 1, 2) @ rotations_world


@dataclass(frozen=True, eq=False)
class Comparison:
    """One person of a clip and the robot that follows it, over the F frames that count.

    Those are the source's frames from the second on: the clip's frames but the first, or all of
    them where the reader has already dropped leading ones.
    """

    motion: Motion
    clip: Clip
    person: int
    kinematics: Kinematics

    def __post_init__(self) -> None:
        people = len(self.clip.people)
        if not 0 <= self.person < people:
            raise ArgumentError(f"clip {self.clip.name!r}: no person {self.person}; there are 0 to {people - 1}.")
        for what, robot_side, human_side in (
            ("frames", self.motion.frames, self.clip.frames),
            ("frames a second", self.motion.fps, self.clip.fps),
            ("objects", len(self.motion.object_names), len(self.clip.objects)),
        ):
            if robot_side != human_side:
                raise ClipError(
                    f"clip {self.clip.name!r}: the motion has {robot_side} {what}, the clip {human_side}. "
                    "Evaluate a motion against the clip it was made from."
                )

    def once(self, compute: Callable[["Comparison"], T]) -> T:
        """Return a function's value at this comparison, computed once for all figures that need it."""
        if compute not in self._computed:
            self._computed[compute] = compute(self)
        return self._computed[compute]

    @cached_property
    def _computed(self) -> dict[Callable[["Comparison"], Any], Any]:
        return {}

    @cached_property
    def first(self) -> int:
        """Index of the first clip frame that counts."""
        return max(0, FIRST_COUNTED_SOURCE_FRAME - self.clip.first_source_frame)

    @property
    def human(self) -> Person:
        """The person that the robot follows."""
        return self.clip.people[self.person]

    @property
    def object_count(self) -> int:
        """Number of objects O."""
        return len(self.clip.objects)

    @cached_property
    def stance(self) -> Bool[np.ndarray, "F 2"]:
        """Left and right foot on the floor, as the motion was asked to have them."""
        return self.motion.stance_flags[self.first :]

    @cached_property
    def hand_contacts(self) -> tuple[ContactTrack, ...]:
        """The person's hand contacts, cut to the counted frames."""
        return tuple(
            ContactTrack(
                track.person, track.object, track.part, track.active[self.first :], track.contact_points[self.first :]
            )
            for track in self.clip.contacts
            if track.person == self.person and track.part in HANDS
        )

    def human_point(self, joint: str) -> Float[np.ndarray, "F 3"]:
        """Return the world position of a human joint [m]."""
        return self.human.position(joint)[self.first :]

    def human_rotation(self, joint: str) -> Float[np.ndarray, "F 3 3"]:
        """Return the world rotation of a human joint."""
        return se3.quat_to_matrix(self.human.quat(joint)[self.first :])

    def human_part_point(self, part: str) -> Float[np.ndarray, "F 3"]:
        """Return the world position of a human part's contact point [m]."""
        return self.human.part_position(part)[self.first :]

    def human_part_rotation(self, part: str) -> Float[np.ndarray, "F 3 3"]:
        """Return the world rotation of a human part."""
        return se3.quat_to_matrix(self.human.part_quat(part)[self.first :])

    def robot_point(self, site: str) -> Float[np.ndarray, "F 3"]:
        """Return the world position of a robot site [m]."""
        return self.kinematics.site_position(site)[self.first :]

    def robot_rotation(self, site: str) -> Float[np.ndarray, "F 3 3"]:
        """Return the world rotation of a robot site."""
        return self.kinematics.site_rotation(site)[self.first :]

    @cached_property
    def human_objects(self) -> tuple[ObjectPose, ...]:
        """The objects as the human moved them."""
        return tuple(
            ObjectPose(track.positions[self.first :], se3.quat_to_matrix(track.quats[self.first :]))
            for track in self.clip.objects
        )

    @cached_property
    def robot_objects(self) -> tuple[ObjectPose, ...]:
        """The objects as the robot moves them."""
        positions, quats = self.motion.object_pos[self.first :], self.motion.object_quat[self.first :]
        return tuple(
            ObjectPose(positions[:, index], se3.quat_to_matrix(quats[:, index])) for index in range(self.object_count)
        )

    @cached_property
    def main_object(self) -> int | None:
        """The object that the person's hands and feet touch longest; the first one if none is touched."""
        if self.object_count == 0:
            return None
        touched = np.zeros(self.object_count, dtype=int)
        for track in self.clip.contacts:
            if track.person == self.person:
                touched[track.object] += np.count_nonzero(track.active[self.first :])
        return int(np.argmax(touched))
