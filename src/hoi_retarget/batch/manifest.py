"""`manifest.jsonl`: one line of JSON for the outcome of every job.

While a batch runs, lines are appended, each with one write; a later line of a job takes the place of an earlier one.
At the start and at the end the file is written anew, one line a job. A line that a power cut tore is left out when
the file is read: its job is done again.
"""

import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any, Literal, get_args

import msgspec

from hoi_retarget.errors import ReadError, WriteError
from hoi_retarget.files.atomic import write_atomically, writing

MANIFEST = "manifest.jsonl"
Status = Literal["solved", "failed", "timeout", "killed"]
"""Solved; an error or a motion with faults; too long; its process ended."""
STATUSES: tuple[Status, ...] = get_args(Status)
_RETRIED = ("WriteError", "MemoryError", "OSError")  # Errors of the machine, not of the clip: the next run tries again.


@dataclass(frozen=True)
class ManifestSource:
    """The recording of one job."""

    path: str = ""  # The clip as the specification names it.
    sha256: str = ""  # Of the recording; this and all below is empty where the clip could not be read.
    format: str = ""
    licence: str = ""
    objects: tuple[str, ...] | None = None  # Names of the objects in it.
    files: tuple[str, ...] = ()  # Other files that it was read from.
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class ManifestResult:
    """One result file of a job; raises `ValueError` when its path leads out of the output folder."""

    path: str  # Below the output folder.
    sha256: str
    figures: Mapping[str, Any] = field(default_factory=dict)
    verdict: Mapping[str, Any] = field(default_factory=dict)  # The level, and its reasons.
    companions: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of the files that belong to it, by their paths below the output folder."""

    def __post_init__(self) -> None:
        for name in (self.path, *self.companions):
            path = PurePosixPath(name)
            if path.is_absolute() or ".." in path.parts or "\0" in name:
                raise ValueError(f"{name!r} is no path below the output folder")

    @property
    def files(self) -> dict[str, str]:
        """SHA-256 of all its files by their paths."""
        return {self.path: self.sha256, **self.companions}


@dataclass(frozen=True)
class ManifestEntry:
    """The outcome of one job; plain JSON values."""

    name: str  # Of the job, and of its results below the output folder, without the suffix.
    status: Status
    robot: str
    source: ManifestSource
    scales: Mapping[str, Any]
    """`root`, `object` and `size_multiplier`: as specified; those of the results where there are some."""
    lineage: Mapping[str, Any]
    """What was done to the recording: `mirrored`, `speed`, and the SHA-256 of `contact_edits`."""
    verdict: str = ""  # The worst of its results: pass, warn or fail; empty where there are none.
    reason: str = ""  # Why the status is no better.
    error: str = ""  # The kind of error.
    frame: int | None = None  # The first frame in which it shows, where that is known.
    frames: int = 0
    fps: float = 0.0
    seconds: float = 0.0  # What the job took [s].
    time_limit: float | None = None  # What it was allowed to take [s].
    results: tuple[ManifestResult, ...] = ()  # One for each person.
    fell_after: float | None = None
    """Time of the motion after which the simulated robot fell [s]; None where it did not, or none was simulated."""
    certificate: str = ""  # What is certified of a motion that was performed whole, in words.
    key: str = ""  # Digest of everything that the result depends on.

    @property
    def succeeded(self) -> bool:
        """Whether there are results."""
        return self.status == "solved"

    def is_final(self, time_limit: float | None) -> bool:
        """Return whether doing the same again would end the same way."""
        if self.status == "timeout":
            return time_limit is not None and self.time_limit is not None and time_limit <= self.time_limit
        return self.succeeded or (self.status == "failed" and self.error not in _RETRIED)


def read_manifest(folder: Path) -> dict[str, ManifestEntry]:
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
    entries = filter(None, map(_parsed, content.splitlines()))
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
        with writing(self._path):
            self._file = os.open(self._path, os.O_WRONLY | os.O_APPEND)

    def add(self, entry: ManifestEntry) -> None:
        """Record the outcome of a job."""
        self.entries[entry.name] = entry
        self._unwritten += _line(entry)
        try:
            written = os.write(self._file, self._unwritten)
            if written == len(self._unwritten):
                os.fsync(self._file)
                self._unwritten = b""
                return
        except OSError:
            pass  # Tried again with the next entry, and at last when the file is written anew, which tells.
        # What was torn ends here; whole lines that come twice do no harm.
        self._unwritten = b"\n" + self._unwritten.lstrip(b"\n")

    def __enter__(self) -> "Manifest":
        return self

    def __exit__(self, kind: type[BaseException] | None, _error: BaseException | None, _: TracebackType | None) -> None:
        with suppress(OSError):
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


def _line(entry: ManifestEntry) -> bytes:
    return json.dumps(asdict(entry), allow_nan=False).encode() + b"\n"


def _parsed(line: bytes) -> ManifestEntry | None:
    """Return the entry of a line; None where it is torn, of another version, or not of a batch."""
    try:
        # Not msgspec's own parser: names of files may hold lone surrogates, which it refuses.
        return msgspec.convert(json.loads(line, parse_constant=_refuse), ManifestEntry)
    except (ValueError, RecursionError):
        return None


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is not JSON")
