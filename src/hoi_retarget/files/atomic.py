"""Atomic writes: a file is written beside its place and renamed over it."""

import errno
import glob
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from hoi_retarget.errors import WriteError

if sys.platform != "win32":
    import fcntl

EARLIER = ".old"  # Ends the second name of a file while another one takes its place.


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` to `path` so that either all of it or the previous file is there.

    Raises `WriteError`.
    """
    write_together({path: content})


def write_together(contents: Mapping[Path, bytes]) -> None:
    """Write several files so that either all of them or the previous ones are there.

    All are written beside their places before any is renamed over its own; what a killed program left there is removed.
    Raises `WriteError`, whatever else goes wrong then.
    """
    temporaries: dict[Path, Path] = {}
    held: list[int] = []
    earlier: dict[Path, Path | None] = {}
    path = Path()
    try:
        for path, content in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            remove_leftovers(path)
            with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
                temporaries[path] = Path(file.name)
                held += hold(temporaries[path])
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            temporaries[path].chmod(0o644)
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        for path, temporary in temporaries.items():
            if len(temporaries) > 1:
                held += _keep_earlier(path, temporary, earlier)
            temporary.replace(path)
    except BaseException as error:
        _put_back(path, earlier)
        if isinstance(error, OSError):
            raise _write_error(path, error) from error
        raise
    finally:
        for leftover in (*temporaries.values(), *filter(None, earlier.values())):
            with suppress(OSError):
                leftover.unlink(missing_ok=True)
        for handle in held:
            with suppress(OSError):
                os.close(handle)


_MIN_AGE_S = 1.0  # What is younger may be made by another program, which has not got hold of it yet.


def hold(path: Path) -> list[int]:
    """Return the handle that holds a file or a folder until it is closed; none where another program holds it."""
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:
        return []
    try:
        lock(handle)
    except OSError:
        os.close(handle)
        return []
    return [handle]


def lock(handle: int) -> None:
    """Lock an open file or folder, where the system can; raises `OSError` where another program holds it."""
    if sys.platform != "win32":
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def remove_leftovers(path: Path, *, unless: str = "") -> None:
    """Remove the incomplete files or folders for a path that killed programs left: those that none holds.

    Folders stay that have an entry of the name `unless`.
    """
    name = re.compile(rf"\.{re.escape(path.name)}\.[a-z0-9_]{{8}}({re.escape(EARLIER)})?")
    with suppress(OSError):
        for left in path.parent.glob(f".{glob.escape(path.name)}.*"):
            if not name.fullmatch(left.name) or time.time() - left.lstat().st_ctime < _MIN_AGE_S:
                continue
            for handle in hold(left):
                if unless and (left / unless).exists():
                    pass
                elif left.is_dir() and not left.is_symlink():
                    shutil.rmtree(left, ignore_errors=True)
                else:
                    left.unlink(missing_ok=True)
                os.close(handle)


def remove(paths: Iterable[Path]) -> None:
    """Remove files, where they are there; raises `WriteError`."""
    for path in paths:
        with writing(path):
            path.unlink(missing_ok=True)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn the system's error for a file or a folder into a `WriteError`."""
    try:
        yield
    except OSError as error:
        raise _write_error(path, error) from error


def _write_error(path: Path, error: OSError) -> WriteError:
    return WriteError(f"{path}: cannot be written ({error.strerror or error}). Choose another --out.")


def _keep_earlier(path: Path, temporary: Path, earlier: dict[Path, Path | None]) -> list[int]:
    """Give the file at a path a second name, from which it can come back, and hold it; None says that there is none."""
    name = temporary.with_name(temporary.name + EARLIER)
    try:
        os.link(path, name)
        earlier[path] = name
        return hold(name)
    except FileNotFoundError:
        earlier[path] = None
    except OSError:
        pass  # A disk without second names: better a risk than no file.
    return []


def _put_back(stopped: Path, earlier: Mapping[Path, Path | None]) -> None:
    """Undo the renames before the failed one."""
    for path, name in earlier.items():
        if path == stopped:
            return
        with suppress(OSError):
            path.unlink() if name is None else name.replace(path)
