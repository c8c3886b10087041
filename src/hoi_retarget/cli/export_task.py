"""`hoi-retarget export --to mjlab-task`: results as tasks that mjlab trains."""

from dataclasses import dataclass
from pathlib import Path

from hoi_retarget.cli.commands import Export
from hoi_retarget.cli.jobs import (
    at_stage,
    check_inputs_kept,
    check_stems,
    check_writable,
    digest_of,
    do_for_each,
    exit_code,
    load_motion,
)
from hoi_retarget.cli.terminal import say
from hoi_retarget.cli.weighed import clip_with_objects, physics_of
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.motion import STAGE_TITLES
from hoi_retarget.motion.result import Result
from hoi_retarget.motion.result_file import set_aside
from hoi_retarget.physics.feasibility import held_by_others
from hoi_retarget.physics.mjlab_task import RATE, check_usable, package_files, plain_name, task_of
from hoi_retarget.physics.scene import Scene, scene_of
from hoi_retarget.robots import load_robot


@dataclass(frozen=True, eq=False)
class _Exported:
    """A task that was written."""

    id: str
    frames: int
    result: Result
    scene: Scene


def export_tasks(command: Export) -> int:
    """Write a task for every result into one folder; return 0 when all succeeded."""
    _check(command)
    written: list[_Exported] = []

    def export_one(path: Path) -> None:
        written.append(_export(path, command))

    failures = do_for_each("exporting", command.results, export_one)
    for item in written:
        _tell(item)
    if written:
        say()
        say(f"Train with mjlab, in an environment of its own: PYTHONPATH={command.out} train {written[0].id}")
    say(f"{len(written)} exported, {len(failures)} failed.")
    return exit_code(failures, len(command.results))


def _check(command: Export) -> None:
    if command.fps is not None:
        raise ArgumentError(f"--fps {command.fps:g}: a task has {RATE:g} actions a second. Leave the option out.")
    if command.object_name is not None:
        raise ArgumentError(f"--object {command.object_name}: a task has all objects. Leave the option out.")
    if command.out.exists() and not command.out.is_dir():
        raise ArgumentError(f"--out {command.out} is a file. Tasks are written into a folder; name another one.")
    check_writable("--out", command.out)
    check_stems(command.results, lambda path: plain_name(path.stem), "as task {}. Export them into two folders.")


def _export(path: Path, command: Export) -> _Exported:
    if path == set_aside(path.with_suffix("")):
        raise ClipError(f"{path}: it is kept to be looked at, and no result. Export the one it was to become.")
    motion = at_stage(load_motion(path, command.robot), path, command.stage)
    check_usable(motion)
    physics, clip = physics_of(motion, command), clip_with_objects(motion, command)
    if clip is not None and held_by_others(clip, motion.person).any():
        raise ClipError(f"{path}: somebody else handles its objects too, and one robot alone is trained.")
    model = load_robot(motion.robot)
    geometries = [] if clip is None else [track.geometry for track in clip.objects]
    scene = scene_of(motion, model, geometries, physics)
    result = Result(path.stem, digest_of(path), motion, model, clip, path.suffix)
    task = task_of(result, scene)
    contents = {command.out / place: content for place, content in {**package_files(), **task.files}.items()}
    check_inputs_kept("--out", contents, command.results)
    write_together(contents)
    return _Exported(task.id, task.frames, result, scene)


def _tell(item: _Exported) -> None:
    stage = item.result.motion.stages[-1].name
    say(f"{item.id}  ({item.frames} frames at {RATE:g} frames/s: {STAGE_TITLES.get(stage, stage)})")
    for thing in item.scene.objects:
        mass = f"{thing.body.mass:.2f} kg ({thing.body.reason})"
        say(f"  object  {thing.body.name}: {mass}, collides as {thing.shape.text}")
    say(f"  licence of the source: {item.result.licence}")
