"""A gallery of results in a folder: pages that play them in any browser, without a server or the internet.

A page carries its scene, its player and its curves in itself, so it can also be sent or embedded alone.
"""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from hoi_retarget.errors import ArgumentError, DrawingError, WriteError
from hoi_retarget.files.atomic import hold, remove_leftovers
from hoi_retarget.studio.offscreen.robot_portraits import representative_frame, thumbnails
from hoi_retarget.studio.scene.scene import SceneItem
from hoi_retarget.studio.share.clip_page import BackLink, make_clip_page
from hoi_retarget.studio.share.gallery import Card, GalleryEntry, file_name, index_page

LISTING = "gallery.json"  # The file that marks a folder as a gallery, and lists its own files.


class Gallery:
    """Pages in the making; made by `gallery_in`."""

    def __init__(self, folder: Path, title: str) -> None:
        self._folder, self._title = folder, title
        self._cards: list[Card] = []
        self.without_pictures = ""
        """Why cards have no pictures; empty where they have."""

    def add(self, title: str, results: Sequence[tuple[GalleryEntry, SceneItem]]) -> None:
        """Write the page of results that are shown together, and its pictures where this machine can draw.

        Raises `GeometryError` when an object's mesh file cannot be read, and `WriteError`.
        """
        name = file_name(title, ("index", *(Path(card.page).stem for card in self._cards)))
        page = make_clip_page(title, results, back=BackLink(self._title, "index.html"))
        self._write_page(f"{name}.html", page.text)
        entries = tuple(entry for entry, _ in results)
        pictures: tuple[str, ...] = ()
        try:
            drawn = thumbnails(page.scene, representative_frame(entries[0].motion), page.camera)
            pictures = tuple(f"{name}{ending}" for ending in drawn)
            for picture, content in zip(pictures, drawn.values(), strict=True):
                self._write(picture, content)
        except DrawingError as error:
            self.without_pictures = str(error)
        self._cards.append(Card(title, entries, f"{name}.html", *pictures))

    def finish(self) -> None:
        """Write the page of all results; raises `WriteError`."""
        self._write_page("index.html", index_page(self._title, self._cards))
        own = sorted([path.name for path in self._folder.iterdir()] + [LISTING])
        self._write(LISTING, json.dumps({"made by": "hoi-retarget share", "files": own}, indent=1).encode())

    def _write_page(self, name: str, text: str) -> None:
        # Names of results may contain bytes that are no characters.
        self._write(name, text.encode(errors="backslashreplace"))

    def _write(self, name: str, content: bytes) -> None:
        try:
            (self._folder / name).write_bytes(content)
        except OSError as error:
            raise WriteError(f"{name}: cannot be written ({error.strerror or error}). Choose another --out.") from error


@contextmanager
def gallery_in(out: Path, title: str) -> Iterator[Gallery]:
    """Open a gallery that is in a folder when the block ends without an error; until then nothing changes there.

    An earlier gallery in that folder is replaced. Raises `ArgumentError` when the folder holds other files than an
    earlier gallery's, and `WriteError`, with all as it was before, when it cannot be written.
    """
    check_replaceable(out)
    out = out.resolve()  # A name is needed, which `.` has not; and a link stays one.
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        remove_leftovers(out, unless="old")
        work = Path(tempfile.mkdtemp(dir=out.parent, prefix=f".{out.name}."))
    except OSError as error:
        raise _cannot(out, error) from error
    held = hold(work)
    try:
        making = work / "new"
        making.mkdir()
        gallery = Gallery(making, title)
        yield gallery
        gallery.finish()
        _replace(making, out, work / "old")
        shutil.rmtree(work / "old", ignore_errors=True)
    except OSError as error:
        raise _cannot(out, error) from error
    finally:
        shutil.rmtree(work / "new", ignore_errors=True)
        with suppress(OSError):  # An earlier gallery that could not be put back stays in it.
            work.rmdir()
        for handle in held:
            os.close(handle)


def check_replaceable(out: Path) -> None:
    """Raise `ArgumentError` unless a folder is absent, empty, or an earlier gallery and nothing else."""
    try:
        if not out.exists():
            return
        if not out.is_dir():
            raise ArgumentError(f"--out {out}: this is a file. Name a folder.")
        found = {path.name for path in out.iterdir()}
        own = set(_listed(out / LISTING)) if LISTING in found else set()
    except OSError as error:
        raise ArgumentError(f"--out {out}: cannot be read ({error.strerror or error}). Choose another.") from error
    strange = sorted(found - own)
    if strange:
        raise ArgumentError(
            f"--out {out}: there are other files in it than an earlier gallery's ({', '.join(strange[:3])}"
            f"{', ...' if len(strange) > 3 else ''}). Name a folder that does not exist yet."
        )


def _listed(path: Path) -> list[str]:
    """Return the files that a gallery lists as its own; none where it lists nothing."""
    try:
        names = json.loads(path.read_text(encoding="utf-8"))["files"]
    except (ValueError, TypeError, KeyError):
        return []
    return [name for name in names if isinstance(name, str)] if isinstance(names, list) else []


def _replace(new: Path, out: Path, old: Path) -> None:
    """Put a folder in the place of another one, or leave that one where it is."""
    check_replaceable(out)
    there = out.exists()
    if there:
        out.rename(old)
    try:
        new.rename(out)
    except OSError as error:
        try:
            if there:
                old.rename(out)
        except OSError as second:
            raise WriteError(
                f"--out {out}: cannot be written ({error.strerror or error}), and the earlier gallery could not be put "
                f"back ({second.strerror or second}). It is in {old}."
            ) from error
        raise


def _cannot(out: Path, error: OSError) -> WriteError:
    return WriteError(f"--out {out}: cannot be written ({error.strerror or error}). Choose another folder.")
