"""The robot side of a clip: what a retarget produced, and its file.

The file is `<name>.npz` without pickled objects; body poses are derived from `qpos` by forward
kinematics and never stored.
"""

import io
import json
import os
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.arrays import frozen
from hoi_retarget.errors import ClipError, ReadError, WriteError

SCHEMA = 1


@dataclass(frozen=True, eq=False)
class Motion:
    """One robot's motion with the objects it moves; T frames, O objects, C contact links, n joints.

    Raises `ClipError` when shapes disagree or a number that must be finite is not.
    """

    robot: str
    fps: float
    joint_names: tuple[str, ...]
    qpos: Float[np.ndarray, "T nq"]
    """Root position [m], root rotation wxyz, joints [rad] in `joint_names` order."""
    ik_qpos: Float[np.ndarray, "T nq"]
    """The same after inverse kinematics alone."""
    object_names: tuple[str, ...]
    object_pos: Float[np.ndarray, "T O 3"]
    object_quat: Float[np.ndarray, "T O 4"]
    object_scale: Float[np.ndarray, "O"]
    """Geometry scale: vertices times this about the object's origin."""
    contact_links: tuple[str, ...]
    contact_flags: Bool[np.ndarray, "T C"]
    contact_object: Int[np.ndarray, "T C"]
    """Index of the touched object, -1 for none."""
    contact_targets: Float[np.ndarray, "T C 3"]
    """Point to touch, in the frame of the scaled object [m]; NaN where inactive."""
    stance_flags: Bool[np.ndarray, "T 2"]
    """Left and right foot on the floor."""
    first_source_frame: int
    """How many leading frames of the source were dropped."""
    human_height: float
    """[m]"""
    report: Mapping[str, Any]
    """Statuses, costs, figures, seconds, configuration, versions, source; plain JSON values."""

    def __post_init__(self) -> None:
        kinds = {"contact_flags": bool, "stance_flags": bool, "contact_object": int}
        for name in _ARRAYS:
            object.__setattr__(self, name, frozen(getattr(self, name), kinds.get(name, float)))
        for name in ("joint_names", "object_names", "contact_links"):
            object.__setattr__(self, name, tuple(str(item) for item in getattr(self, name)))
        frames, n = len(self.qpos), len(self.joint_names)
        objects, links = len(self.object_names), len(self.contact_links)
        expected = {
            "qpos": (frames, 7 + n),
            "ik_qpos": (frames, 7 + n),
            "object_pos": (frames, objects, 3),
            "object_quat": (frames, objects, 4),
            "object_scale": (objects,),
            "contact_flags": (frames, links),
            "contact_object": (frames, links),
            "contact_targets": (frames, links, 3),
            "stance_flags": (frames, 2),
        }
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise ClipError(f"motion: {name} has shape {getattr(self, name).shape}, expected {shape}.")
        for name in ("qpos", "ik_qpos", "object_pos", "object_quat", "object_scale"):
            if not np.isfinite(getattr(self, name)).all():
                raise ClipError(f"motion: {name} holds numbers that are not finite.")

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.qpos)


_ARRAYS = (
    "qpos",
    "ik_qpos",
    "object_pos",
    "object_quat",
    "object_scale",
    "contact_flags",
    "contact_object",
    "contact_targets",
    "stance_flags",
)
_NAMES = ("joint_names", "object_names", "contact_links")


def save(motion: Motion, path: Path) -> None:
    """Write a motion atomically: to a temporary file beside `path`, then renamed over it.

    Raises `WriteError`; a previous file at `path` is then intact.
    """
    values: dict[str, Any] = {name: getattr(motion, name) for name in _ARRAYS}
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
    write_atomically(path, buffer.getvalue())


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` to `path` so that either all of it or the previous file is there.

    Raises `WriteError`.
    """
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
            temporary = Path(file.name)
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
        raise WriteError(f"{path}: cannot be written ({error.strerror or error}). Choose another --out.") from error


def load(path: Path) -> Motion:
    """Read a motion file.

    Raises `ReadError` when the file is missing, damaged, of another schema, or not a motion file.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            values = {name: archive[name] for name in archive.files}
    except FileNotFoundError as error:
        raise ReadError(f"{path}: there is no such file.") from error
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, KeyError) as error:
        raise ReadError(f"{path}: not a readable .npz motion file ({error}). Run the retarget again.") from error
    if "schema" not in values:
        raise ReadError(f"{path}: no 'schema' entry: not a motion file of hoi-retarget. It holds: {sorted(values)}.")
    if int(values["schema"]) != SCHEMA:
        raise ReadError(f"{path}: schema {int(values['schema'])}; this version reads {SCHEMA}. Run the retarget again.")
    missing = [field.name for field in fields(Motion) if field.name not in values]
    if missing:
        raise ReadError(f"{path}: the motion file lacks {', '.join(missing)}. Run the retarget again.")
    try:
        return Motion(
            robot=str(values["robot"]),
            fps=float(values["fps"]),
            first_source_frame=int(values["first_source_frame"]),
            human_height=float(values["human_height"]),
            report=json.loads(str(values["report"])),
            **{name: tuple(values[name].tolist()) for name in _NAMES},
            **{name: values[name] for name in _ARRAYS},
        )
    except (ClipError, ValueError, TypeError) as error:
        raise ReadError(f"{path}: the motion file is damaged ({error}). Run the retarget again.") from error
