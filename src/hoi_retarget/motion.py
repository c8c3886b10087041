"""The robot side of a clip: what a retarget produced, and its file.

The file is `<name>.npz` without pickled objects; body poses are derived from `qpos` by forward
kinematics and never stored.
"""

import errno
import io
import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget import npz
from hoi_retarget.arrays import check_shape, frozen
from hoi_retarget.errors import ClipError, ReadError, WriteError

SCHEMA = 1
UNIT_TOLERANCE = 1e-3  # Of a quaternion's length: more is damage, not rounding.


@dataclass(frozen=True, eq=False)
class Motion:
    """One robot's motion with the objects it moves; T frames, O objects, C contact links, n joints.

    Raises `ClipError` when shapes disagree, a number that must be finite is not, or a rotation is
    no unit quaternion.
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
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise ClipError(f"motion: the rate is {self.fps} frames a second; it must be positive.")
        self._check_shapes()
        self._check_values()

    def _check_shapes(self) -> None:
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
            check_shape("motion", name, getattr(self, name), shape)
        if frames == 0:
            raise ClipError("motion: there are no frames in it.")

    def _check_values(self) -> None:
        for name in ("qpos", "ik_qpos", "object_pos", "object_quat", "object_scale"):
            if not np.isfinite(getattr(self, name)).all():
                raise ClipError(f"motion: {name} holds numbers that are not finite.")
        rotations = {"qpos": self.qpos[:, 3:7], "ik_qpos": self.ik_qpos[:, 3:7], "object_quat": self.object_quat}
        for name, quats in rotations.items():
            lengths = np.linalg.norm(np.clip(quats, -2.0, 2.0), axis=-1)  # Damage may hold any number.
            if (np.abs(lengths - 1.0) > UNIT_TOLERANCE).any():
                raise ClipError(f"motion: {name} holds rotations that are not unit quaternions.")
        if ((self.contact_object < -1) | (self.contact_object >= len(self.object_names))).any():
            raise ClipError(f"motion: contact_object names an object beyond its {len(self.object_names)}.")

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.qpos)

    @property
    def person(self) -> int:
        """Which of the clip's people it follows, by its report: the first, where that does not say."""
        person = self.report.get("person")
        return person if isinstance(person, int) else 0


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
_KINDS = {"contact_flags": "b", "stance_flags": "b", "contact_object": "i"}
_NAMES = ("joint_names", "object_names", "contact_links")


def save(motion: Motion, path: Path) -> None:
    """Write a motion atomically: to a temporary file beside `path`, then renamed over it.

    Raises `WriteError`; a previous file at `path` is then intact.
    """
    write_atomically(path, encode(motion))


def encode(motion: Motion) -> bytes:
    """Return the content of a motion's file: the same bytes for the same motion."""
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
    return buffer.getvalue()


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` to `path` so that either all of it or the previous file is there.

    Raises `WriteError`.
    """
    write_together({path: content})


def write_together(contents: Mapping[Path, bytes]) -> None:
    """Write several files so that either all of them or the previous ones are there.

    All are written beside their places before any is renamed over its own. Raises `WriteError`.
    """
    temporaries: dict[Path, Path] = {}
    path = Path()
    try:
        for path, content in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
                temporaries[path] = Path(file.name)
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            temporaries[path].chmod(0o644)
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        for path, temporary in temporaries.items():
            temporary.replace(path)
    except OSError as error:
        for temporary in temporaries.values():
            temporary.unlink(missing_ok=True)
        raise WriteError(f"{path}: cannot be written ({error.strerror or error}). Choose another --out.") from error


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
    missing = [field.name for field in fields(Motion) if field.name not in members]
    if missing:
        raise ReadError(f"{path}: the motion file lacks {', '.join(missing)}. Run the retarget again.")
    report = json.loads(str(_scalar("report", members["report"], "U")))
    if not isinstance(report, dict):
        raise ValueError("report is no JSON object")
    values: dict[str, Any] = {name: npz.array(name, members[name], _KINDS.get(name, "f")) for name in _ARRAYS}
    values |= {name: tuple(npz.array(name, members[name], "U").ravel().tolist()) for name in _NAMES}
    return Motion(
        robot=str(_scalar("robot", members["robot"], "U")),
        fps=float(_scalar("fps", members["fps"], "if")),
        first_source_frame=int(_scalar("first_source_frame", members["first_source_frame"], "i")),
        human_height=float(_scalar("human_height", members["human_height"], "if")),
        report=report,
        **values,
    )


def _scalar(name: str, content: bytes, kinds: str) -> Any:
    return npz.array(name, content, kinds).reshape(()).item()
