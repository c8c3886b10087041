"""`hoi-retarget run`: recorded clips to result files."""

import json
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hoi_retarget.cli.commands import Run
from hoi_retarget.cli.figures import show_figures
from hoi_retarget.cli.jobs import (
    check_json,
    check_spared,
    check_stems,
    check_writable,
    config_of,
    describe_result,
    do_for_each,
    exit_code,
    prepare_skin,
    score,
    write_json,
)
from hoi_retarget.cli.run_arguments import settings_of
from hoi_retarget.cli.terminal import say, warn
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import apply, load
from hoi_retarget.errors import ArgumentError
from hoi_retarget.evaluation import Score, to_json
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers import can_be_clip, recordings_below, why_no_clip
from hoi_retarget.readers.object_files import known_objects
from hoi_retarget.readers.open import open_clip, result_stem
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.multi_person import result_paths, retarget_people, write
from hoi_retarget.robots import load_team
from hoi_retarget.robots.model import RobotModel


def execute(command: Run) -> int:
    """Retarget every clip; return 0 when all succeeded."""
    config = config_of(command)
    models = load_team(command.robot)
    _check_clips(command.clips)
    for path in command.clips:
        check_spared(path, command.out)
    _check_objects(command.objects, command.object_name)
    if command.edits is not None and len(command.clips) > 1:
        raise ArgumentError(f"--edits {command.edits} is for one clip, and {len(command.clips)} are named. Name one.")
    check_writable("--out", command.out)
    check_json(command.json, command.clips)
    scores: list[Score] = []

    def run_one(path: Path) -> None:
        motions = _run_clip(path, command, models, config)
        scores.extend(score(motion, out) for out, motion in motions.items())

    failures = do_for_each("retargeting", command.clips, run_one)
    if scores:
        say()
        show_figures(scores)
        write_json(command.json, json.loads(to_json(scores)))
        say()
    say(f"{len(command.clips) - len(failures)} solved, {len(failures)} failed.")
    return exit_code(failures, len(command.clips))


def _run_clip(path: Path, command: Run, models: Sequence[RobotModel], config: Config) -> dict[Path, Motion]:
    """Retarget all people of one clip, then write their results; return what is where."""
    start = time.process_time()
    clip = open_clip(path, command)
    if command.edits is not None:
        clip = apply(clip, load(command.edits))
    read_seconds = time.process_time() - start
    _describe_clip(path, clip)
    for warning in clip.source.warnings:
        warn(f"{path.name}: {warning}")
    for model in models:
        prepare_skin(model)
    motions = retarget_people(clip, models, config, command=settings_of(replace(command, clips=(path,))))
    paths = result_paths(clip, result_stem(path), command.out)
    motions = write(motions, paths, read_seconds=read_seconds)
    for motion, out in zip(motions, paths, strict=True):
        describe_result(motion, out)
    _describe_inter_robot_hand_errors(motions[0])
    return dict(zip(paths, motions, strict=True))


def _describe_inter_robot_hand_errors(motion: Motion) -> None:
    """Print how people's hands are placed on what they hold together, which each of their results tells."""
    pairs = motion.report.inter_robot_hand_errors
    for name in dict.fromkeys(pair.object for pair in pairs):
        held = [pair for pair in pairs if pair.object == name]
        mean = sum(pair.mean_m * pair.frames for pair in held) / sum(pair.frames for pair in held)
        say(
            f"  hands of different people on {name}: {1000 * mean:.1f} mm from their place relative to each other on "
            f"average, {1000 * max(pair.max_m for pair in held):.1f} mm at most"
        )


def _check_clips(clips: Sequence[Path]) -> None:
    for path in clips:
        if _is_folder(path) and not can_be_clip(path):
            below = recordings_below(path)
            hint = f"Name clips in it, such as {below[0]}, or use batch." if below else why_no_clip(path)
            raise ArgumentError(f"{path} is a folder. {hint}")
    check_stems(clips, result_stem, "to {}.npz. Run them into different folders.")


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except OSError:
        return False  # Reading it will tell what is wrong.


def _check_objects(folder: Path | None, name: str | None) -> None:
    if folder is None:
        return
    try:
        exists, known = folder.is_dir(), known_objects(folder)
    except OSError as error:
        raise ArgumentError(
            f"--objects {folder}: cannot be read ({error.strerror or error}). Check its permissions."
        ) from error
    if not exists:
        raise ArgumentError(f"--objects {folder}: there is no such folder. Name one with <object>/<object>.obj in it.")
    if name is not None and name not in known:
        listing = f"Objects there: {', '.join(known)}." if known else "There are no objects in it."
        raise ArgumentError(f"--object {name}: {folder} has no geometry of that name. {listing}")


def _describe_clip(path: Path, clip: Clip) -> None:
    objects = ", ".join(track.name for track in clip.objects) or "none"
    people = f", {len(clip.people)} people" if len(clip.people) > 1 else ""
    begins = f", from frame {clip.first_source_frame} of the recording" if clip.first_source_frame else ""
    noun = "objects" if len(clip.objects) > 1 else "object"
    say(f"{path.name}: {clip.frames} frames at {clip.fps:g} frames/s{people}, {noun}: {objects}{begins}")
