"""Files of edits that belong together: the edits, versions of them by name, and those that nobody has saved yet."""

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from hoi_retarget.clip.edits.edits import ContactEdits
from hoi_retarget.clip.edits.file import save
from hoi_retarget.errors import ArgumentError, WriteError

ENDING = ".edits.toml"
UNSAVED = "unsaved"


@dataclass(frozen=True)
class EditsFiles:
    """The files beside a file of edits: `box.edits.toml`, `box.NAME.edits.toml`, `box.edits.toml.unsaved`."""

    saved: Path

    @property
    def unsaved(self) -> Path:
        """Where edits are kept until they are saved."""
        return self.saved.with_name(f"{self.saved.name}.{UNSAVED}")

    @property
    def versions(self) -> tuple[str, ...]:
        """The names of all versions."""
        begin, end = f"{self._stem}.", self._ending
        found = (path.name for path in self.saved.parent.glob(f"*{end}"))
        names = (name[len(begin) : -len(end)] for name in found if name.startswith(begin) and name != self.saved.name)
        return tuple(sorted(name for name in names if _is_name(name)))

    def version(self, name: str) -> Path:
        """Return the file of a version; raises `ArgumentError` for what is no name."""
        if not _is_name(name):
            raise ArgumentError(f"{name!r} is no name for a version: letters, digits, - and _, at most 40 of them.")
        return self.saved.with_name(f"{self._stem}.{name}{self._ending}")

    def keep(self, edits: ContactEdits) -> None:
        """Write edits that nobody has saved yet; raises `WriteError`."""
        save(edits, self.unsaved)

    def forget(self) -> None:
        """Remove what was kept."""
        with suppress(OSError):
            self.unsaved.unlink(missing_ok=True)

    def set_aside(self) -> str:
        """Make a version of what was kept, and return its name; raises `WriteError`."""
        name = next(name for name in map(_numbered, count(1)) if not os.path.lexists(self.version(name)))
        try:
            self.unsaved.rename(self.version(name))
        except OSError as error:
            raise WriteError(f"{self.unsaved}: cannot be renamed ({error.strerror}).") from error
        return name

    @property
    def _ending(self) -> str:
        return ENDING if self.saved.name.endswith(ENDING) else self.saved.suffix or ENDING

    @property
    def _stem(self) -> str:
        return self.saved.name.removesuffix(self._ending)


def _numbered(number: int) -> str:
    return UNSAVED if number == 1 else f"{UNSAVED}-{number}"


def _is_name(text: str) -> bool:
    return re.fullmatch(r"[A-Za-z0-9_-]{1,40}", text) is not None
