"""Readers of robot motions in other programs' formats: what is in a file, as it is there.

One module for each format. What the numbers mean, and whether they are what the format says, is decided by
`hoi_retarget.motion.check`, which knows a robot.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hoi_retarget.errors import ReadError
from hoi_retarget.files.numpy_pickle import parse_pickle
from hoi_retarget.files.reading import read_bytes
from hoi_retarget.motion.formats import asap, gmr, hdmi, holosoma_wbt, qpos_table, result, sbto, tracking, unitree_csv
from hoi_retarget.motion.formats.arrays_by_name import read_npz
from hoi_retarget.motion.formats.motion_file import Bodies, ContactFlags, Convention, MotionFile, ObjectPoses

__all__ = ["FORMATS", "Bodies", "ContactFlags", "Convention", "MotionFile", "ObjectPoses", "read"]

FORMATS = (
    result.FORMAT,
    tracking.BREADTH_FIRST,
    tracking.DEPTH_FIRST,
    holosoma_wbt.FORMAT,
    qpos_table.HOLOSOMA,
    qpos_table.OMNIRETARGET,
    hdmi.FORMAT,
    gmr.FORMAT,
    asap.FORMAT,
    sbto.FORMAT,
    unitree_csv.FORMAT,
)
"""Names of the formats that can be read."""

_Parser = Callable[[Path, Any], MotionFile]
# The first whose keys are all there is taken: those that ask for more come first.
_NPZ: tuple[tuple[frozenset[str], _Parser], ...] = (
    (result.KEYS, result.parse),
    (holosoma_wbt.KEYS, holosoma_wbt.parse),
    (tracking.KEYS, tracking.parse),
    (hdmi.KEYS, hdmi.parse),
    (qpos_table.KEYS, qpos_table.parse),
)
_PICKLES: tuple[tuple[frozenset[str], _Parser], ...] = ((sbto.KEYS, sbto.parse), (gmr.KEYS, gmr.parse))


def read(path: Path) -> MotionFile:
    """Return what a robot-motion file holds, whatever supported format it has.

    Raises:
        ReadError: The file is missing, damaged, of no known format, or holds numbers that are not finite.
    """
    if path.is_dir():
        return hdmi.read_folder(path)
    match path.suffix.lower():
        case ".csv":
            return unitree_csv.read(path)
        case ".npz":
            arrays = read_npz(path)
            return _parser(path, arrays, _NPZ)(path, arrays)
        case ".pkl" | ".pickle" | ".joblib":
            values = parse_pickle(read_bytes(path), path)
            if not isinstance(values, dict):
                raise ReadError(f"{path}: it holds a {type(values).__name__}, expected a dictionary. {_known()}")
            if asap.holds(values):
                return asap.parse(path, values)
            return _parser(path, values, _PICKLES)(path, values)
    kinds = "*.npz, *.pkl, *.csv, or a folder with motion.npz and meta.json"
    raise ReadError(f"{path}: no robot motions are read from files of type {path.suffix!r}. Expected {kinds}.")


def _parser(path: Path, values: Mapping[str, Any], parsers: tuple[tuple[frozenset[str], _Parser], ...]) -> _Parser:
    for keys, parser in parsers:
        if keys <= set(values):
            return parser
    there = ", ".join(sorted(map(str, values))[:20]) or "nothing"
    raise ReadError(f"{path}: no known robot motion: it holds {there}. {_known()}")


def _known() -> str:
    return f"Formats that are known: {', '.join(FORMATS)}."
