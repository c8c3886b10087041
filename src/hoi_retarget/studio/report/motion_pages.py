"""Pages beside a report that play its motions, each with a picture; unchanged ones are not made again."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path

from hoi_retarget import __version__
from hoi_retarget.errors import DrawingError, WriteError
from hoi_retarget.files.atomic import write_atomically
from hoi_retarget.studio.offscreen.robot_portraits import MOVING, STILL, thumbnails
from hoi_retarget.studio.scene.subplots import title_together
from hoi_retarget.studio.share.clip_page import ClipPage
from hoi_retarget.studio.share.gallery import file_name

FOLDER, LISTING = "motions", "pages.json"
_AROUND = 1.0  # What is played before and after the worst moment [s].


@dataclass(frozen=True)
class MotionPage:
    """A page that plays a motion, alone or with those of other people."""

    page: str  # Its file, beside the report's folder of pages.
    picture: str  # The same of its picture; empty where this machine cannot draw.
    second: float  # When the motion is at its worst [s].
    digest: str = ""  # Of the files of its motions and of what else the page depends on.

    @property
    def link(self) -> str:
        """Where the motion plays around its worst moment, seen from the report."""
        first = max(0.0, self.second - _AROUND)
        return f"{FOLDER}/{self.page}#t={first:.2f},{self.second + _AROUND:.2f}"

    @property
    def files(self) -> set[str]:
        """The page's files in the report's folder of pages."""
        return {self.page, *([self.picture, self.film] if self.picture else [])}

    @property
    def film(self) -> str:
        """The file of the picture that moves, beside that of the picture."""
        return self.picture and str(Path(self.picture).with_suffix(MOVING))

    @property
    def film_link(self) -> str:
        """Where the picture that moves is, seen from the report; empty where there is none."""
        return self.picture and f"{FOLDER}/{self.film}"

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

    def add(self, paths: Mapping[str, Path], make: Callable[[], tuple[ClipPage, int, Sequence[float]] | None]) -> None:
        """Write the page of motions that are shown together, unless an earlier one shows the same; raises `WriteError`.

        The files are by their names in the report. `make` returns the page, the frame of the picture and the worst
        moment of each motion [s]; None where there is nothing to show.
        """
        digest = self._digest(paths.values())
        earlier = {file: self._earlier[file] for file in paths if file in self._earlier}
        if len(earlier) == len(paths) and all(self._shows(page, digest) for page in earlier.values()):
            self.pages |= earlier
            return
        made = make()
        if made is None:
            return
        page, frame, seconds = made
        used = {other.page for other in self.pages.values()}
        names = {other.page for other in earlier.values()} - used
        taken = [Path(page).stem for page in (*used, *(other.page for other in self._earlier.values()))]
        name = Path(min(names)).stem if names else file_name(title_together(list(paths)), taken)
        write_atomically(self._folder / f"{name}.html", page.text.encode(errors="backslashreplace"))
        picture = ""
        try:
            for ending, content in thumbnails(page.scene, frame, page.camera).items():
                write_atomically(self._folder / f"{name}{ending}", content)
            picture = f"{name}{STILL}"
        except DrawingError as error:
            self.without_pictures = str(error)
        self.pages |= {
            file: MotionPage(f"{name}.html", picture, second, digest)
            for file, second in zip(paths, seconds, strict=True)
        }

    def finish(self) -> None:
        """Remove pages of motions that are no longer there, and write which there are; raises `WriteError`."""
        current = {name for page in self.pages.values() for name in page.files}
        gone = {name for page in self._earlier.values() for name in page.files} - current
        try:
            for name in gone:
                (self._folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise WriteError(f"{self._folder}: cannot be written ({error.strerror or error}).") from error
        if self.pages or self._earlier:
            listing = {file: asdict(page) for file, page in self.pages.items()}
            write_atomically(self._folder / LISTING, (json.dumps(listing, indent=1) + "\n").encode())

    def _shows(self, page: MotionPage, digest: str) -> bool:
        return digest != "" and page.digest == digest and all((self._folder / name).is_file() for name in page.files)

    def _digest(self, paths: Iterable[Path]) -> str:
        try:
            contents = [path.read_bytes() for path in paths]
        except OSError:  # A folder that is one motion.
            return ""
        return sha256(f"{__version__}\0{self._title}\0".encode(errors="replace") + b"".join(contents)).hexdigest()


def _listed(path: Path) -> dict[str, MotionPage]:
    """Return the pages that an earlier report lists; none where it lists nothing, or leads out of its folder."""
    try:
        pages = {file: MotionPage(**facts) for file, facts in json.loads(path.read_text(encoding="utf-8")).items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}
    names = [name for page in pages.values() for name in (page.page, page.picture) if name != ""]
    plain = all(isinstance(name, str) and Path(name).name == name and name != LISTING for name in names)
    return pages if plain else {}
