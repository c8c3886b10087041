"""What is in a robot-motion file, as it is there: nothing is reordered, scaled or turned.

Shapes come from foreign files: they are checked here, with an error for the user, not by annotations.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from hoi_retarget.errors import ReadError
from hoi_retarget.numerics.arrays import describe_frames, frozen

LARGEST = 1e9  # In any unit: larger numbers are damage.
MINIMUM_FRAMES = 3  # A velocity in the middle of a frame takes its two neighbours.


@dataclass(frozen=True)
class Convention:
    """What a format demands of its numbers; None where it leaves a choice."""

    quat_order: Literal["wxyz", "xyzw"] = "wxyz"
    root_order: Literal["pos_quat", "quat_pos"] | None = "pos_quat"
    """Whether a free joint's position or its rotation comes first; None where both are in use."""
    order: Literal["depth_first", "names"] | None = "depth_first"
    """Of joints and bodies: as in the MJCF, as the file's names say, or (None) that or Isaac Lab's."""
    usual_fps: float | None = None
    """The rate that files have which do not state one [1/s]."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """World poses and velocities of bodies; T frames, B bodies."""

    pos: np.ndarray
    """(T, B, 3)"""
    quat: np.ndarray
    """(T, B, 4)"""
    lin_vel: np.ndarray | None = None
    """(T, B, 3)"""
    ang_vel: np.ndarray | None = None
    """(T, B, 3)"""


@dataclass(frozen=True, eq=False)
class ObjectPoses:
    """One object's free joint, in the order in which the format writes the robot's root."""

    name: str
    pose: np.ndarray
    """(T, 7)"""
    lin_vel: np.ndarray | None = None
    """(T, 3)"""
    ang_vel: np.ndarray | None = None
    """(T, 3)"""


@dataclass(frozen=True, eq=False)
class ContactFlags:
    """Who touches when, by whatever names the file has for it."""

    names: tuple[str, ...]
    flags: np.ndarray
    """(T, C)"""


@dataclass(frozen=True, eq=False)
class MotionFile:
    """One robot's motion as a file has it; T frames, n joints.

    Raises `ReadError` when shapes disagree or a number is not finite.
    """

    path: str
    format: str
    convention: Convention
    contents: tuple[str, ...]
    """What the file holds: names, types and shapes."""
    joint_pos: np.ndarray
    """(T, n)"""
    fps: float | None = None
    """As stated; None where the file does not state it [1/s]."""
    root: np.ndarray | None = None
    """(T, 7) The free joint; None where it is the first body."""
    joint_vel: np.ndarray | None = None
    """(T, n)"""
    root_vel: np.ndarray | None = None
    """(T, 6) Linear [m/s], then angular [rad/s]."""
    bodies: Bodies | None = None
    joint_names: tuple[str, ...] | None = None
    body_names: tuple[str, ...] | None = None
    objects: tuple[ObjectPoses, ...] = ()
    contacts: ContactFlags | None = None

    def __post_init__(self) -> None:
        if self.fps is not None and not (np.isfinite(self.fps) and 0 < self.fps < 1e5):
            raise ReadError(f"{self.path}: its rate is {self.fps:g} frames a second; it must be positive.")
        for name, array, tail in self._arrays():
            self._check(name, array, tail)
        self._check_names("joint", self.joint_names, self.joint_pos.shape[1])
        if self.bodies is not None:
            self._check_names("body", self.body_names, self.bodies.pos.shape[1])
        if self.frames < MINIMUM_FRAMES:
            raise ReadError(f"{self.path}: {self.frames} frames; at least {MINIMUM_FRAMES} are needed.")
        for owner, name in self._owners():
            value = getattr(owner, name)
            if value is not None:
                object.__setattr__(owner, name, frozen(value))

    def _arrays(self) -> list[tuple[str, np.ndarray | None, tuple[int | None, ...]]]:
        """Return every array with its name and its shape after the frames; None stands for any size."""
        joints = self.joint_pos.shape[1] if self.joint_pos.ndim == 2 else None
        arrays: list[tuple[str, np.ndarray | None, tuple[int | None, ...]]] = [
            ("the joint angles", self.joint_pos, (joints,)),
            ("the root's pose", self.root, (7,)),
            ("the joint velocities", self.joint_vel, (joints,)),
            ("the root's velocity", self.root_vel, (6,)),
        ]
        if self.bodies is not None:
            count = self.bodies.pos.shape[1] if self.bodies.pos.ndim == 3 else None
            arrays += [
                ("the bodies' positions", self.bodies.pos, (count, 3)),
                ("the bodies' rotations", self.bodies.quat, (count, 4)),
                ("the bodies' linear velocities", self.bodies.lin_vel, (count, 3)),
                ("the bodies' angular velocities", self.bodies.ang_vel, (count, 3)),
            ]
        for item in self.objects:
            arrays += [
                (f"the pose of {item.name}", item.pose, (7,)),
                (f"the linear velocity of {item.name}", item.lin_vel, (3,)),
                (f"the angular velocity of {item.name}", item.ang_vel, (3,)),
            ]
        if self.contacts is not None:
            arrays.append(("the contact flags", self.contacts.flags, (len(self.contacts.names),)))
        return arrays

    def _owners(self) -> list[tuple[object, str]]:
        owners: list[tuple[object, str]] = [(self, name) for name in ("joint_pos", "root", "joint_vel", "root_vel")]
        if self.bodies is not None:
            owners += [(self.bodies, name) for name in ("pos", "quat", "lin_vel", "ang_vel")]
        return owners + [(item, name) for item in self.objects for name in ("pose", "lin_vel", "ang_vel")]

    def _check(self, name: str, array: np.ndarray | None, tail: tuple[int | None, ...]) -> None:
        if array is None:
            return
        frames = len(self.joint_pos) if self.joint_pos.ndim else 0
        expected = (frames, *tail)
        if array.ndim != len(expected) or any(
            b is not None and a != b for a, b in zip(array.shape, expected, strict=True)
        ):
            wanted = ", ".join("any" if size is None else str(size) for size in expected)
            raise ReadError(f"{self.path}: {name} have shape {array.shape}, expected ({wanted}): a {self.format} file.")
        if array.size:
            table = array.reshape(frames, -1)
            self._check_values(name, ~np.isfinite(table), "not finite")
            self._check_values(name, np.abs(table) > LARGEST, f"beyond {LARGEST:g}")

    def _check_values(self, name: str, bad: np.ndarray, what: str) -> None:
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
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.joint_pos)
