"""Clips to results: `run` for recordings, `demo` for a built-in clip."""

import json
import os
import shlex
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from hoi_retarget.cli.commands import Demo, Run
from hoi_retarget.cli.output_checks import check_json, check_stems, check_writable, write_json
from hoi_retarget.cli.run_options import arguments_of, config_of
from hoi_retarget.cli.scores import score, show_figures, titled
from hoi_retarget.cli.terminal import Working, do_for_each, exit_code, program, say, warn
from hoi_retarget.clip.edits import apply, load
from hoi_retarget.errors import ArgumentError, SolveError
from hoi_retarget.evaluation import Score, to_json
from hoi_retarget.evaluation.figure_table import scales_text
from hoi_retarget.evaluation.thresholds import by_kind, verdict_of
from hoi_retarget.files.atomic import remove
from hoi_retarget.files.source_file import SourceFile
from hoi_retarget.human.skeleton import FINGER_PARTS
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import set_aside
from hoi_retarget.readers import can_be_clip, recordings_below, why_no_clip
from hoi_retarget.readers.builtin_clips import builtin_clip
from hoi_retarget.readers.object_files import known_objects
from hoi_retarget.readers.open import open_clip, result_stem
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import result_paths, retarget_people, write
from hoi_retarget.robots import load_robot, load_team
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.skin import skin_of

_SCENE = "carry_box"
OBJECT_SURFACES = {
    "shell": "a shell, with no inside: what is within 1 mm of its surface counts as inside",
    "hull": "only points of it are known: touch and penetration are those of their convex hull",
}
"""Kind of an object's surface other than its own solid -> its meaning."""


def execute_run(command: Run) -> int:
    """Retarget every clip; return 0 when all succeeded."""
    config = config_of(command)
    models = load_team(command.robot)
    _check_clips(command.clips, command.from_robot)
    for path in command.clips:
        check_clip_kept(path, command.out)
    _check_objects(command.objects, command.object_name)
    if command.edits is not None and len(command.clips) > 1:
        raise ArgumentError(f"--edits {command.edits} is for one clip, and {len(command.clips)} are named. Name one.")
    check_writable("--out", command.out)
    check_json(command.json, command.clips)
    if config.figures == "none" and command.json is not None:
        raise ArgumentError("--figures none leaves nothing for --json to write. Leave one of them away.")
    made: dict[Path, Motion] = {}

    def run_one(path: Path) -> None:
        motions, fault = _run_clip(path, command, models, config)
        made.update(motions)
        if fault is not None:
            raise fault

    failures = do_for_each("retargeting", command.clips, run_one)
    if config.figures == "none":
        for path, motion in made.items():
            verdict = verdict_of(motion)
            say(": ".join(filter(None, (path.name, f"verdict: {verdict}", by_kind(verdict.reasons)))))
    elif made:
        say()
        scores = _show_results(made, every=command.all)
        if solved := [item for item in scores if item.file.endswith(".npz")]:
            write_json(command.json, json.loads(to_json(solved)))
        say()
    say(f"{len(command.clips) - len(failures)} solved, {len(failures)} failed.")
    return exit_code(failures, len(command.clips))


def _run_clip(
    path: Path, command: Run, models: Sequence[RobotModel], config: Config
) -> tuple[dict[Path, Motion], SolveError | None]:
    """Retarget all people of one clip, write and return their motions by file, with the error that sets them aside.

    Where there is no motion at all, results of an earlier run go, too.
    """
    start = time.process_time()
    clip = open_clip(path, command)
    if command.edits is not None:
        edits = load(command.edits)
        clip = apply(clip, edits)
        of_fingers = any(getattr(edit, "part", "") in FINGER_PARTS for edit in edits.edits)
        if of_fingers and not any(model.spec.fingers for model in models):
            warn(f"{path.name}: edits of fingers change nothing: those of {models[0].spec.name} do not move.")
    read_seconds = time.process_time() - start
    objects = ", ".join(track.name for track in clip.objects) or "none"
    people = f", {len(clip.people)} people" if len(clip.people) > 1 else ""
    begins = f", from frame {clip.first_source_frame} of the recording" if clip.first_source_frame else ""
    noun = "objects" if len(clip.objects) > 1 else "object"
    say(f"{path.name}: {clip.frames} frames at {clip.fps:g} frames/s{people}, {noun}: {objects}{begins}")
    for warning in clip.source.warnings:
        warn(f"{path.name}: {warning}")
    for model in models:
        prepare_skin(model)
    paths = result_paths(clip, result_stem(path), command.out)
    try:
        motions = retarget_people(clip, models, config, command=arguments_of(replace(command, clips=(path,))))
    except SolveError:
        remove(paths)
        raise
    made, fault = _written(motions, paths, read_seconds)
    _describe_inter_robot_hand_errors(motions[0])
    return made, fault


def _written(
    motions: Sequence[Motion], paths: Sequence[Path], read_seconds: float = 0.0
) -> tuple[dict[Path, Motion], SolveError | None]:
    """Write and describe a clip's motions; return them by file, with the error that sets them aside."""
    fault = None
    try:
        motions = write(motions, paths, read_seconds=read_seconds)
    except SolveError as error:
        fault, paths = error, [set_aside(path) for path in paths]
    for motion, path in zip(motions, paths, strict=True):
        describe_result(motion, path)
    return dict(zip(paths, motions, strict=True)), fault


def _show_results(made: Mapping[Path, Motion], *, every: bool) -> list[Score]:
    """Print verdicts and figures of motions by their files, and return the figures."""
    scores = titled([score(motion, path) for path, motion in made.items()], list(made.values()))
    show_figures(scores, every=every)
    for motion in made.values() if every else ():
        for hold in motion.report.holds:
            say(f"  hold: {hold}")
    return scores


def check_clip_kept(clip: Path, out: Path) -> None:
    """Raise `ArgumentError` when a clip's result would be written over the clip."""
    result = out / f"{result_stem(clip)}.npz"
    try:
        same = result.samefile(SourceFile(clip).clip_file)
    except (OSError, ValueError):
        return
    if same:
        raise ArgumentError(f"--out {out}: the result would be written over the clip {clip}. Choose another folder.")


@cache
def prepare_skin(model: RobotModel) -> None:
    """Compute the skin of a robot that has meshes and no skin yet, which takes long, and say so."""
    if model.spec.skin is None and any(model.geometries.meshes):
        say(f"{model.spec.name}: computing the skins of its meshes, which takes half a minute, once")
        skin_of(model)


def describe_result(motion: Motion, path: Path) -> None:
    """Print a result's file, scales and surfaces, and its warnings."""
    seconds = sum(motion.report.cpu_seconds.values())
    say(f"  {path}  ({motion.frames} frames, {seconds:.2f} s)")
    say(f"  root scale {motion.report.root_scale:.3f}, object scale {scales_text(motion.object_scale)}")
    for name, surface in motion.report.object_surfaces.items():
        if surface in OBJECT_SURFACES:
            say(f"  {name}: {OBJECT_SURFACES[surface]}")
    if motion.report.object_shift is not None:
        say(f"  {motion.report.object_shift}")
    for warning in motion.warnings:
        warn(f"{path.name}: {warning}")


def _describe_inter_robot_hand_errors(motion: Motion) -> None:
    """Print the errors of people's hands relative to each other on objects held together, which each result has."""
    pairs = motion.report.inter_robot_hand_errors
    for name in dict.fromkeys(pair.object for pair in pairs):
        held = [pair for pair in pairs if pair.object == name]
        mean = sum(pair.mean_m * pair.frames for pair in held) / sum(pair.frames for pair in held)
        say(
            f"  hands of different people on {name}: {1000 * mean:.1f} mm of wandering from each other on average, "
            f"{1000 * max(pair.max_m for pair in held):.1f} mm at most"
        )


def _check_clips(clips: Sequence[Path], robot: str | None) -> None:
    for path in clips:
        is_folder = os.path.isdir(path)  # noqa: PTH112  # raises nothing: reading shows the fault
        if is_folder and not can_be_clip(path, robot):
            below = recordings_below(path, from_robot=robot)
            hint = f"Name clips in it, such as {below[0]}, or use batch." if below else why_no_clip(path)
            raise ArgumentError(f"{path} is a folder. {hint}")
    check_stems(clips, result_stem, "to {}.npz. Run them into different folders.")


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


def execute_demo(command: Demo) -> int:
    """Retarget the built-in clip, and show commands to try next."""
    model = load_robot(command.robot)
    check_writable("--out", command.out)
    path = command.out / f"{_SCENE}.npz"
    if command.look:
        from hoi_retarget.cli.robots import fetch_look_once  # noqa: PLC0415  # `run` starts without it

        fetch_look_once(model.spec)
    clip = builtin_clip(_SCENE)
    say(f"A built-in clip: a person of {clip.people[0].height:.2f} m walks to a box, lifts it, carries it round a")
    say(f"turn and sets it down ({clip.frames} frames). Now the same by a {model.spec.title}:")
    with Working("retargeting", None):
        motions = retarget_people(clip, [model])
    made, fault = _written(motions, [path])
    say()
    _show_results(made, every=command.all)
    say()
    if fault is not None:
        raise fault
    say("All figures: --all. They are explained in docs/metrics.md. Next:")
    say(f"  {program()} view {shlex.quote(str(path))}   # see it in a browser")
    say(f"  {program()} edit builtin:{_SCENE}   # drag its contacts, and see what follows")
    say(f"  {program()} inspect {shlex.quote(str(path))}   # what the file holds")
    say(f"  {program()} sample sample   # two real recordings (downloads 102 MB)")
    say(f"  {program()} run sample/sub3_largebox_003.pt --objects sample/objects --out results")
    return 0
