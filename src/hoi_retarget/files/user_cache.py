"""The user's cache folder: results that take long, kept between runs. Nothing fails where it cannot be used."""

import os
import sys
from contextlib import suppress
from pathlib import Path

from hoi_retarget.errors import WriteError
from hoi_retarget.files.atomic import write_atomically

_MOST_BYTES = 512 << 20
"""All files together; those that were not used for longest go first."""


def kept(name: str) -> bytes | None:
    """Return the content of a kept file, or None where there is none to be read."""
    path = _folder() / name
    try:
        content = path.read_bytes()
    except OSError:
        return None
    with suppress(OSError):
        os.utime(path)
    return content


def keep(name: str, content: bytes) -> None:
    """Keep a file under a name, which tells all that its content depends on; processes may do so at once."""
    folder = _folder()
    with suppress(OSError, WriteError):
        write_atomically(folder / name, content)
        files = sorted(((file.stat().st_mtime, file.stat().st_size, file) for file in folder.iterdir()), reverse=True)
        total = 0
        for _, size, file in files:
            total += size
            if total > _MOST_BYTES:
                file.unlink()


def _folder() -> Path:
    """Return where the platform wants caches."""
    home = Path(os.path.expanduser("~"))  # noqa: PTH111  # unlike Path.home, never fails
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    return base / "hoi-retarget"
