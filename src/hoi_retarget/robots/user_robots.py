"""Robots of the user: one folder each with an MJCF, a specification, a skin and the findings, all data."""

import hashlib
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Container
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from hoi_retarget.errors import ArgumentError, RobotError, WriteError
from hoi_retarget.files.atomic import EARLIER, write_atomically, writing
from hoi_retarget.robots.adding.findings import Hints, Record
from hoi_retarget.robots.spec import FINGER_SITES, SITES, TRUNK, RobotSpec, ik_table

FOLDER_VARIABLE = "HOI_RETARGET_ROBOTS"  # Environment variable with another folder for them.
SUFFIXES = (".urdf", ".xml", ".mjcf")  # Of manufacturers' files.
PAGE = "robot.html"  # Of the page in a robot's folder.
_MJCF, _SPEC, _SKIN, _RECORD = "robot.xml", "robot.json", "skin.npz", "added.json"
_NAME = re.compile(r"[a-z0-9][a-z0-9_.-]{0,63}")
_MAX_BYTES = 64 << 20
_MAX_SAVE_S = 600.0  # Folders of one that is still going on are younger than this.
_NO_RECORD = Record()


def folder() -> Path:
    """Return the folder of added robots: the platform's for a user's data, or that of the environment."""
    if named := os.environ.get(FOLDER_VARIABLE):
        return Path(named)
    home = Path(os.path.expanduser("~"))  # noqa: PTH111  # unlike Path.home, never fails
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = home / "Library" / "Application Support"
    else:
        base = Path(os.environ.get("XDG_DATA_HOME") or home / ".local" / "share")
    return base / "hoi-retarget" / "robots"


def names() -> tuple[str, ...]:
    """Return the names of the robots there are, sorted."""
    try:
        _clear_up()
        found = sorted(path.name for path in folder().iterdir() if (path / _SPEC).is_file())
    except OSError:
        return ()
    return tuple(name for name in found if _NAME.fullmatch(name))


def _clear_up() -> None:
    """Give robots back that a killed `save` had moved aside, and remove what it left; raises `OSError`."""
    for left in folder().glob(".*"):
        name = left.name[1:].removesuffix(EARLIER).rpartition(".")[0]
        if not left.is_dir() or not _NAME.fullmatch(name):
            continue
        if left.name.endswith(EARLIER) and not (folder() / name).exists():
            with suppress(OSError):
                left.rename(folder() / name)
        elif time.time() - left.stat().st_ctime > _MAX_SAVE_S:
            shutil.rmtree(left, ignore_errors=True)


def check_name(name: str) -> None:
    """Raise `ArgumentError` unless a robot can be called so."""
    if not _NAME.fullmatch(name):
        raise ArgumentError(f"{name!r} is no name for a robot: small letters, digits, '_', '-' and '.', 64 at most.")


def load(name: str) -> RobotSpec:
    """Return an added robot; raises `RobotError` when its files are damaged."""
    own = folder() / name
    try:
        content = (own / _SPEC).read_bytes()
        if len(content) > _MAX_BYTES:
            raise ValueError("it is too large")
        spec = msgspec.json.decode(content, type=RobotSpec, dec_hook=_decoded)
        known = {(row.site, row.human_joint) for row in ik_table(TRUNK)}
        rows = {(row.site, row.human_joint) for row in spec.ik}
        unknown = sorted(
            {*spec.part_sites.values(), *spec.dropped_rotations, *spec.fingers.values()} - {*SITES, *FINGER_SITES}
        )
        if unknown or not rows <= known:
            raise ValueError(f"it names sites that there are not: {', '.join([*unknown, *map(str, rows - known)])}")
    except (OSError, ValueError, msgspec.MsgspecError, RecursionError) as error:
        raise RobotError(
            f"{own}: the added robot is damaged ({error}). Add it again: robots add FILE --name {name}. "
            f"Or: robots remove {name}"
        ) from error
    # Its name and its paths follow from its folder alone.
    skin = own / _SKIN
    return replace(spec, name=name, mjcf=own / _MJCF, skin=skin if skin.is_file() else None)


def store_skin(spec: RobotSpec, content: bytes) -> None:
    """Store the skin of an added robot, which takes half a minute to compute, beside it, where that is possible."""
    own = spec.mjcf.parent
    if own == folder() / spec.name:
        with suppress(WriteError):
            write_atomically(own / _SKIN, content)


def record_of(name: str) -> Record:
    """Return the findings and trials of an added robot; none of a robot of this package."""
    try:
        return msgspec.json.decode((folder() / name / _RECORD).read_bytes(), type=Record)
    except (OSError, msgspec.MsgspecError):
        return _NO_RECORD


def save(spec: RobotSpec, mjcf: str, record: Record = _NO_RECORD) -> Path:
    """Write all of a robot or nothing of it, in place of one of its name; return its folder. Raises `WriteError`."""
    own = folder() / spec.name
    with writing(own):
        own.parent.mkdir(parents=True, exist_ok=True)
        new = Path(tempfile.mkdtemp(dir=own.parent, prefix=f".{spec.name}."))
        try:
            write_atomically(new / _MJCF, mjcf.encode())
            write_atomically(new / _SPEC, msgspec.json.format(msgspec.json.encode(spec, enc_hook=str), indent=1))
            write_atomically(new / _RECORD, msgspec.json.format(msgspec.json.encode(record), indent=1))
            new.chmod(0o755)
            old = new.with_name(new.name + EARLIER)
            if own.exists():
                own.rename(old)
            try:
                new.rename(own)
            except OSError:
                if not own.exists():
                    raise
                # Another process has one of that name by now, perhaps the one just moved aside, given back.
                own.rename(old)
                new.rename(own)
            shutil.rmtree(old, ignore_errors=True)
        finally:
            shutil.rmtree(new, ignore_errors=True)
    return own


def of_file(path: Path, taken: Container[str] = ()) -> RobotSpec:
    """Return the robot made of a manufacturer's file; made now, under the file's name, where there is none.

    No added robot gets a name in `taken`. Raises `RobotError`, as `build_robot` does, and `WriteError`.
    """
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise RobotError(f"{path}: cannot be read ({error.strerror or error}).") from error
    for name in names():
        with suppress(RobotError):
            spec = load(name)
            if spec.description_sha256 == digest:
                return spec
    name = name_of(path)
    if name in taken or name in names():
        name = f"{name[:50]}_{digest[:8]}"
    from hoi_retarget.robots.adding.build import build_robot  # noqa: PLC0415  # trimesh, for robots that are new

    built = build_robot(path, name, Hints())
    save(built.spec, built.mjcf, Record(built.findings))
    return load(name)


def name_of(path: Path) -> str:
    """Return the name of a robot made of a file."""
    return re.sub(r"[^a-z0-9_.-]+", "_", path.stem.lower()).strip("._-")[:64] or "robot"


def remove(name: str) -> Path:
    """Delete an added robot and return where it was; raises `ArgumentError` where there is none, and `WriteError`."""
    if name not in names():
        there = ", ".join(names()) or "none"
        raise ArgumentError(f"no robot {name!r} was added. Added are: {there}.")
    own = folder() / name
    with writing(own):
        shutil.rmtree(own)
    return own


def _decoded(kind: type, value: Any) -> Any:
    if kind is Path:
        return Path(str(value))
    raise NotImplementedError(kind)
