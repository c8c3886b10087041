"""Robot motions in the files of this and other programs, read unconverted and written by their conventions.

Each format is a file here that owns its order of joints and bodies, its quaternions, units, names and rate.
Adding one is one file, its import and a line in `FORMATS`. What the numbers of a file mean, and whether they are what
the format says, is decided by `hoi_retarget.motion.check`, which knows a robot.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from hoi_retarget.errors import ReadError
from hoi_retarget.motion.formats import asap, csv, gmr, hdmi, holosoma, isaac_lab, own_result, protomotions, sonic
from hoi_retarget.motion.formats.containers import ArraysByName
from hoi_retarget.motion.formats.format import Format as Format
from hoi_retarget.motion.formats.motion_file import WITHOUT_WRISTS as WITHOUT_WRISTS
from hoi_retarget.motion.formats.motion_file import Bodies as Bodies
from hoi_retarget.motion.formats.motion_file import ContactFlags as ContactFlags
from hoi_retarget.motion.formats.motion_file import Convention as Convention
from hoi_retarget.motion.formats.motion_file import MotionFile as MotionFile
from hoi_retarget.motion.formats.motion_file import ObjectPoses as ObjectPoses

# A file's format is the first that holds its entries: those that ask for more come first.
FORMATS: tuple[Format, ...] = (
    own_result.FORMAT,
    holosoma.HOLOSOMA,
    isaac_lab.BEYONDMIMIC,
    isaac_lab.MJLAB,
    holosoma.OMNIRETARGET,
    holosoma.HOLOSOMA_QPOS,
    hdmi.FORMAT,
    gmr.GMR_NPZ,
    gmr.SBTO,
    gmr.GMR,
    asap.FORMAT,
    protomotions.FORMAT,
    csv.UNITREE_CSV,
    csv.SEED_CSV,
    csv.NAMED_CSV,
    sonic.FORMAT,
)
"""All formats of one motion a file."""
WRITABLE: Mapping[str, Format] = MappingProxyType(
    {format.name: format for format in FORMATS if format.write is not None}
)
"""By name, those to which results are exported."""

_KINDS = "*.npz, *.pkl, *.csv, *.motion, or a folder with motion.npz and meta.json, or with joint_pos.csv"
"""Readable files, in words."""


def read(path: Path) -> MotionFile:
    """Return the content of a robot-motion file of any supported format.

    Raises `ReadError` where the file is missing, damaged, of no known format, or holds numbers that are not finite.
    """
    if path.is_dir():
        return _read_folder(path)
    formats = [format for format in FORMATS if path.suffix.lower() in format.container.suffixes]
    if not formats:
        raise ReadError(f"{path}: no robot motions are read from files of type {path.suffix!r}. Expected {_KINDS}.")
    return _read(path, formats)


def _read_folder(folder: Path) -> MotionFile:
    formats = folder_formats(folder)
    if formats:
        return _read(folder / formats[0].container.inside, formats)
    motions = sorted(path for path in folder.iterdir() if _may_be_motion(path))
    if len(motions) == 1:
        return read(motions[0])
    if not motions:
        raise ReadError(f"{folder}: there is no motion in this folder. Expected {_KINDS}.")
    names = ", ".join(path.name for path in motions[:5])
    raise ReadError(
        f"{folder}: there are {len(motions)} motions in this folder ({names}{', ...' if len(motions) > 5 else ''}). "
        "Name one of them."
    )


def _may_be_motion(path: Path) -> bool:
    if path.is_file():
        return any(path.suffix.lower() in format.container.suffixes for format in FORMATS)
    return bool(folder_formats(path))


def folder_formats(folder: Path) -> list[Format]:
    """Return the formats of which a folder is one motion; empty where it is none."""
    insides = [(format.container.inside, format) for format in FORMATS]
    return [format for inside, format in insides if inside and (folder / inside).is_file()]


def _read(path: Path, formats: Sequence[Format]) -> MotionFile:
    values = formats[0].container.read(path)
    if not isinstance(values, Mapping):
        raise ReadError(f"{path}: it holds a {type(values).__name__}, expected a dictionary. {_known()}")
    for format in formats:
        if format.holds(values):
            arrays = ArraysByName(path, values)
            fields = {"convention": format.convention, **format.read(arrays)}
            rate = {} if "fps" in fields else {"fps": arrays.rate()}
            return MotionFile(**{"path": str(path), "contents": arrays.contents(), **rate, **fields})
    there = ", ".join(sorted(map(str, values))[:20]) or "nothing"
    raise ReadError(f"{path}: no known robot motion: it holds {there}. {_known()}")


def _known() -> str:
    return f"Formats that are known: {', '.join(format.convention.name for format in FORMATS)}."
