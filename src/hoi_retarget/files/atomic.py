"""Atomic writes: a file is written beside its place and renamed over it."""

import errno
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from hoi_retarget.errors import WriteError

EARLIER = ".old"
"""Ends the second name of a file while another one takes its place."""


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` to `path` so that either all of it or the previous file is there.

    Raises `WriteError`.
    """
    write_together({path: content})


def write_together(contents: Mapping[Path, bytes]) -> None:
    """Write several files so that either all of them or the previous ones are there.

    All are written beside their places before any is renamed over its own. Raises `WriteError`, whatever else
    goes wrong then.
    """
    temporaries: dict[Path, Path] = {}
    earlier: dict[Path, Path | None] = {}
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
            if len(temporaries) > 1:
                _keep_earlier(path, temporary, earlier)
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


def _keep_earlier(path: Path, temporary: Path, earlier: dict[Path, Path | None]) -> None:
    """Give the file at a path a second name, from which it can come back; None says that there is no such file."""
    name = temporary.with_name(temporary.name + EARLIER)
    try:
        os.link(path, name)
        earlier[path] = name
    except FileNotFoundError:
        earlier[path] = None
    except OSError:
        pass  # A disk without second names: better a risk than no file.


def _put_back(stopped: Path, earlier: Mapping[Path, Path | None]) -> None:
    """Undo the renames before the failed one."""
    for path, name in earlier.items():
        if path == stopped:
            return
        with suppress(OSError):
            path.unlink() if name is None else name.replace(path)
