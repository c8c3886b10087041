"""The stage after the trajectory: a result performed by a simulated robot, with its figures and its certificate."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.evaluation import evaluate
from hoi_retarget.evaluation.performed import performed_figures
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.motion import SIMULATED, Motion
from hoi_retarget.motion.performance import Performance
from hoi_retarget.motion.result_file import encode, set_aside
from hoi_retarget.physics.certificate import certificate_of
from hoi_retarget.physics.feasibility import forces_on_clip, held_by_others, shortcomings
from hoi_retarget.physics.performed import performed_file, performed_motion, why_it_fell
from hoi_retarget.physics.reference import Reference, held_firmly, reference_of
from hoi_retarget.physics.refine import Progress, refine
from hoi_retarget.physics.rollout import Rollout
from hoi_retarget.physics.scene import Scene, scene_of
from hoi_retarget.physics.settings import Physics, Refinement
from hoi_retarget.robots import load_robot

FOR_CONTROLLERS = "physics"
"""Folder beside results with files of their names."""


@dataclass(frozen=True, eq=False)
class Performed:
    """A result after its last stage, whole or up to a fall."""

    motion: Motion
    for_controllers: bytes
    """Content of the file with targets and gains."""
    scene: Scene
    reference: Reference
    rollout: Rollout
    performance: Performance


def perform(  # noqa: PLR0913 - the last three are options
    motion: Motion,
    clip: Clip | None,
    physics: Physics,
    settings: Refinement = Refinement(),
    *,
    seed: int = 0,
    on_progress: Callable[[Progress, Reference], None] = lambda _progress, _reference: None,
) -> Performed:
    """Return a result with one more stage, in which a simulated robot performs it, and what a controller needs.

    Args:
        motion: The result; its last stage is what is to be performed.
        clip: What it was made from, which knows its objects' shapes; None for a motion without objects.
        physics: Masses and frictions.
        settings: How much is tried.
        seed: Of the random numbers.
        on_progress: Is called after every plan, with what is followed.

    Raises:
        ArgumentError: It is performed already.
        ClipError: It has one frame, or somebody else handles its objects too.
        RobotError: A base carries the robot, or a joint's torque has no limit.
        GeometryError: An object's mesh cannot be read.
    """
    _check(motion, clip)
    start = time.process_time()
    model = load_robot(motion.robot)
    geometries = [] if clip is None else [track.geometry for track in clip.objects]
    scene = scene_of(motion, model, geometries, physics)
    forces = forces_on_clip(motion, clip, model, physics)
    reference = reference_of(scene, motion, forces_on_clip(motion, clip, model, held_firmly(physics)))
    refined = refine(
        scene, reference, settings, seed=seed, on_progress=lambda progress: on_progress(progress, reference)
    )
    rollout = refined.rollout
    fell = rollout.fell_after is not None
    performance = Performance(
        rollout.seconds,
        fell,
        why_it_fell(scene, reference, rollout, motion.fps, shortcomings(forces, motion)) if fell else "",
        None if fell else certificate_of(scene, rollout, refined.gains),
        refined.let_go_after,
    )
    content = performed_file(motion, scene, refined, performance, settings=settings, seed=seed)
    seconds = {**motion.report.cpu_seconds, SIMULATED: time.process_time() - start}
    performed = performed_motion(motion, scene, rollout)
    performed = replace(performed, report=replace(performed.report, performance=performance, cpu_seconds=seconds))
    if fell or clip is None:
        figures = performed_figures(performed)
    else:
        figures = evaluate(performed, clip, model, person=motion.person)
    performed = replace(performed, report=replace(performed.report, figures=figures))
    return Performed(performed, content, scene, reference, rollout, performance)


def write_performed(performed: Performed, place: Path) -> tuple[Path, Path]:
    """Write a performed result to a path, or beside it where it fell, and the file for controllers.

    What an earlier attempt left in the other place is removed. Returns both paths; raises `WriteError`.
    """
    aside = set_aside(place)
    kept, outdated = (aside, place) if performed.performance.fell else (place, aside)
    for_controllers = place.parent / FOR_CONTROLLERS / place.name
    write_together({kept: encode(performed.motion), for_controllers: performed.for_controllers})
    outdated.unlink(missing_ok=True)
    return kept, for_controllers


def _check(motion: Motion, clip: Clip | None) -> None:
    if any(stage.name == SIMULATED for stage in motion.stages):
        raise ArgumentError("it is refined already. Name the result that it was made from.")
    if motion.frames == 1:
        raise ClipError("it has one frame, which is no motion.")
    if clip is not None and held_by_others(clip, motion.person).any():
        raise ClipError("somebody else handles its objects too, and one robot alone is simulated.")
