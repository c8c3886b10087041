"""`manifest.jsonl`: one line of JSON for every job, whatever became of it.

While a batch runs, lines are appended, each with one write; a later line of a job takes the place of an earlier one.
At the start and at the end the file is written anew, one line a job. A line that a power cut tore is left out when
the file is read: its job is done again.
"""

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any

from hoi_retarget.errors import ReadError, WriteError
from hoi_retarget.files.atomic import write_atomically

MANIFEST = "manifest.jsonl"
STATUSES = ("solved", "loose", "failed", "timeout", "killed")
"""Solved; written without having converged; an error; too long; its process ended."""
_PASSING = ("WriteError", "MemoryError", "OSError")
"""Errors that come from the machine, not from the clip: the next run tries again."""


@dataclass(frozen=True)
class Entry:
    """What became of one job; plain JSON values."""

    name: str
    """Of the job, and of its results below the output folder, without the suffix."""
    status: str
    """One of `STATUSES`."""
    robot: str
    source: Mapping[str, Any]
    """The clip: `path` as it was named, `sha256`, `format`, `licence`, `objects`, other `files` that it was read from,
    `notes`; what is known of it."""
    scales: Mapping[str, Any]
    """`root`, `object` and `size_multiplier`: as asked for, and as they came out where there are results."""
    lineage: Mapping[str, Any]
    """What was done to the recording: `mirrored`, `speed`, and the SHA-256 of `contact_edits`."""
    verdict: str = ""
    """The worst of its results: pass, warn or fail; empty where there are none."""
    reason: str = ""
    """Why the status is no better."""
    error: str = ""
    """The kind of error."""
    frame: int | None = None
    """The first frame in which it shows, where that is known."""
    frames: int = 0
    fps: float = 0.0
    seconds: float = 0.0
    """What the job took [s]."""
    time_limit: float | None = None
    """What it was allowed to take [s]."""
    results: tuple[Mapping[str, Any], ...] = ()
    """One for each person: `path` below the output folder, `sha256`, `figures`, and `verdict` with its reasons."""
    key: str = ""
    """Digest of everything that the result depends on."""

    @property
    def succeeded(self) -> bool:
        """Whether there are results."""
        return self.status in ("solved", "loose")

    def is_final(self, time_limit: float | None) -> bool:
        """Return whether doing the same again would end the same way."""
        if self.status == "timeout":
            return time_limit is not None and self.time_limit is not None and time_limit <= self.time_limit
        return self.succeeded or (self.status == "failed" and self.error not in _PASSING)


def read_manifest(folder: Path) -> dict[str, Entry]:
    """Return the entries of a folder's manifest by their names; none where there is no manifest.

    Lines that are not whole are left out. Raises `ReadError` when the file is there and cannot be read.
    """
    path = folder / MANIFEST
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise ReadError(f"{path}: cannot be read ({error.strerror or error}). Choose another --out.") from error
    entries = filter(None, map(_entry, content.splitlines()))
    return {entry.name: entry for entry in entries}


class Manifest:
    """The manifest of a folder in use; closed, it has one line for each job, in order.

    Lines that cannot be written, because the disk is full, are kept and written with the next one.
    """

    def __init__(self, folder: Path, order: Iterable[str]) -> None:
        self.entries = read_manifest(folder)
        self._path = folder / MANIFEST
        self._order = {name: index for index, name in enumerate(order)}
        self._unwritten = b""
        self._write_anew()
        self._file = os.open(self._path, os.O_WRONLY | os.O_APPEND)

    def add(self, entry: Entry) -> None:
        """Record what became of a job."""
        self.entries[entry.name] = entry
        self._unwritten += _line(entry)
        size = os.fstat(self._file).st_size
        try:
            written = os.write(self._file, self._unwritten)
            if written == len(self._unwritten):
                os.fsync(self._file)
                self._unwritten = b""
                return
        except OSError:
            pass  # Tried again with the next entry, and at last when the file is written anew, which tells.
        os.ftruncate(self._file, size)

    def __enter__(self) -> "Manifest":
        return self

    def __exit__(self, kind: type[BaseException] | None, _error: BaseException | None, _: TracebackType | None) -> None:
        os.close(self._file)
        try:
            self._write_anew()
        except WriteError:
            if kind is None:
                raise

    def _write_anew(self) -> None:
        last = len(self._order)
        ordered = sorted(self.entries.values(), key=lambda entry: (self._order.get(entry.name, last), entry.name))
        write_atomically(self._path, b"".join(map(_line, ordered)))


def _line(entry: Entry) -> bytes:
    return json.dumps(asdict(entry), allow_nan=False).encode() + b"\n"


def _entry(line: bytes) -> Entry | None:
    """Return what a line says; None where it is torn, of another version, or not of a batch."""
    try:
        values = json.loads(line, parse_constant=_refused)
        known: dict[str, Any] = {key: values[key] for key in _KEYS}
        if not _is_sound(known):
            return None
        return Entry(**{**known, "results": tuple(known["results"])})
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def _refused(constant: str) -> float:
    raise ValueError(f"{constant} is not JSON")


def _is_sound(values: Mapping[str, Any]) -> bool:
    """Return whether values have the types of an entry, and results are in the folder: outdated ones are removed."""
    objects = values["source"].get("objects") if isinstance(values["source"], dict) else ()
    return (
        all(isinstance(values[key], kinds) for key, kinds in _KINDS.items())
        and values["status"] in STATUSES
        and (objects is None or _is_texts(objects))
        and _is_texts(values["source"].get("files", []))
        and all(_is_inside(result["path"]) and isinstance(result["sha256"], str) for result in values["results"])
    )


def _is_texts(values: Any) -> bool:
    return isinstance(values, list) and all(isinstance(value, str) for value in values)


def _is_inside(path: str) -> bool:
    way = PurePosixPath(path)
    return not way.is_absolute() and ".." not in way.parts and "\0" not in path


_KEYS = tuple(field.name for field in fields(Entry))
_KINDS: Mapping[str, Any] = {
    **dict.fromkeys(("name", "status", "robot", "verdict", "reason", "error", "key"), str),
    **dict.fromkeys(("source", "scales", "lineage"), dict),
    **dict.fromkeys(("fps", "seconds"), int | float),
    "frame": int | None,
    "frames": int,
    "time_limit": int | float | None,
    "results": list,
}
"""Of what type the value of each key is."""
