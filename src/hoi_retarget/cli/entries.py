"""Results as pages show them: with their figures, and the command that makes them again."""

import shlex
from pathlib import PureWindowsPath

from hoi_retarget.cli.run_arguments import words_of
from hoi_retarget.evaluation import Score
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.viewers.share.gallery import GalleryEntry


def entry_of(motion: Motion, model: RobotModel, score: Score) -> GalleryEntry:
    """Return what a page says of a result."""
    warnings = tuple(map(str, motion.warnings))
    return GalleryEntry(motion, model.spec, score, warnings, command=_made_by(motion))


def _made_by(motion: Motion) -> str:
    """Return the command that makes a result again, paths cut to their last name."""
    settings = motion.report.command
    if "clips" not in settings:
        return ""
    words = words_of({**settings, "out": "results"}, motion.report.config, shown=_last_name)
    return shlex.join(["hoi-retarget", *words])


def _last_name(path: str) -> str:
    return PureWindowsPath(path).name or path
