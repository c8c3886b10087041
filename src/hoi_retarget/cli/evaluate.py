"""`hoi-retarget evaluate`: the figures that results carry, as a table, JSON and CSV."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from hoi_retarget.cli.commands import Evaluate
from hoi_retarget.cli.figures import show_figures
from hoi_retarget.cli.jobs import check_writable, write_file
from hoi_retarget.cli.jobs import score as score_of
from hoi_retarget.cli.terminal import fail, program, say, warn
from hoi_retarget.errors import ArgumentError, HoiRetargetError, ReadError
from hoi_retarget.evaluation import Score, to_csv, to_json
from hoi_retarget.motion.result_file import load


def execute(command: Evaluate) -> int:
    """Show the figures of every result; return 0 when all could be read."""
    if not command.results:
        raise ArgumentError("no result is named. Usage: hoi-retarget evaluate RESULT... [--json FILE] [--csv FILE].")
    files = {"--json": command.json, "--csv": command.csv}
    for option, path in files.items():
        if path is not None:
            check_writable(option, path.parent)
    scores = list(_scores(command.results))
    if scores:
        say("Figures as the run computed and stored them:")
        show_figures(scores)
        for (option, path), text in zip(files.items(), (to_json, to_csv), strict=True):
            if path is not None:
                write_file(option, path, text(scores).encode())
                say(f"written: {path}")
    failed = len(command.results) - len(scores)
    if failed:
        say(f"{len(scores)} evaluated, {failed} failed.")
    return 1 if failed else 0


def _scores(paths: Iterable[Path]) -> Iterator[Score]:
    """Yield the figures of every result that can be read; tell what is wrong with it, or with the others."""
    for path in paths:
        try:
            score, found = _score(path)
        except HoiRetargetError as error:
            fail(str(error))
            continue
        for warning in found:
            warn(f"{path}: {warning}")
        yield score


def _score(path: Path) -> tuple[Score, tuple[str, ...]]:
    """Return a result's figures and what is not right with it."""
    if path.suffix.lower() in (".pt", ".pth") and os.path.isfile(path):  # noqa: PTH113  # raises nothing
        raise ReadError(f"{path}: this is a clip, not a result. Use `{program()} run` on it first.")
    motion = load(path)
    return score_of(motion, path), tuple(map(str, motion.warnings))
