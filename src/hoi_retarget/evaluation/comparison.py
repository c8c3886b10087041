"""The human and the robot side by side, frame by frame, and the figures of merit that are computed from the two."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.clip.label_contacts import with_finger_contacts
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import BODY_PARTS, HANDS
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics import se3
from hoi_retarget.robots.link_depths import RigidPoses
from hoi_retarget.robots.model import Kinematics

T = TypeVar("T")

HAND_SITES = {"left_hand": "left_palm", "right_hand": "right_palm"}
FOOT_SITES = {"left_foot": "left_foot", "right_foot": "right_foot"}

# A recording's first frame is often a rest pose or a copy; all programs are compared from the second on.
FIRST_COUNTED_SOURCE_FRAME = 1


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

    def cached(self, compute: Callable[["Comparison"], T]) -> T:
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
        """Left and right foot on the floor, as the motion's targets have them."""
        return self.motion.stance_flags[self.first :]

    @cached_property
    def contacts(self) -> tuple[ContactTrack, ...]:
        """The person's contacts, cut to the counted frames."""
        clip = with_finger_contacts(self.clip, self.person) if self.kinematics.model.spec.fingers else self.clip
        return tuple(
            replace(track, active=track.active[self.first :], contact_points=track.contact_points[self.first :])
            for track in clip.contacts
            if track.person == self.person
        )

    @property
    def hand_contacts(self) -> tuple[ContactTrack, ...]:
        """The contacts of the hands alone."""
        return tuple(track for track in self.contacts if track.part in HANDS)

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
    def human_objects(self) -> tuple[RigidPoses, ...]:
        """The objects as the human moved them."""
        return tuple(
            RigidPoses(track.positions[self.first :], se3.quat_to_matrix(track.quats[self.first :]))
            for track in self.clip.objects
        )

    @cached_property
    def robot_objects(self) -> tuple[RigidPoses, ...]:
        """The objects as the robot moves them."""
        return object_poses(self.motion, self.first)

    @cached_property
    def main_object(self) -> int | None:
        """The object that the person's hands and feet touch longest; the first one if none is touched."""
        if self.object_count == 0:
            return None
        touched = np.zeros(self.object_count, dtype=int)
        for track in self.contacts:
            if track.part in BODY_PARTS:
                continue
            touched[track.object] += np.count_nonzero(track.active)
        return int(np.argmax(touched))


def object_poses(motion: Motion, first: int = 0) -> tuple[RigidPoses, ...]:
    """Return the poses of a motion's objects from one frame on."""
    positions, quats = motion.object_pos[first:], motion.object_quat[first:]
    objects = range(len(motion.object_names))
    return tuple(RigidPoses(positions[:, index], se3.quat_to_matrix(quats[:, index])) for index in objects)


_SCALES = {"mm": 1e3, "cm": 1e2, "cm/s": 1e2, "mm/s": 1e3, "%": 1e2}
"""Shown number over stored number by the shown unit; stored are metres, seconds, radians or degrees, and shares."""


@dataclass(frozen=True)
class Figure:
    """One figure of merit; `docs/metrics.md` gives every formula."""

    name: str  # Name, which ends in the unit of the stored number.
    title: str
    unit: str  # Unit in which it is shown.
    meaning: str  # The same in a short sentence without its full stop, for legends.
    measure: Callable[[Comparison], float | None] | None = None
    """Its value in stored units, None where it is undefined; no function where it is known from elsewhere."""
    digits: int = 1  # Digits after the point.
    better: Literal["lower", "higher"] = "lower"
    slow: bool = False
    """Whether it needs distances between surfaces, or forces: computing it may take as long as the solve."""
    needs_floor: bool = False  # Whether it depends on the height of the floor or the direction of gravity.

    @property
    def scale(self) -> float:
        """Ratio of the shown to the stored number."""
        return _SCALES.get(self.unit, 1.0)

    @property
    def header(self) -> str:
        """Title and unit."""
        return f"{self.title} [{self.unit}]"

    def text(self, value: float | None) -> str:
        """Return a stored number as it is shown; a dash where there is none."""
        return "-" if value is None else f"{value * self.scale:.{self.digits}f}"


def figure(title: str, unit: str, **options: Any) -> Callable[[Callable[[Comparison], float | None]], Figure]:
    """Return a decorator that makes a figure of the function that measures it.

    The figure has the function's name and, as its meaning, the first line of its docstring without the stored unit.
    Other fields of `Figure` are `options`.
    """

    def decorated(measure: Callable[[Comparison], float | None]) -> Figure:
        meaning = (measure.__doc__ or "").partition("\n")[0].partition(" [")[0].removesuffix(".")
        return Figure(measure.__name__, title, unit, meaning, measure, **options)

    return decorated


def mean_or_none(values: Float[np.ndarray, "..."]) -> float | None:
    """Return the mean of all values, in their unit; None if there is none."""
    return float(values.mean()) if values.size else None


def max_or_none(values: Float[np.ndarray, "..."]) -> float | None:
    """Return the largest of all values, in their unit; None if there is none."""
    return float(values.max()) if values.size else None


def percentile_or_none(values: Float[np.ndarray, "..."]) -> float | None:
    """Return the 95th percentile of all values, in their unit; None if there is none."""
    return float(np.percentile(values, 95)) if values.size else None


def finite_min_or_none(values: Float[np.ndarray, "..."]) -> float | None:
    """Return the smallest of all values, in their unit; None if there is none or all are infinite (no limit)."""
    smallest = values.min() if values.size else np.inf
    return float(smallest) if np.isfinite(smallest) else None


def direction_angles_deg(
    a: Float[np.ndarray, "*batch 3"], b: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch"]:
    """Return the angles [deg] between vectors of any length.

    Kahan's form: unlike the arc cosine of the scalar product it loses no digits near 0 and 180 degrees.
    """
    length_a, length_b = norms(a)[..., None], norms(b)[..., None]
    scaled_a, scaled_b = a * length_b, b * length_a
    return np.degrees(2.0 * np.arctan2(norms(scaled_a - scaled_b), norms(scaled_a + scaled_b)))


def norms(vectors: Float[np.ndarray, "*batch K"]) -> Float[np.ndarray, "*batch"]:
    """Return the lengths of vectors along the last axis, in their unit."""
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
