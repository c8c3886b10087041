"""`hoi-retarget share`: results as a folder of pages that anybody can open."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from hoi_retarget.cli.commands import Share
from hoi_retarget.cli.entries import entry_of
from hoi_retarget.cli.jobs import check_writable, clip_or_warning, load_motion, score, with_file
from hoi_retarget.cli.terminal import Working, fail, say, warn
from hoi_retarget.errors import HoiRetargetError, WriteError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.report.discover import files_of
from hoi_retarget.robots import load_robot
from hoi_retarget.viewers.scene.scene import Shown
from hoi_retarget.viewers.scene.shared_objects import group_people, shared_objects
from hoi_retarget.viewers.scene.titles import names_together, title_together, titles_of
from hoi_retarget.viewers.share.gallery import GalleryEntry
from hoi_retarget.viewers.share.share import check_replaceable, gallery_in


def execute(command: Share) -> int:
    """Write the gallery of all results that can be shown; return 1 where some cannot, and write none where none can."""
    check_replaceable(command.out)
    check_writable("--out", command.out.parent)
    paths = tuple(dict.fromkeys(file for path in command.results for file in files_of(path)))
    motions: dict[Path, Motion] = {}
    shared = 0
    with gallery_in(command.out, command.title) as gallery, Working("sharing", len(paths)) as working:
        for path in paths:
            with _failing(path, alone=len(paths) == 1):
                motions[path] = load_motion(path, command.robot)
        for title, members in _together(motions):
            working.describe(title)
            with _failing(*members, alone=len(paths) == 1):
                gallery.add(title, _results(members, motions, command))
                shared += len(members)
            working.advance(len(members))
        if not shared:
            raise HoiRetargetError(f"none of the {len(paths)} results can be shown: no gallery is written.")
    if gallery.without_pictures:
        warn(f"The cards have no pictures. {gallery.without_pictures}")
    say(f"{shared} motion{'s' if shared > 1 else ''} in {command.out}: open {command.out / 'index.html'} in a browser.")
    if failed := len(paths) - shared:
        say(f"{shared} shared, {failed} failed.")
    return 1 if failed else 0


@contextmanager
def _failing(*paths: Path, alone: bool) -> Iterator[None]:
    """Print what is wrong with some files, each of them named; where nothing else is shared, raise it."""
    try:
        yield
    except WriteError:
        raise
    except HoiRetargetError as error:
        if alone:
            raise
        for path in paths:
            fail(with_file(path, error))


def _together(motions: dict[Path, Motion]) -> Iterator[tuple[str, list[Path]]]:
    """Yield title and files of each page: robots that move the same objects share one."""
    files = list(motions)
    hosts = group_people([shared_objects(motion) for motion in motions.values()], [m.person for m in motions.values()])
    titles = titles_of(list(motions.items()), shortest=False)
    for host in dict.fromkeys(hosts):
        members = [index for index, other in enumerate(hosts) if other == host]
        yield title_together([titles[index] for index in members]), [files[index] for index in members]


def _results(paths: Sequence[Path], motions: dict[Path, Motion], command: Share) -> list[tuple[GalleryEntry, Shown]]:
    models = [load_robot(motions[path].robot) for path in paths]
    names = names_together([(model.spec, motions[path].person) for model, path in zip(models, paths, strict=True)])
    results = []
    for path, model, name in zip(paths, models, names, strict=True):
        motion = motions[path]
        clip = clip_or_warning(path, motion, command, "its page shows the robot without the human.")
        shown = Shown(name, motion, model, clip, motion.person)
        results.append((entry_of(motion, model, score(motion, path)), shown))
    return results
