"""A recording as it is named: a file or a folder, perhaps one clip of several in it, read on demand."""

import hashlib
from functools import cached_property
from pathlib import Path
from typing import Any

from hoi_retarget.errors import ReadError
from hoi_retarget.files import npz
from hoi_retarget.files.reading import entry_names, map_bytes, read_bytes

SELECTION = "#"
"""Stands between the path and the name of one clip in it."""
FOLDER = "/"  # Stands for a file name's ending where a recording is a folder.
_BEGINNING = 512  # Bytes.
CLIP_FILE = "clip.npz"  # Name of a clip in this project's layout in a folder of its own.


class SourceFile:
    """A recording's path and the content of its files, each read and parsed at most once.

    Content of another kind than the requested one raises `ReadError` or is empty.
    """

    def __init__(self, name: Path) -> None:
        path, _, selection = str(name).rpartition(SELECTION)
        chosen = bool(path) and not _there(name)
        self.name = name
        """As the user wrote it."""
        self.path = Path(path) if chosen else name
        """Without the selection."""
        self.selection = selection if chosen else None
        """Which of the clips in it is meant; None where the name does not say."""
        self._digests: dict[Path, str] = {}

    @property
    def suffix(self) -> str:
        """The ending of the file's name in small letters, or `FOLDER`."""
        return FOLDER if _is_folder(self.path) else self.path.suffix.lower()

    @property
    def clip_file(self) -> Path:
        """The file, or `CLIP_FILE` in it where it is a folder."""
        return self.path / CLIP_FILE if _is_folder(self.path) else self.path

    @property
    def exists(self) -> bool:
        """Whether it is there; True where the system does not say."""
        return _there(self.path)

    @cached_property
    def content(self) -> bytes:
        """The file's bytes; raises `ReadError`."""
        return self.read(self.path)

    @cached_property
    def beginning(self) -> bytes:
        """The file's first bytes, where the whole file may not be needed; raises `ReadError`."""
        return bytes(map_bytes(self.path)[:_BEGINNING])

    @cached_property
    def members(self) -> npz.Members:
        """The arrays of an `.npz` file, each as the bytes of an `.npy` file; raises `ValueError` for other files."""
        return npz.Members(self.content)

    @cached_property
    def array_names(self) -> frozenset[str]:
        """Names of the arrays of an `.npz` file, without reading them; empty where it is no such file."""
        return frozenset(name.removesuffix(".npy") for name in entry_names(self.path))

    @cached_property
    def torch(self) -> Any:
        """Value of a torch file; raises `ReadError`."""
        from hoi_retarget.files.torch_file import parse_torch  # noqa: PLC0415  # built-in clips need no pickles

        return parse_torch(self.content, self.path)

    @cached_property
    def pickle(self) -> Any:
        """Value of a pickle of plain values and arrays; raises `ReadError`."""
        from hoi_retarget.files.array_pickle import parse_pickle  # noqa: PLC0415  # as above

        return parse_pickle(self.content, self.path)

    def beside(self, *steps: str) -> Path:
        """Return a path from the folder that the recording is, or that its file is in.

        Raises `ReadError` for steps that are not plain names: these may come from files.
        """
        for step in steps:
            if step in ("", ".", "..") or any(character in step for character in "/\\:\0"):
                raise ReadError(f"{self.name}: it names {step[:80]!a}, which is no plain name of a file or folder.")
        return (self.path if _is_folder(self.path) else self.path.parent).joinpath(*steps)

    def read(self, path: Path) -> bytes:
        """Return the bytes of a file that the clip is made of; raises `ReadError`."""
        content = read_bytes(path)
        self._digests[path] = hashlib.sha256(content).hexdigest()
        return content

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were read, in order."""
        return tuple(sorted(self._digests))

    @property
    def sha256(self) -> str:
        """Of the file that was read; of the digests of all, in the order of their paths, where there were several."""
        digests = [self._digests[path] for path in self.files]
        return digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()


def _there(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):
        return True


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False
