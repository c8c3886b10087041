"""The result file: `<name>.npz` without pickled objects.

Body poses are derived from `qpos` by forward kinematics and never stored.
"""

import io
import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from hoi_retarget.errors import ClipError, ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.atomic import write_atomically
from hoi_retarget.motion.motion import ARRAYS, Motion

SCHEMA = 1
_KINDS = {"contact_flags": "b", "stance_flags": "b", "contact_object": "i"}
_NAMES = ("joint_names", "object_names", "contact_links")
_ENTRIES = {"contact_points": "contact_targets"}  # Entries of the file that are not named as the motion's fields are.


def save(motion: Motion, path: Path) -> None:
    """Write a motion atomically: to a temporary file beside `path`, then renamed over it.

    Raises `WriteError`; a previous file at `path` is then intact.
    """
    write_atomically(path, encode(motion))


def encode(motion: Motion) -> bytes:
    """Return the content of a motion's file: the same bytes for the same motion."""
    values: dict[str, Any] = {_entry(name): getattr(motion, name) for name in ARRAYS}
    values |= {name: np.array(getattr(motion, name), dtype=np.str_) for name in _NAMES}
    values |= {
        "schema": np.int64(SCHEMA),
        "robot": np.str_(motion.robot),
        "fps": np.float64(motion.fps),
        "first_source_frame": np.int64(motion.first_source_frame),
        "human_height": np.float64(motion.human_height),
        "report": np.str_(json.dumps(motion.report, allow_nan=False)),
    }
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **values)
    return buffer.getvalue()


def load(path: Path) -> Motion:
    """Read a motion file.

    Raises `ReadError` when the file is missing, damaged, of another schema, or not a motion file.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise ReadError(f"{path}: there is no such file. Check the path.") from error
    except IsADirectoryError as error:
        raise ReadError(f"{path}: this is a folder. Name the results in it, such as {path}/*.npz.") from error
    except OSError as error:
        raise ReadError(f"{path}: cannot be read ({error.strerror or error}).") from error
    try:
        return _motion(path, _members(path, content))
    except (ClipError, ValueError, RecursionError) as error:
        raise ReadError(f"{path}: the motion file is damaged ({error}). Run the retarget again.") from error


def _members(path: Path, content: bytes) -> dict[str, bytes]:
    try:
        return npz.members(content)
    except ValueError as error:
        raise ReadError(f"{path}: not a readable .npz motion file ({error}). Run the retarget again.") from error


def _motion(path: Path, members: Mapping[str, bytes]) -> Motion:
    if "schema" not in members:
        raise ReadError(f"{path}: no 'schema' entry: not a motion file of hoi-retarget. It holds: {sorted(members)}.")
    schema = int(_scalar("schema", members["schema"], "i"))
    if schema != SCHEMA:
        raise ReadError(f"{path}: schema {schema}; this version reads {SCHEMA}. Run the retarget again.")
    missing = [entry for field in fields(Motion) if (entry := _entry(field.name)) not in members]
    if missing:
        raise ReadError(f"{path}: the motion file lacks {', '.join(missing)}. Run the retarget again.")
    report = json.loads(str(_scalar("report", members["report"], "U")))
    if not isinstance(report, dict):
        raise ValueError("report is no JSON object")
    values: dict[str, Any] = {name: _array(name, members) for name in ARRAYS}
    values |= {name: tuple(npz.array(name, members[name], "U").ravel().tolist()) for name in _NAMES}
    return Motion(
        robot=str(_scalar("robot", members["robot"], "U")),
        fps=float(_scalar("fps", members["fps"], "if")),
        first_source_frame=int(_scalar("first_source_frame", members["first_source_frame"], "i")),
        human_height=float(_scalar("human_height", members["human_height"], "if")),
        report=report,
        **values,
    )


def _entry(field: str) -> str:
    """Return the name in the file of a field of `Motion`."""
    return _ENTRIES.get(field, field)


def _array(field: str, members: Mapping[str, bytes]) -> np.ndarray:
    entry = _entry(field)
    return npz.array(entry, members[entry], _KINDS.get(entry, "f"))


def _scalar(name: str, content: bytes, kinds: str) -> Any:
    return npz.array(name, content, kinds).reshape(()).item()
