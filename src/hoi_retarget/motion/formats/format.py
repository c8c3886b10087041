"""The facts of a motion format: the marks of its files, its reader and its writer."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from hoi_retarget.motion.formats.containers import FOLDER, NPZ, ArraysByName, Container
from hoi_retarget.motion.formats.motion_file import Convention
from hoi_retarget.motion.resample import ResampledMotion

VelocityPoint = Literal["link origins", "centres of mass", ""]


@dataclass(frozen=True)
class Written:
    """A motion as a format has it, with notes for its readers."""

    values: Mapping[str, Any]  # Arrays and others by name; without contacts, which all formats have alike.
    joint_names: tuple[str, ...] = ()  # In the file's order; empty where it is the robot's.
    body_names: tuple[str, ...] = ()  # In the file's order; empty where it holds no bodies.
    notes: tuple[str, ...] = ()  # Warnings for its users, a sentence each.


@dataclass(frozen=True)
class Format:
    """One format of motion files; with `write`, results are exported to it."""

    name: str  # As `--to` has it; checks of files call it by its convention's name.
    convention: Convention
    holds: Callable[[Mapping[str, Any]], bool]  # Whether a file's entries are those of the format.
    read: Callable[[ArraysByName], dict[str, Any]]
    """Returns fields of `MotionFile`: all that differ from the defaults, the stated rate, and the convention."""
    container: Container = NPZ
    write: Callable[[ResampledMotion], Written] | None = None
    title: str = ""  # Who reads it.
    fps: float | None = None  # The rate that its readers expect [frames/s]; None for the result's own.
    place_for_object: bool = False  # Whether it holds one object's path.
    contacts_inside: bool = False  # Whether the contact arrays are in the file; otherwise they are in one beside it.
    linear_velocity_of: VelocityPoint = ""  # Of which point of a body; empty where the file holds no body velocities.

    @property
    def suffix(self) -> str:
        """Ending of the files that are written; empty for a folder."""
        return self.container.suffixes[0].removesuffix(FOLDER)
