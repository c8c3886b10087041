"""Pages beside a report that play its motions, each with a picture; what did not change is not made again."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path

from hoi_retarget import __version__
from hoi_retarget.errors import DrawingError, WriteError
from hoi_retarget.files.atomic import write_atomically
from hoi_retarget.viewers.offscreen.thumbnail import thumbnail
from hoi_retarget.viewers.share.clip_page import ClipPage
from hoi_retarget.viewers.share.gallery import file_name

FOLDER, LISTING = "motions", "pages.json"
_AROUND = 1.0  # What is played before and after the worst moment [s].


@dataclass(frozen=True)
class MotionPage:
    """A page that plays one motion."""

    page: str
    """Its file, beside the report's folder of pages."""
    picture: str
    """The same of its picture; empty where this machine cannot draw."""
    second: float
    """When the motion is at its worst [s]."""
    digest: str = ""
    """Of the motion's file and of what else the page depends on."""

    @property
    def link(self) -> str:
        """Where the motion plays around its worst moment, seen from the report."""
        first = max(0.0, self.second - _AROUND)
        return f"{FOLDER}/{self.page}#t={first:.2f},{self.second + _AROUND:.2f}"

    @property
    def picture_link(self) -> str:
        """Where its picture is, seen from the report; empty where there is none."""
        return self.picture and f"{FOLDER}/{self.picture}"


class MotionPages:
    """The pages of one report, in its folder."""

    def __init__(self, out: Path, title: str) -> None:
        """Begin with the pages of an earlier report in that folder, if there are any."""
        self._folder, self._title = out / FOLDER, title
        self._earlier = _listed(self._folder / LISTING)
        self.pages: dict[str, MotionPage] = {}
        """By the file's name in the report."""
        self.without_pictures = ""
        """Why there are no pictures; empty where there are."""

    def add(self, file: str, path: Path, make: Callable[[], tuple[ClipPage, int, float] | None]) -> None:
        """Write the page of a motion, unless an earlier one shows the same.

        Args:
            file: Its name in the report.
            path: The motion's file.
            make: Returns the page, the frame of the picture and the worst moment [s]; None where there is nothing to
                show.

        Raises:
            WriteError: There is no room, or no permission.
        """
        digest, earlier = self._digest(path), self._earlier.get(file)
        if earlier is not None and digest and earlier.digest == digest and self._is_there(earlier):
            self.pages[file] = earlier
            return
        made = make()
        if made is None:
            return
        page, frame, second = made
        taken = [Path(other.page).stem for other in (*self.pages.values(), *self._earlier.values())]
        name = Path(earlier.page).stem if earlier is not None else file_name(file, taken)
        write_atomically(self._folder / f"{name}.html", page.text.encode(errors="backslashreplace"))
        picture = ""
        try:
            write_atomically(self._folder / f"{name}.png", thumbnail(page.scene, frame, page.camera))
            picture = f"{name}.png"
        except DrawingError as error:
            self.without_pictures = str(error)
        self.pages[file] = MotionPage(f"{name}.html", picture, second, digest)

    def finish(self) -> None:
        """Remove pages of motions that are no longer there, and write which there are; raises `WriteError`."""
        kept = {name for page in self.pages.values() for name in (page.page, page.picture)}
        gone = {name for page in self._earlier.values() for name in (page.page, page.picture)} - kept - {""}
        try:
            for name in gone:
                (self._folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise WriteError(f"{self._folder}: cannot be written ({error.strerror or error}).") from error
        if self.pages or self._earlier:
            listing = {file: asdict(page) for file, page in self.pages.items()}
            write_atomically(self._folder / LISTING, (json.dumps(listing, indent=1) + "\n").encode())

    def _is_there(self, page: MotionPage) -> bool:
        return all((self._folder / name).is_file() for name in (page.page, page.picture) if name)

    def _digest(self, path: Path) -> str:
        try:
            content = path.read_bytes()
        except OSError:  # A folder that is one motion.
            return ""
        return sha256(f"{__version__}\0{self._title}\0".encode(errors="replace") + content).hexdigest()


def _listed(path: Path) -> dict[str, MotionPage]:
    """Return the pages that an earlier report lists; none where it says nothing, or leads out of its folder."""
    try:
        pages = {file: MotionPage(**facts) for file, facts in json.loads(path.read_text(encoding="utf-8")).items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}
    names = [name for page in pages.values() for name in (page.page, page.picture) if name != ""]
    plain = all(isinstance(name, str) and Path(name).name == name and name != LISTING for name in names)
    return pages if plain else {}
