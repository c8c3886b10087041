"""Archives of a release (`.tar`, also compressed), unpacked a piece at a time: a release need not lie there whole.

A piece ends between two folders as soon as it is large enough: each recording is to be a folder of its own. Meshes stay
to the end, because recordings share them. Nothing but regular files below the piece's folder is written.
"""

import lzma
import shutil
import tarfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO

from hoi_retarget.errors import ReadError, install_hint
from hoi_retarget.files.atomic import writing
from hoi_retarget.readers.object_files import MESH_SUFFIXES

ENDINGS = (".tar.zst", ".tar.gz", ".tgz", ".tar.xz", ".tar.bz2", ".tar")
PIECE = 500_000_000  # Bytes, unpacked, after which a piece ends with the next folder.
_MOST = 4  # Pieces' sizes that files of one folder, and meshes, may take.


def archives_in(path: Path) -> tuple[Path, ...]:
    """Return the archive that a path names, or those in the folder that it names, in order of their names."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return tuple(file for file in files if file.name.lower().endswith(ENDINGS) and file.is_file())


def pieces(archives: Sequence[Path], folder: Path, size: int = PIECE) -> Iterator[Path]:
    """Yield an archive whenever a piece of it, and the meshes so far, lie in a folder, which is removed in the end.

    What was read before a fault is a piece, too.

    `archives`: read one after the other, once; `folder`: emptied before; `size`: bytes after which a piece ends. Raises
    `ReadError`: an archive is damaged, has paths outside of itself or too large a folder, or needs a package;
    `WriteError`: the disk is full.
    """
    shutil.rmtree(folder, ignore_errors=True)
    written: dict[Path, int] = {}
    last = PurePosixPath()
    try:
        for archive in archives:
            fault: ReadError | None = None
            try:
                for name, content in _files(archive):
                    path, total = folder / name, sum(written.values())
                    if total > size and not (last.is_relative_to(name.parent) or name.parent.is_relative_to(last)):
                        yield archive
                        written, total = _meshes_of(written), 0
                    if total > _MOST * size:
                        raise ReadError(f"{archive}: {last} is no folder of one recording. Unpack it, and name that.")
                    last = name.parent
                    with writing(path):
                        path.parent.mkdir(parents=True, exist_ok=True)
                        written[path] = path.write_bytes(content)
            except ReadError as error:
                fault = error
            yield archive
            if fault is not None:
                raise fault
            written = _meshes_of(written)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _meshes_of(written: dict[Path, int]) -> dict[Path, int]:
    """Return the meshes among files; the others are removed."""
    for path in written:
        if path.suffix.lower() not in MESH_SUFFIXES:
            path.unlink(missing_ok=True)
    return {path: size for path, size in written.items() if path.exists()}


def _files(archive: Path) -> Iterator[tuple[PurePosixPath, bytes]]:
    """Yield path and content of the regular files in an archive, from its first byte to its last."""
    try:
        with _stream_of(archive) as stream, tarfile.open(fileobj=stream, mode="r|*") as members:
            for member in filter(tarfile.TarInfo.isreg, members):
                name = PurePosixPath(member.name)
                if name.is_absolute() or ".." in name.parts or "\\" in member.name:
                    raise ReadError(f"{archive}: it has a path outside of itself, {member.name!r}. It is not read.")
                if member.size > PIECE:
                    raise ReadError(f"{archive}: {name} has {member.size} bytes: no file of a recording does.")
                content = members.extractfile(member)
                yield name, content.read() if content else b""
    except (tarfile.TarError, zlib.error, lzma.LZMAError, EOFError) as error:
        raise ReadError(f"{archive}: damaged behind the recordings before ({error}). Download it again.") from error


@contextmanager
def _stream_of(archive: Path) -> Iterator[IO[bytes]]:
    """Open an archive, without Zstandard's compression, which the standard library reads from Python 3.14 on alone."""
    with archive.open("rb") as file:
        if archive.suffix.lower() != ".zst":
            yield file
        elif hint := install_hint("zstandard"):
            raise ReadError(f"{archive}: Zstandard's archives need a package. {hint}")
        else:
            import zstandard  # noqa: PLC0415  # an extra

            with zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True) as stream:
                try:
                    yield stream
                except zstandard.ZstdError as error:
                    raise EOFError(error) from error
