"""Results as files of other programs: formats of motions, data sets, and training tasks of mjlab."""

from collections import Counter
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

from hoi_retarget.cli.commands import Export
from hoi_retarget.cli.open_results import PHYSICS_FIELDS, clip_or_warning, clip_with_objects, load_motion, physics_of
from hoi_retarget.cli.output_checks import check_inputs_kept, check_stems, check_writable
from hoi_retarget.cli.terminal import Working, do_for_each, exit_code, program, say, warn, with_file
from hoi_retarget.dynamics.feasibility import held_by_others
from hoi_retarget.dynamics.physics_scene import scene_of
from hoi_retarget.errors import ArgumentError, ClipError, HoiRetargetError
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.formats import WRITABLE, Format
from hoi_retarget.motion.formats.dataset import CARD, FOLDER
from hoi_retarget.motion.formats.isaac_lab import DATA_FILE
from hoi_retarget.motion.formats.lerobot import INFO
from hoi_retarget.motion.motion import SIMULATED, STAGE_TITLES, Motion, on_robot
from hoi_retarget.motion.result import Result
from hoi_retarget.motion.result_file import set_aside
from hoi_retarget.motion.write_export import FOLDERS, export, format_named
from hoi_retarget.robots import load_robot
from hoi_retarget.simulation.mjlab_task import NAME as TASK
from hoi_retarget.simulation.mjlab_task import RATE, check_usable, package_files, plain_name, task_of


def execute_export(command: Export) -> int:
    """Export every result; return 0 when all succeeded."""
    if command.to == TASK:
        return _export_tasks(command)
    _check_no_physics(command)
    if command.to in FOLDERS:
        return _export_dataset(command)
    format = format_named(command.to)
    targets = _targets(command, format)
    check_writable("--out", next(iter(targets.values())).parent)
    notes: dict[str, None] = {}

    def export_one(path: Path) -> None:
        result, target = _read(path, command), targets[path]
        exported = export(result, format, name=target.name, fps=command.fps, object_name=command.object_name)
        contents = {target.parent / file: content for file, content in exported.files.items()}
        check_inputs_kept("--out", contents, command.results)
        write_together(contents)
        notes.update(dict.fromkeys(exported.notes))
        say(f"{target}{format.suffix}  ({exported.frames} frames at {exported.fps:g} frames/s)")
        say(f"  licence of the source: {result.licence}")

    failures = do_for_each("exporting", targets, export_one)
    for note in notes:
        say(f"note: {note}")
    say(f"{len(targets) - len(failures)} exported, {len(failures)} failed.")
    return exit_code(failures, len(targets))


def _check_no_physics(command: Export) -> None:
    """Raise `ArgumentError` for masses and frictions, which a motion file does not hold."""
    for name in PHYSICS_FIELDS:
        if (value := getattr(command, name)) is not None:
            raise ArgumentError(
                f"--{name.replace('_', '-')} {value:g}: only {TASK} has masses and frictions. Leave the option out."
            )


def _export_dataset(command: Export) -> int:
    """Write all results into one folder, or none of them."""
    if command.object_name is not None:
        raise ArgumentError(f"--object {command.object_name}: {command.to} holds all objects. Leave the option out.")
    _check_folder(command.out)
    check_writable("--out", command.out)
    results: list[Result] = []
    with Working("exporting", len(command.results)) as working:
        for path in working.through(command.results):
            try:
                results.append(_read(path, command))
            except HoiRetargetError as error:
                raise type(error)(with_file(path, error)) from error
        counts = Counter((result.stem, result.motion.robot) for result in results)
        (stem, name), count = counts.most_common(1)[0]
        if count > 1:
            raise ArgumentError(
                f"{count} results of {name} are called {stem}; in one folder they need names of their own."
            )
        files = FOLDERS[command.to](results, command.fps)
        if there := next((name for name in files if (command.out / name).exists()), ""):
            raise ArgumentError(f"--out {command.out}: there is a {there} in it, which would be lost. Name another.")
        write_together({command.out / name: content for name, content in files.items()})
    for licence in sorted({result.licence for result in results}):
        say(f"licence of sources: {licence}")
    say(f"{len(results)} motion{'s' if len(results) > 1 else ''} in {command.out}")
    return 0


def _check_folder(folder: Path) -> None:
    """Raise `ArgumentError` when the folder holds rows or a page already."""
    if folder.is_file():
        raise ArgumentError(f"--out {folder} is a file. Motions are written into a folder: name one.")
    rows = folder / FOLDER
    others = sorted(path.name for path in rows.iterdir() if path.suffix == ".parquet") if rows.is_dir() else []
    if others:
        raise ArgumentError(f"--out {folder}: there are rows in it already ({others[0]}, ...). Name another folder.")
    if there := next((name for name in (CARD, INFO, DATA_FILE) if (folder / name).exists()), ""):
        raise ArgumentError(f"--out {folder}: there is a {there} in it, which would be lost. Name another folder.")


def _targets(command: Export, format: Format) -> dict[Path, Path]:
    """Return, for each result, the path of its export without suffix."""
    check_stems(command.results, lambda path: path.stem, "as {}. Export them one by one.")
    a_file = command.out.suffix in {known.suffix for known in WRITABLE.values()} - {""} and not command.out.is_dir()
    single = a_file and command.out.suffix == format.suffix
    if a_file and not single:
        kind = f"files that end in {format.suffix}" if format.suffix else "folders"
        raise ArgumentError(f"--out {command.out}: {format.name} motions are {kind}. Name the folder to write into.")
    if single and len(command.results) > 1:
        raise ArgumentError(
            f"--out {command.out} is one file, and {len(command.results)} results are named. Name a folder."
        )
    if not single:
        return {path: command.out / f"{path.stem}.{format.name}" for path in command.results}
    path = next(iter(command.results))
    if command.out.resolve() == path.resolve():
        raise ArgumentError(f"--out {command.out} is the result itself, which would be lost. Name another file.")
    return {path: command.out.with_suffix("")}


def _read(path: Path, command: Export) -> Result:
    """Return a result with the clip it was made from, where that is to be had."""
    motion = _motion_of(path, command)
    alone = Result(path.stem, digest_of(path), motion, load_robot(motion.robot), suffix=path.suffix)
    if motion.report.is_foreign:
        warn(f"{path.name}: who touches what is not known: no contacts are written.")
    if motion.report.is_foreign or not motion.object_names:
        return alone
    without = "contacts are written without surface normals."
    return replace(alone, clip=clip_or_warning(path, motion, command, without, surfaces=True))


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file, or of all files of a folder in the order of their names."""
    files = sorted(file for file in path.iterdir() if file.is_file()) if path.is_dir() else [path]
    return sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _motion_of(path: Path, command: Export) -> Motion:
    """Return the motion of a file after the requested stage, of the requested robot."""
    motion, stage = load_motion(path, command.robot), command.stage
    try:
        chosen = motion if stage is None else motion.at_stage(stage)
    except ArgumentError as error:
        advice = f" `{program()} refine {path}` makes it." if stage == SIMULATED else ""
        raise ArgumentError(f"--stage {stage}: {error}{advice}") from error
    return chosen if command.as_robot is None else on_robot(chosen, load_robot(command.as_robot))


def _export_tasks(command: Export) -> int:
    """Write a task for every result into one folder; return 0 when all succeeded."""
    _check_tasks(command)
    written: list[str] = []

    def export_one(path: Path) -> None:
        written.append(_export_task(path, command))

    failures = do_for_each("exporting", command.results, export_one)
    if written:
        say()
        say(f"Train with mjlab, in an environment of its own: PYTHONPATH={command.out} train {written[0]}")
    say(f"{len(written)} exported, {len(failures)} failed.")
    return exit_code(failures, len(command.results))


def _check_tasks(command: Export) -> None:
    if command.fps is not None:
        raise ArgumentError(f"--fps {command.fps:g}: a task has {RATE:g} actions a second. Leave the option out.")
    if command.object_name is not None:
        raise ArgumentError(f"--object {command.object_name}: a task has all objects. Leave the option out.")
    if command.out.exists() and not command.out.is_dir():
        raise ArgumentError(f"--out {command.out} is a file. Tasks are written into a folder; name another one.")
    check_writable("--out", command.out)
    check_stems(command.results, lambda path: plain_name(path.stem), "as task {}. Export them into two folders.")


def _export_task(path: Path, command: Export) -> str:
    """Write a task, print its facts, and return its name."""
    if path == set_aside(path.with_suffix("")):
        raise ClipError(f"{path}: it is kept to be looked at, and no result. Export the one it was to become.")
    motion = _motion_of(path, command)
    check_usable(motion)
    physics, clip = physics_of(motion, command), clip_with_objects(motion, command)
    if clip is not None and held_by_others(clip, motion.person).any():
        raise ClipError(f"{path}: somebody else handles its objects too, and one robot alone is trained.")
    model = load_robot(motion.robot)
    scene = scene_of(motion, model, () if clip is None else clip.objects, physics)
    result = Result(path.stem, digest_of(path), motion, model, clip, path.suffix)
    task = task_of(result, scene)
    contents = {command.out / place: content for place, content in {**package_files(), **task.files}.items()}
    check_inputs_kept("--out", contents, command.results)
    write_together(contents)
    stage = motion.stages[-1].name
    say(f"{task.id}  ({task.frames} frames at {RATE:g} frames/s: {STAGE_TITLES.get(stage, stage)})")
    for item in scene.objects:
        say(f"  object  {item.body.name}: {item.body.mass:.2f} kg ({item.body.reason}), collides as {item.shape.text}")
    say(f"  licence of the source: {result.licence}")
    return task.id
