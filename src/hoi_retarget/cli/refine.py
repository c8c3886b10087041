"""`hoi-retarget refine`: results made into motions that a simulated robot performs."""

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hoi_retarget.cli.commands import Refine
from hoi_retarget.cli.jobs import (
    check_inputs_kept,
    check_stems,
    check_writable,
    exit_code,
    load_motion,
    with_file,
)
from hoi_retarget.cli.terminal import Working, fail, say, show_table, warn
from hoi_retarget.cli.weighed import clip_with_objects, physics_of
from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError, ClipError, HoiRetargetError
from hoi_retarget.evaluation import evaluate
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.motion import SIMULATED, Motion
from hoi_retarget.motion.result_file import encode, set_aside
from hoi_retarget.physics.feasibility import forces_on_clip, held_by_others, shortcomings
from hoi_retarget.physics.performed import performed_file, performed_motion, why_it_fell
from hoi_retarget.physics.reference import reference_of
from hoi_retarget.physics.refine import Progress, refine
from hoi_retarget.physics.rollout import base_errors_deg, object_errors
from hoi_retarget.physics.scene import Scene, scene_of
from hoi_retarget.robots import load_robot

_HEADER = ("result", "whole", "performed [s]", "of [s]", "object [cm]", "base [cm]", "base [deg]", "CPU [s]")


@dataclass(frozen=True, eq=False)
class _Task:
    """A result that is to be refined."""

    motion: Motion
    clip: Clip | None
    scene: Scene


def execute(command: Refine) -> int:
    """Refine every result; return 0 when all were performed whole."""
    check_writable("--out", command.out)
    check_stems(command.results, lambda path: path.stem, f"{command.out}/{{}}.npz. Refine them one after the other.")
    written = [command.out / folder / f"{path.stem}.npz" for path in command.results for folder in ("", "physics")]
    check_inputs_kept("--out", written, command.results)
    rows: list[tuple[str, ...]] = []
    failures: list[HoiRetargetError] = []
    fallen = 0
    with Working("refining", len(command.results)) as working:
        for path in working.through(command.results):
            try:
                row = _refined(path, command, working)
            except HoiRetargetError as error:
                failures.append(error)
                fail(with_file(path, error))
                continue
            rows.append(row)
            fallen += row[1] == "no"
    if rows:
        say()
        show_table([_HEADER, *rows], words=(0, 1))
        say()
    say(f"{len(rows) - fallen} performed whole, {fallen} fell, {len(failures)} failed.")
    return exit_code(failures, len(command.results)) or int(fallen > 0)


def _refined(path: Path, command: Refine, working: Working) -> tuple[str, ...]:
    """Refine one result, write what comes of it, and return its row of the table."""
    task = _task(path, command)
    motion, scene = task.motion, task.scene
    start = time.process_time()
    forces = forces_on_clip(motion, task.clip, scene.model, scene.physics)
    reference = reference_of(scene, motion, forces)

    def tell(progress: Progress) -> None:
        working.describe(
            f"{path.name}: {progress.seconds:.1f} of {reference.seconds:.1f} s, cost {progress.cost:.2f}, "
            f"{progress.samples} samples"
        )

    refined = refine(scene, reference, command.refinement, seed=command.seed, on_progress=tell)
    rollout, cpu = refined.rollout, time.process_time() - start
    fell = rollout.fell_after is not None
    found = shortcomings(forces, motion)
    cause = why_it_fell(scene, reference, rollout, motion.fps, found) if fell else ""
    performed = _with_figures(performed_motion(motion, scene, rollout), task, cpu, whole=not fell)
    place = command.out / f"{path.stem}.npz"
    kept = set_aside(place) if fell else place
    for_controllers = command.out / "physics" / place.name
    content = performed_file(motion, scene, refined, settings=command.refinement, seed=command.seed, cause=cause)
    write_together({kept: encode(performed), for_controllers: content})
    if fell:
        place.unlink(missing_ok=True)  # Of an earlier refinement, which performed it whole: not this one.
        warn(f"{path.name}: falls in frame {performed.frames} of {motion.frames}: {cause}.")
    else:
        set_aside(place).unlink(missing_ok=True)
    say(f"  {kept}  ({performed.frames} frames, {cpu:.0f} s of CPU; for controllers: {for_controllers})")
    errors = object_errors(rollout, reference, scene.model.n)
    base = np.linalg.norm(rollout.qpos[:, :3] - reference.qpos[: len(rollout.qpos), :3], axis=1)
    return (
        *(path.stem, "no" if fell else "yes", f"{rollout.seconds:.1f}", f"{reference.seconds:.1f}"),
        f"{100 * errors.mean():.1f}" if errors.size else "-",
        *(f"{100 * base.mean():.1f}", f"{base_errors_deg(rollout, reference).mean():.1f}", f"{cpu:.0f}"),
    )


def _task(path: Path, command: Refine) -> _Task:
    motion = load_motion(path, command.robot)
    if any(stage.name == SIMULATED for stage in motion.stages):
        raise ArgumentError(f"{path}: it is refined already. Name the result that it was made from.")
    if motion.frames == 1:
        raise ClipError(f"{path}: it has one frame, which is no motion.")
    physics, clip = physics_of(motion, command), clip_with_objects(motion, command)
    if clip is not None and held_by_others(clip, motion.person).any():
        raise ClipError(f"{path}: somebody else handles its objects too, and one robot alone is simulated.")
    geometries = [] if clip is None else [track.geometry for track in clip.objects]
    return _Task(motion, clip, scene_of(motion, load_robot(motion.robot), geometries, physics))


def _with_figures(performed: Motion, task: _Task, cpu: float, *, whole: bool) -> Motion:
    """Return a performed motion with its figures, which only a whole one has."""
    figures = {}
    if whole and task.clip is not None:
        figures = evaluate(performed, task.clip, task.scene.model, person=performed.person)
    seconds = {**performed.report.cpu_seconds, SIMULATED: cpu}
    return replace(performed, report=replace(performed.report, figures=figures, cpu_seconds=seconds))
