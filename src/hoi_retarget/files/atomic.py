"""Atomic writes: a file is written beside its place and renamed over it."""

import errno
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

from hoi_retarget.errors import WriteError


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
