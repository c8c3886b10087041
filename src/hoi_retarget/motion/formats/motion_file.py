"""The content of a robot-motion file as it is there: nothing is reordered, scaled or turned.

Shapes come from foreign files: they are checked here, with an error for the user, not by annotations.
"""

from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.numerics.arrays import describe_frames, frozen

LARGEST = 1e9  # In any unit: larger numbers are damage.
MIN_COLUMNS = 8  # Of a table: a free joint and a hinge.
MINIMUM_FRAMES = 3  # A velocity in the middle of a frame takes its two neighbours.
WITHOUT_WRISTS = "all but the wrists, as GMT, TWIST and ASAP have them"


@dataclass(frozen=True)
class Convention:
    """The demands of a format on its numbers; None where it leaves a choice."""

    name: str  # Of the format.
    quat_order: Literal["wxyz", "xyzw"] | None = "wxyz"
    root_order: Literal["pos_quat", "quat_pos"] = "pos_quat"
    """Whether a free joint's position or its rotation comes first."""
    order: Literal["depth_first", "breadth_first", "names"] | None = "depth_first"
    """Of joints and bodies: the MJCF's, Isaac Lab's, that of the file's names, or (None) one of the first two."""
    usual_fps: float | None = None  # The rate that files have which do not state one [1/s].
    usual_joints: str = ""
    """Which joints files without names have where they have fewer than the robot, such as `WITHOUT_WRISTS`."""

    def split(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and rotations of free joints (..., 7)."""
        return (pose[..., 4:], pose[..., :4]) if self.root_order == "quat_pos" else (pose[..., :3], pose[..., 3:])


@dataclass(frozen=True)
class Stored:
    """An array's meaning, and its shape after the frames: a letter stands for any size, the same one each time."""

    meaning: str
    shape: tuple[int | str, ...]


def arrays_of(owner: Any) -> dict[str, np.ndarray]:
    """Return the arrays that a file's motion, or a part of it, has, by the names of its fields."""
    return {name: value for name, value in vars(owner).items() if isinstance(value, np.ndarray)}


@dataclass(frozen=True, eq=False)
class Bodies:
    """World poses and velocities of bodies; T frames, B bodies."""

    pos: Annotated[np.ndarray, Stored("the bodies' positions", ("B", 3))]
    quat: Annotated[np.ndarray, Stored("the bodies' rotations", ("B", 4))]
    lin_vel: Annotated[np.ndarray | None, Stored("the bodies' linear velocities", ("B", 3))] = None
    ang_vel: Annotated[np.ndarray | None, Stored("the bodies' angular velocities", ("B", 3))] = None

    def only(self, columns: list[int]) -> "Bodies":
        """Return some of them, in this order."""
        return Bodies(**{name: array[:, columns] for name, array in arrays_of(self).items()})


@dataclass(frozen=True, eq=False)
class ObjectPoses:
    """One object's free joint, in the order in which the format writes the robot's root."""

    name: str
    pose: Annotated[np.ndarray, Stored("the pose of {name}", (7,))]
    lin_vel: Annotated[np.ndarray | None, Stored("the linear velocity of {name}", (3,))] = None
    ang_vel: Annotated[np.ndarray | None, Stored("the angular velocity of {name}", (3,))] = None

    def as_body(self, convention: Convention) -> Bodies:
        """Return it as one body."""
        lin_vel, ang_vel = (None if values is None else values[:, None] for values in (self.lin_vel, self.ang_vel))
        return Bodies(*convention.split(self.pose[:, None]), lin_vel, ang_vel)


@dataclass(frozen=True, eq=False)
class ContactFlags:
    """Flags of touch over time, by the file's own names."""

    names: tuple[str, ...]
    flags: Annotated[np.ndarray, Stored("the contact flags", ("C",))]


@dataclass(frozen=True, eq=False)
class MotionFile:
    """One robot's motion as a file has it; T frames, n joints.

    Raises `ReadError` when shapes disagree or a number is not finite.
    """

    path: str
    convention: Convention
    contents: tuple[str, ...]  # What the file holds: names, types and shapes.
    joint_pos: Annotated[np.ndarray, Stored("the joint angles", ("n",))]
    fps: float | None = None  # As stated; None where the file does not state it [1/s].
    root: Annotated[np.ndarray | None, Stored("the root's pose", (7,))] = None
    """The free joint; None where it is the first body."""
    joint_vel: Annotated[np.ndarray | None, Stored("the joint velocities", ("n",))] = None
    root_vel: Annotated[np.ndarray | None, Stored("the root's velocity", (6,))] = None
    """Linear [m/s], then angular [rad/s]."""
    bodies: Bodies | None = None
    joint_names: tuple[str, ...] | None = None
    body_names: tuple[str, ...] | None = None
    objects: tuple[ObjectPoses, ...] = ()
    contacts: ContactFlags | None = None

    def __post_init__(self) -> None:
        if self.fps is not None and not (np.isfinite(self.fps) and 0 < self.fps < 1e5):
            raise ReadError(f"{self.path}: its rate is {self.fps:g} frames a second; it must be positive.")
        for owner in (self, self.bodies, *self.objects, self.contacts):
            if owner is not None:
                self._check_arrays(owner)
        self._check_names("joint", self.joint_names, self.joint_pos.shape[1])
        if self.bodies is not None:
            self._check_names("body", self.body_names, self.bodies.pos.shape[1])
        if self.frames < MINIMUM_FRAMES:
            raise ReadError(f"{self.path}: {self.frames} frames; at least {MINIMUM_FRAMES} are needed.")

    def _check_arrays(self, owner: Any) -> None:
        """Check the arrays of this or of a part of it, and make them read-only."""
        frames = len(self.joint_pos) if self.joint_pos.ndim else 0
        sizes: dict[str, int | str] = {}
        for field in fields(owner):
            stored = next(iter(getattr(field.type, "__metadata__", ())), None)
            array = getattr(owner, field.name)
            if stored is None or array is None:
                continue
            name = stored.meaning.format(**vars(owner))
            have = array.shape[1:] if array.ndim == 1 + len(stored.shape) else stored.shape
            expected = (
                frames,
                *(
                    sizes.setdefault(size, there) if isinstance(size, str) else size
                    for size, there in zip(stored.shape, have, strict=True)
                ),
            )
            if array.shape != expected:
                sizes_expected = ", ".join("any" if isinstance(size, str) else str(size) for size in expected)
                raise ReadError(
                    f"{self.path}: {name} have shape {array.shape}, expected ({sizes_expected}): a {self.format} file."
                )
            self._check_values(name, array)
            object.__setattr__(owner, field.name, frozen(array, array.dtype))

    def _check_values(self, name: str, array: np.ndarray) -> None:
        table = array.reshape(len(array), -1) if array.size else np.zeros((0, 0))
        for bad, what in ((~np.isfinite(table), "not finite"), (np.abs(table) > LARGEST, f"beyond {LARGEST:g}")):
            if bad.any():
                frames = describe_frames(np.flatnonzero(bad.any(axis=1)))
                raise ReadError(f"{self.path}: {name} are {what} in {frames}. Make the file again.")

    def _check_names(self, kind: str, names: tuple[str, ...] | None, count: int) -> None:
        if names is None:
            return
        if len(names) != count:
            raise ReadError(f"{self.path}: {len(names)} {kind} names for {count} of them. Make the file again.")
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ReadError(f"{self.path}: the {kind} names hold {', '.join(twice)} twice. Make the file again.")

    @property
    def format(self) -> str:
        """Name of the format."""
        return self.convention.name

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.joint_pos)
