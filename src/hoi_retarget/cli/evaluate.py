"""`hoi-retarget evaluate`: the figures that results carry, as a table, JSON and CSV."""

import json
from pathlib import Path

from hoi_retarget.cli.commands import Evaluate
from hoi_retarget.cli.figures import show_figures
from hoi_retarget.cli.jobs import (
    check_json,
    check_writable,
    do_for_each,
    exit_code,
    load_motion,
    recording_of,
    score,
    write_file,
    write_json,
)
from hoi_retarget.cli.terminal import say, warn
from hoi_retarget.evaluation import Score, to_csv, to_json


def execute(command: Evaluate) -> int:
    """Show the figures of every result; return 0 when all could be read."""
    check_json(command.json)
    if command.csv is not None:
        check_writable("--csv", command.csv.parent)
    recording = recording_of(command)
    scores: list[Score] = []
    foreign: list[Path] = []

    def evaluate_one(path: Path) -> None:
        motion = load_motion(path, command.robot, recording=recording)
        scores.append(score(motion, path))
        if motion.report.is_foreign:
            foreign.append(path)
        for warning in motion.warnings:
            warn(f"{path}: {warning}")

    failures = do_for_each("reading", command.results, evaluate_one)
    if scores:
        from_what = "that need no recording" if command.clip is None else "as they are beside the clip"
        others = f", and those of other programs' motions {from_what}" if foreign else ""
        say(f"Figures as the run computed and stored them{others}:")
        show_figures(scores)
        write_json(command.json, json.loads(to_json(scores)))
        if command.csv is not None:
            write_file("--csv", command.csv, to_csv(scores).encode())
            say(f"written: {command.csv}")
    if failures:
        say(f"{len(scores)} evaluated, {len(failures)} failed.")
    return exit_code(failures, len(command.results))
