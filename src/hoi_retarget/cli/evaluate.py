"""`hoi-retarget evaluate`: the figures that results carry, as a table, JSON and CSV."""

from pathlib import Path

from hoi_retarget.cli.commands import Evaluate
from hoi_retarget.cli.figures import show_figures
from hoi_retarget.cli.jobs import check_writable, score
from hoi_retarget.cli.terminal import fail, say
from hoi_retarget.errors import ArgumentError, HoiRetargetError, ReadError
from hoi_retarget.metrics import Score, to_csv, to_json
from hoi_retarget.motion import load, write_atomically


def execute(command: Evaluate) -> int:
    """Show the figures of every result; return 0 when all could be read."""
    if not command.results:
        raise ArgumentError("no result is named. Usage: hoi-retarget evaluate RESULT... [--json FILE] [--csv FILE].")
    files = {"--json": command.json, "--csv": command.csv}
    for option, path in files.items():
        if path is not None:
            check_writable(option, path.parent)
    scores: list[Score] = []
    for path in command.results:
        try:
            scores.append(_score(path))
        except HoiRetargetError as error:
            fail(str(error))
    if scores:
        say("Figures as the run computed and stored them:")
        show_figures(scores)
        for path, text in ((command.json, to_json), (command.csv, to_csv)):
            if path is not None:
                write_atomically(path, text(scores).encode())
                say(f"written: {path}")
    failed = len(command.results) - len(scores)
    if failed:
        say(f"{len(scores)} evaluated, {failed} failed.")
    return 1 if failed else 0


def _score(path: Path) -> Score:
    motion = load(path)
    try:
        return score(motion, path)
    except (KeyError, TypeError, AttributeError) as error:
        raise ReadError(
            f"{path}: its report holds no figures of this version ({error}). Run the retarget again."
        ) from error
