"""Robot motions in the files of this and other programs, read as they are there and written as they are to be.

Each format is a file here that owns its order of joints and bodies, its quaternions, units, names and rate.
Adding one is one file and one line in `FORMATS`. What the numbers of a file mean, and whether they are what the
format says, is decided by `hoi_retarget.motion.check`, which knows a robot.
"""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats import (
    asap,
    beyondmimic,
    gmr,
    hdmi,
    holosoma,
    holosoma_qpos,
    mjlab,
    omniretarget,
    own_result,
    sbto,
    unitree_csv,
)
from hoi_retarget.motion.formats.arrays_by_name import ArraysByName
from hoi_retarget.motion.formats.containers import FOLDER, MOTION
from hoi_retarget.motion.formats.format import Format
from hoi_retarget.motion.formats.motion_file import (
    WITHOUT_WRISTS,
    Bodies,
    ContactFlags,
    Convention,
    MotionFile,
    ObjectPoses,
)

__all__ = [
    "FORMATS",
    "WITHOUT_WRISTS",
    "WRITABLE",
    "Bodies",
    "ContactFlags",
    "Convention",
    "Format",
    "MotionFile",
    "ObjectPoses",
    "read",
]

# A file's format is the first that holds its entries: those that ask for more come first.
FORMATS: tuple[Format, ...] = (
    own_result.FORMAT,
    holosoma.FORMAT,
    beyondmimic.FORMAT,
    mjlab.FORMAT,
    omniretarget.FORMAT,
    holosoma_qpos.FORMAT,
    hdmi.FORMAT,
    sbto.FORMAT,
    gmr.FORMAT,
    asap.FORMAT,
    unitree_csv.FORMAT,
)
"""All formats of one motion a file."""
WRITABLE: Mapping[str, Format] = MappingProxyType(
    {format.name: format for format in FORMATS if format.write is not None}
)
"""By name, those to which results are exported."""


def read(path: Path) -> MotionFile:
    """Return what a robot-motion file holds, whatever supported format it has.

    Raises:
        ReadError: The file is missing, damaged, of no known format, or holds numbers that are not finite.
    """
    suffix = path.suffix.lower()
    if path.is_dir():
        path, suffix = path / MOTION, FOLDER
    formats = [format for format in FORMATS if suffix in format.container.suffixes]
    if not formats:
        kinds = "*.npz, *.pkl, *.csv, or a folder with motion.npz and meta.json"
        raise ReadError(f"{path}: no robot motions are read from files of type {path.suffix!r}. Expected {kinds}.")
    values = formats[0].container.read(path)
    if not isinstance(values, Mapping):
        raise ReadError(f"{path}: it holds a {type(values).__name__}, expected a dictionary. {_known()}")
    for format in formats:
        if format.holds(values):
            return _as_file(format, ArraysByName(path, values))
    there = ", ".join(sorted(map(str, values))[:20]) or "nothing"
    raise ReadError(f"{path}: no known robot motion: it holds {there}. {_known()}")


def _as_file(format: Format, arrays: ArraysByName) -> MotionFile:
    fields: dict[str, Any] = {"convention": format.convention, **format.read(arrays)}
    if "fps" not in fields:
        fields["fps"] = arrays.rate()
    return MotionFile(**{"path": str(arrays.path), "contents": arrays.contents(), **fields})


def _known() -> str:
    return f"Formats that are known: {', '.join(format.convention.name for format in FORMATS)}."
