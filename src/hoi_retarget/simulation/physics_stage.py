"""The physics stage after the trajectory: a result performed by a simulated robot, with figures and certificate."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from hoi_retarget.clip.clip import Clip
from hoi_retarget.dynamics.feasibility import forces_on_clip, held_by_others, infeasibilities
from hoi_retarget.dynamics.physics_scene import PhysicsScene, scene_of
from hoi_retarget.dynamics.physics_settings import Physics, Refinement
from hoi_retarget.errors import ArgumentError, ClipError, SolveError
from hoi_retarget.evaluation import evaluate
from hoi_retarget.evaluation.physics_figures import performed_figures
from hoi_retarget.evaluation.thresholds import fatal_fault
from hoi_retarget.files.atomic import remove, write_together
from hoi_retarget.motion.motion import SIMULATED, Motion
from hoi_retarget.motion.performance import Performance
from hoi_retarget.motion.result_file import encode, set_aside
from hoi_retarget.robots import load_robot
from hoi_retarget.simulation.certificate import certificate_of
from hoi_retarget.simulation.refine import Progress, refine
from hoi_retarget.simulation.rollout import Reference, Rollout, reference_of, with_weaker_grip
from hoi_retarget.simulation.tracking_result import controller_file, simulated_motion, why_it_fell

FOR_CONTROLLERS = "physics"
"""Folder beside results with files of their names."""


@dataclass(frozen=True, eq=False)
class SimulatedMotion:
    """A result with the physics stage, whole or up to a fall."""

    motion: Motion
    for_controllers: bytes
    """Content of the file with targets and gains."""
    scene: PhysicsScene
    reference: Reference
    rollout: Rollout
    performance: Performance


def add_physics_stage(  # noqa: PLR0913  # the last three are options
    motion: Motion,
    clip: Clip | None,
    physics: Physics,
    settings: Refinement = Refinement(),
    *,
    seed: int = 0,
    on_progress: Callable[[Progress, Reference], None] = lambda _progress, _reference: None,
) -> SimulatedMotion:
    """Return a result with one more stage, in which a simulated robot performs it, and the file for controllers.

    Args:
        motion: The result; its last stage is the reference.
        clip: Its clip, for the objects' shapes; None for a motion without objects.
        physics: Masses and frictions.
        settings: Samples and iterations of the search.
        seed: Of the random numbers.
        on_progress: Is called after every plan, with the reference.

    Raises:
        ArgumentError: It is refined already.
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
    reference = reference_of(scene, motion, forces_on_clip(motion, clip, model, with_weaker_grip(physics)))
    refined = refine(
        scene, reference, settings, seed=seed, on_progress=lambda progress: on_progress(progress, reference)
    )
    rollout = refined.rollout
    fell = rollout.fell_after is not None
    performance = Performance(
        rollout.seconds,
        fell,
        why_it_fell(scene, reference, rollout, motion.fps, infeasibilities(forces, motion)) if fell else "",
        None if fell else certificate_of(scene, rollout, refined.gains),
        refined.object_cost_relaxed_after,
    )
    content = controller_file(motion, scene, refined, performance, settings=settings, seed=seed)
    seconds = {**motion.report.cpu_seconds, SIMULATED: time.process_time() - start}
    simulated = simulated_motion(motion, scene, rollout)
    simulated = replace(simulated, report=replace(simulated.report, performance=performance, cpu_seconds=seconds))
    if fell or clip is None:
        figures = performed_figures(simulated)
    else:
        figures = evaluate(simulated, clip, model, person=motion.person)
    simulated = replace(simulated, report=replace(simulated.report, figures=figures))
    return SimulatedMotion(simulated, content, scene, reference, rollout, performance)


def write_simulated(simulated: SimulatedMotion, place: Path) -> tuple[Path, Path]:
    """Write a result to a path, or beside it where the robot fell, and the file for controllers; return both paths.

    A file of an earlier attempt in the other place is removed.

    Raises:
        SolveError: The robot stands, but the verdict on the motion has a fatal reason. It is beside the path, too.
        WriteError: A file cannot be written.
    """
    aside, fault = set_aside(place), fatal_fault(simulated.motion)
    kept, outdated = (aside, place) if fault or simulated.performance.fell else (place, aside)
    for_controllers = place.parent / FOR_CONTROLLERS / place.name
    write_together({kept: encode(simulated.motion), for_controllers: simulated.for_controllers})
    remove([outdated])
    if fault and not simulated.performance.fell:
        raise SolveError(f"{fault} To look at, not to use: {aside.name}.")
    return kept, for_controllers


def _check(motion: Motion, clip: Clip | None) -> None:
    if any(stage.name == SIMULATED for stage in motion.stages):
        raise ArgumentError("it is refined already. Name the result that it was made from.")
    if motion.frames == 1:
        raise ClipError("it has one frame, which is no motion.")
    if clip is not None and held_by_others(clip, motion.person).any():
        raise ClipError("somebody else handles its objects too, and one robot alone is simulated.")
