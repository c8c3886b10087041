"""`hoi-retarget share`: results as a folder of pages that anybody can open."""

import shlex
from pathlib import Path, PureWindowsPath

from hoi_retarget.cli.commands import Share
from hoi_retarget.cli.jobs import check_writable, clip_or_warning, load_result, score
from hoi_retarget.cli.run_arguments import words_of
from hoi_retarget.cli.terminal import Working, say, warn
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.viewers.scene.scene import Shown
from hoi_retarget.viewers.share.gallery import GalleryEntry
from hoi_retarget.viewers.share.share import check_replaceable, gallery_in


def execute(command: Share) -> int:
    """Write the gallery; nothing is written when a result cannot be read."""
    check_replaceable(command.out)
    check_writable("--out", command.out.parent)
    with gallery_in(command.out, command.title) as gallery, Working("sharing", len(command.results)) as working:
        for path in working.through(command.results):
            motion = load_result(path)
            model = load_robot(motion.robot)
            clip = clip_or_warning(path, motion, command, "its page shows the robot without the human.")
            shown = Shown(path.stem, motion, model, clip, motion.person)
            gallery.add(_entry(path, motion, model), shown)
    if gallery.without_pictures:
        warn(f"The cards have no pictures. {gallery.without_pictures}")
    count = len(command.results)
    say(f"{count} motion{'s' if count > 1 else ''} in {command.out}: open {command.out / 'index.html'} in a browser.")
    return 0


def _entry(path: Path, motion: Motion, model: RobotModel) -> GalleryEntry:
    warnings = tuple(map(str, motion.warnings))
    return GalleryEntry(path.stem, motion, model.spec, score(motion, path), warnings, command=_made_by(motion))


def _made_by(motion: Motion) -> str:
    """Return the command that makes a result again, paths cut to their last name."""
    settings = motion.report.command
    if "clips" not in settings:
        return ""
    words = words_of({**settings, "out": "results"}, motion.report.config, shown=_last_name)
    return shlex.join(["hoi-retarget", *words])


def _last_name(path: str) -> str:
    return PureWindowsPath(path).name or path
