"""The result file: `<name>.npz` without pickled objects.

Body poses are derived from `qpos` by forward kinematics and never stored.
"""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields
from enum import Enum
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

from hoi_retarget.errors import ArgumentError, ClipError, ReadError, RobotError
from hoi_retarget.files import npz
from hoi_retarget.files.atomic import write_atomically
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.motion.motion import ARRAYS, ContactForces, Motion, Stage, check_robot, check_turns
from hoi_retarget.motion.motion_report import Report, Window, windows_from_json
from hoi_retarget.robots import load_robot, user_robots
from hoi_retarget.robots.model import RobotModel

SCHEMA = 2
_SET_ASIDE = ".failed"
_KINDS = {"contact_flags": "b", "stance_flags": "b", "contact_object": "i"}
_NAMES = ("joint_names", "object_names", "contact_links")
_ENTRIES = {"contact_points": "contact_targets"}  # Entries of the file that are not named as the motion's fields are.


def save(motion: Motion, path: Path | str) -> None:
    """Write a motion atomically: to a temporary file beside `path`, then renamed over it.

    Raises `WriteError`; a previous file at `path` is then intact.
    """
    write_atomically(Path(path), encode(motion))


def encode(motion: Motion) -> bytes:
    """Return the content of a motion's file: the same bytes for the same motion."""
    *earlier, last = motion.stages
    stages = {stage.name: [_plain(window) for window in stage.windows] for stage in motion.stages}
    report = motion.report.as_json() | {"stages": stages}
    values: dict[str, Any] = {"qpos": last.qpos, **{f"{stage.name}_qpos": stage.qpos for stage in earlier}}
    values |= {f"{stage.name}_objects": stage.objects for stage in earlier if stage.objects is not None}
    if last.forces is not None:
        values |= {"contact_forces": last.forces.forces, "contact_force_points": last.forces.points}
        values["force_bodies"] = np.array(last.forces.bodies, dtype=np.str_)
    values |= {_ENTRIES.get(name, name): getattr(motion, name) for name in ARRAYS}
    values |= {name: np.array(getattr(motion, name), dtype=np.str_) for name in _NAMES}
    values |= {
        "stage_names": np.array([stage.name for stage in motion.stages], dtype=np.str_),
        "schema": np.int64(SCHEMA),
        "robot": np.str_(motion.robot),
        "fps": np.float64(motion.fps),
        "first_source_frame": np.int64(motion.first_source_frame),
        "human_height": np.float64(motion.human_height),
        "report": np.str_(json.dumps(report, allow_nan=False, default=_plain)),
    }
    return npz.encode(values)


def _plain(value: Any) -> Any:
    """Return a value of a report as JSON has it."""
    return value.value if isinstance(value, Enum) else asdict(value)


def set_aside(path: Path) -> Path:
    """Return where the failed motion of a result's path is kept: beside it, with an ending that no result has."""
    return path.with_name(f"{path.name}{_SET_ASIDE}")


def may_be_result(path: Path) -> bool:
    """Return whether a file has the ending of a result, or of one that was set aside."""
    return path.name.lower().removesuffix(_SET_ASIDE).endswith(".npz")


def load(path: Path | str) -> Motion:
    """Read a motion file.

    This is the one place that doubts what is in it: what it returns is a motion of a robot that there is.

    Raises `ReadError` when the file is missing, damaged, of another schema, of no known robot, or not a motion file.
    """
    path = Path(path)
    content = read_bytes(path)
    try:
        members = npz.members(content)
    except ValueError as error:
        raise ReadError(f"{path}: not a readable .npz motion file ({error}). Run the retarget again.") from error
    _check_entries(path, members)
    try:
        motion = _motion(members)
        model = _robot_of(motion)
        check_robot(motion, model)
        check_turns(motion, model)
    except ArgumentError as error:
        raise ReadError(f"{path}: the motion is of a robot that is not known here. {error}") from error
    except (ClipError, ReadError, RobotError, ValueError, RecursionError) as error:
        raise ReadError(f"{path}: the motion file is damaged ({error}). Run the retarget again.") from error
    return motion


def _robot_of(motion: Motion) -> RobotModel:
    """Return the robot that a motion was made for; raises `ArgumentError` where an added one is gone or another one."""
    digest, added = motion.report.robot_sha256, motion.robot in user_robots.names()
    if not digest or (added and user_robots.load(motion.robot).description_sha256 == digest):
        return load_robot(motion.robot)
    file = motion.report.robot_file
    here = "the robot of that name here was made from another file" if added else "there is none of that name here"
    raise ArgumentError(
        f"It was made with {motion.robot!r}, from {file!a} (SHA-256 {digest}), and {here}. "
        f"Add it again: hoi-retarget robots add {PureWindowsPath(file).name or 'FILE'} --name {motion.robot}"
    )


def _check_entries(path: Path, members: Mapping[str, bytes]) -> None:
    if "schema" not in members:
        raise ReadError(f"{path}: no 'schema' entry: not a motion file of hoi-retarget. It holds: {sorted(members)}.")
    try:
        schema = int(_scalar("schema", members["schema"], "i"))
    except ValueError as error:
        raise ReadError(f"{path}: the motion file is damaged ({error}). Run the retarget again.") from error
    if schema != SCHEMA:
        raise ReadError(f"{path}: schema {schema}; this version reads {SCHEMA}. Run the retarget again.")
    expected = {"qpos", "stage_names", *(_ENTRIES.get(item.name, item.name) for item in fields(Motion))} - {"stages"}
    missing = [name for name in sorted(expected) if name not in members]
    if missing:
        raise ReadError(f"{path}: the motion file lacks {', '.join(missing)}. Run the retarget again.")


def _motion(members: Mapping[str, bytes]) -> Motion:
    report = json.loads(str(_scalar("report", members["report"], "U")), parse_constant=_refuse, parse_float=_finite)
    windows = windows_from_json(report)
    values: dict[str, Any] = {
        name: npz.array(_ENTRIES.get(name, name), members[_ENTRIES.get(name, name)], _KINDS.get(name, "f"))
        for name in ARRAYS
    }
    values |= {name: tuple(npz.array(name, members[name], "U").ravel().tolist()) for name in _NAMES}
    return Motion(
        robot=str(_scalar("robot", members["robot"], "U")),
        fps=float(_scalar("fps", members["fps"], "if")),
        stages=tuple(_stages(members, windows)),
        first_source_frame=int(_scalar("first_source_frame", members["first_source_frame"], "i")),
        human_height=float(_scalar("human_height", members["human_height"], "if")),
        report=Report.from_json(report),
        **values,
    )


def _stages(members: Mapping[str, bytes], windows: Mapping[str, tuple[Window, ...]]) -> Iterator[Stage]:
    names = npz.array("stage_names", members["stage_names"], "U").ravel().tolist()
    for name in names:
        entry = "qpos" if name == names[-1] else f"{name}_qpos"
        if entry not in members:
            raise ReadError(f"it lacks {entry}")
        moved = f"{name}_objects"
        objects = npz.array(moved, members[moved], "f") if moved in members else None
        forces = _forces(members) if name == names[-1] and "contact_forces" in members else None
        yield Stage(name, npz.array(entry, members[entry], "f"), windows.get(name, ()), objects, forces)


def _forces(members: Mapping[str, bytes]) -> ContactForces:
    missing = [name for name in ("force_bodies", "contact_force_points") if name not in members]
    if missing:
        raise ReadError(f"it lacks {', '.join(missing)}")
    bodies = npz.array("force_bodies", members["force_bodies"], "U").ravel().tolist()
    forces, points = (npz.array(name, members[name], "f") for name in ("contact_forces", "contact_force_points"))
    return ContactForces(tuple(bodies), forces, points)


def _refuse(constant: str) -> Any:
    raise ValueError(f"its report holds {constant}, which is no number")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"its report holds {text[:20]}, which no number of its kind is")
    return number


def _scalar(name: str, content: bytes, kinds: str) -> Any:
    return npz.array(name, content, kinds).reshape(()).item()
