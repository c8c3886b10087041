"""The facts of a motion format: what tells its files, how they are read, and how they are written."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from hoi_retarget.motion.formats.arrays_by_name import ArraysByName
from hoi_retarget.motion.formats.motion_file import Convention, MotionFile
from hoi_retarget.motion.links import LinkStates, link_states
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.trajectory import Trajectory
from hoi_retarget.robots.model import RobotModel

VelocityPoint = Literal["link origins", "centres of mass", ""]


@dataclass(frozen=True, eq=False)
class ResampledMotion:
    """One result at the rate of a format."""

    motion: Motion
    model: RobotModel
    trajectory: Trajectory
    contacts: Mapping[str, np.ndarray]
    """As `contact_arrays` returns them."""
    object: int | None
    """Index of the object that goes into a format's one place for it; None where there is no object."""

    @cached_property
    def links(self) -> LinkStates:
        """Poses and velocities of all bodies."""
        return link_states(self.model, self.trajectory)

    @property
    def object_name(self) -> str:
        """Name of the object in the format's one place for it, which must be filled."""
        assert self.object is not None
        return self.motion.object_names[self.object]


@dataclass(frozen=True)
class Written:
    """A format's files, and what their readers have to know."""

    files: Mapping[str, bytes]
    """Content by what follows the export's name: `.npz`, or `/motion.npz` for a folder."""
    joint_names: tuple[str, ...]
    """In the file's order."""
    body_names: tuple[str, ...] = ()
    """In the file's order; empty where it holds no bodies."""
    notes: tuple[str, ...] = ()
    """What a user has to mind, a sentence each."""


@dataclass(frozen=True)
class Format:
    """One format of motion files; with `write`, results are exported to it."""

    name: str
    """As `--to` has it; checks of files call it by its convention's name."""
    convention: Convention
    holds: Callable[[Mapping[str, Any]], bool]
    """Whether a file's entries are those of the format."""
    read: Callable[[ArraysByName], MotionFile]
    suffix: str = ".npz"
    """Of the file; empty for a folder."""
    write: Callable[[ResampledMotion], Written] | None = None
    title: str = ""
    """Who reads it."""
    fps: float | None = None
    """What its readers expect [frames/s]; None for the result's own rate."""
    place_for_object: bool = False
    """Whether it holds one object's path."""
    contacts_inside: bool = False
    """Whether the contact arrays are in the file; otherwise they are in one beside it."""
    robots: tuple[str, ...] = ()
    """Robots that its readers know; empty for any."""
    linear_velocity_of: VelocityPoint = ""
    """Of which point of a body; empty where the file holds no body velocities."""
