"""What a format gets, what it gives, and what is known of it beside its arrays."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from hoi_retarget.motion.exporters.links import LinkStates, link_states
from hoi_retarget.motion.exporters.trajectory import Trajectory
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots.model import RobotModel


@dataclass(frozen=True, eq=False)
class Take:
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
    quaternions: Literal["wxyz", "xyzw"]
    body_names: tuple[str, ...] = ()
    """In the file's order; empty where it holds no bodies."""
    linear_velocity_of: Literal["link origins", "centres of mass", ""] = ""
    """Of which point of a body; empty where the file holds no body velocities."""
    notes: tuple[str, ...] = ()
    """What a user has to mind, a sentence each."""


@dataclass(frozen=True)
class Format:
    """One format of motion files."""

    name: str
    title: str
    """Who reads it."""
    suffix: str
    """Of the file; empty for a folder."""
    fps: float | None
    """What its readers expect [frames/s]; None for the result's own rate."""
    place_for_object: bool
    """Whether it holds one object's path."""
    contacts_inside: bool
    """Whether the contact arrays are in the file; otherwise they are in one beside it."""
    robots: tuple[str, ...]
    """Robots that its readers know; empty for any."""
    write: Callable[[Take], Written]
