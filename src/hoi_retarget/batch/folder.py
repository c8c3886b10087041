"""The output folder of a running batch: locked against a second one, and cleared of temporary files of a crash."""

import fcntl
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hoi_retarget.batch.manifest import MANIFEST
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.files.atomic import EARLIER, writing

LOCK = ".batch.lock"
_TEMPORARY = re.compile(rf"\.(.+\.npz|{re.escape(MANIFEST)})\.[a-z0-9_]{{8}}({re.escape(EARLIER)})?")
"""Names that `files.atomic` gives to files that are not complete."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make a folder and hold it for one batch alone; the system lets go of it however the program ends.

    Raises:
        HoiRetargetError: another batch works in it.
        WriteError: it cannot be written.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        file = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        _lock(folder, file)
        with writing(folder):
            os.truncate(file, 0)
            os.pwrite(file, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        with suppress(OSError):
            os.close(file)


def remove_temporaries(folder: Path) -> None:
    """Remove files that were never completed; raises `WriteError`."""
    with writing(folder):
        for path in folder.rglob(".*"):
            if _TEMPORARY.fullmatch(path.name):
                path.unlink(missing_ok=True)


def _lock(folder: Path, file: int) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        who = ""
        with suppress(OSError):
            who = os.pread(file, 20, 0).decode("ascii", "replace").strip()
        raise HoiRetargetError(
            f"{folder}: another batch is at work there{f' (process {who})' if who else ''}. "
            "Wait for it, end it, or choose another --out."
        ) from error
