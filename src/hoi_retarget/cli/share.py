"""`hoi-retarget share`: results as a folder of pages that anybody can open."""

from pathlib import Path

from hoi_retarget.cli.commands import Share
from hoi_retarget.cli.entries import entry_of
from hoi_retarget.cli.jobs import check_writable, clip_or_warning, load_motion, score, with_file
from hoi_retarget.cli.terminal import Working, fail, say, warn
from hoi_retarget.errors import HoiRetargetError, WriteError
from hoi_retarget.robots import load_robot
from hoi_retarget.viewers.scene.scene import Shown
from hoi_retarget.viewers.share.share import Gallery, check_replaceable, gallery_in


def execute(command: Share) -> int:
    """Write the gallery of all results that can be shown; return 1 where some cannot, and write none where none can."""
    check_replaceable(command.out)
    check_writable("--out", command.out.parent)
    failed = 0
    with gallery_in(command.out, command.title) as gallery, Working("sharing", len(command.results)) as working:
        for path in working.through(command.results):
            try:
                _add(gallery, path, command)
            except WriteError:
                raise
            except HoiRetargetError as error:
                if len(command.results) == 1:
                    raise
                failed += 1
                fail(with_file(path, error))
        if failed == len(command.results):
            raise HoiRetargetError(f"none of the {failed} results can be shown: no gallery is written.")
    if gallery.without_pictures:
        warn(f"The cards have no pictures. {gallery.without_pictures}")
    count = len(command.results) - failed
    say(f"{count} motion{'s' if count > 1 else ''} in {command.out}: open {command.out / 'index.html'} in a browser.")
    if failed:
        say(f"{count} shared, {failed} failed.")
    return 1 if failed else 0


def _add(gallery: Gallery, path: Path, command: Share) -> None:
    motion = load_motion(path, command.robot)
    model = load_robot(motion.robot)
    clip = clip_or_warning(path, motion, command, "its page shows the robot without the human.")
    gallery.add(
        entry_of(path.stem, motion, model, score(motion, path)), Shown(path.stem, motion, model, clip, motion.person)
    )
