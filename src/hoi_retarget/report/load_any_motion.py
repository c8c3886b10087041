"""Loads a motion to be judged from any program's file."""

import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

from hoi_retarget.motion.check import FLOOR, Finding, as_found
from hoi_retarget.motion.formats import own_result, read
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.report import Source
from hoi_retarget.motion.result_file import load, may_be_result
from hoi_retarget.report.motion_from_qpos import motion_from_qpos
from hoi_retarget.robots.model import RobotModel

OWN_FORMAT = own_result.FORMAT.name


# Figures that only a floor tells.
_OF_FLOOR = (
    "stance_float_m",
    "floor_penetration_max_m",
    "link_below_floor_m",
    "base_height_min_share",
    "base_height_max_share",
)


@dataclass(frozen=True, eq=False)
class OpenedMotion:
    """A motion to be judged."""

    motion: Motion
    """As its numbers say, also where they contradict the file's format."""
    format: str
    notes: tuple[str, ...] = ()
    """Assumptions made to read it, a clause each."""
    contradictions: tuple[Finding, ...] = ()
    """What contradicts the file's claims."""
    not_judged: tuple[str, ...] = ()
    """Names of figures that the file does not tell."""


def open_motion(path: Path, robot: RobotModel) -> OpenedMotion:
    """Return the motion in a file.

    Args:
        path: A result, or a motion in another program's format.
        robot: The robot of the latter, which do not say.

    Raises:
        ReadError: The file is missing, damaged, or of no known format.
        ClipError: Its numbers do not tell what the poses are.
    """
    if _is_result(path):
        return OpenedMotion(load(path), OWN_FORMAT)
    file = read(path)
    found = as_found(file, robot)
    notes = []
    if found.fps_assumed:
        notes.append(f"{found.fps:g} frames a second are assumed")
    if found.missing_joints:
        notes.append(f"joints that the file lacks are held still at 0 rad: {', '.join(found.missing_joints)}")
    floor_is_open = any(item.subject == FLOOR and item.level == "unknown" for item in found.findings)
    if floor_is_open:
        notes.append("it may stand on objects: nothing about the floor is judged")
    motion = motion_from_qpos(found.qpos, found.fps, robot, found.objects)
    report = replace(motion.report, source=Source(format=file.format))
    not_judged = _OF_FLOOR if floor_is_open else ()
    return OpenedMotion(replace(motion, report=report), file.format, tuple(notes), found.contradictions, not_judged)


def _is_result(path: Path) -> bool:
    """Return whether a file is a result; a damaged archive counts as one, because reading it tells what is wrong."""
    if not may_be_result(path):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            return {"schema.npy", "contact_targets.npy"} <= set(archive.namelist())
    except (OSError, ValueError, zipfile.BadZipFile):
        return True
