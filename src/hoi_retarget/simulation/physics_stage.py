"""The physics stage after the trajectory: a result performed by a simulated robot, with figures and certificate."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from operator import itemgetter
from pathlib import Path

import numpy as np

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
from hoi_retarget.motion.performance import STRICT_SHARE, Certificate, Performance
from hoi_retarget.motion.result_file import encode, set_aside
from hoi_retarget.robots import load_robot
from hoi_retarget.simulation.approach import with_approaches, with_steady_contacts
from hoi_retarget.simulation.certificate import certificate_of
from hoi_retarget.simulation.control import EFFORTS, rollout_gains
from hoi_retarget.simulation.object_hold import ObjectHold, object_holds, up_to
from hoi_retarget.simulation.refine import Progress, Refined, refine
from hoi_retarget.simulation.rollout import Reference, Rollout, reference_of, with_weaker_grip
from hoi_retarget.simulation.tracking_result import controller_file, simulated_motion, why_it_ended

FOR_CONTROLLERS = "physics"  # Folder beside results with files of their names.
SEEN_SECONDS = 1.0  # After the loss of an object, in which causes are looked for.


@dataclass(frozen=True, eq=False)
class SimulatedMotion:
    """A result with the physics stage, whole or up to a fall or the loss of an object."""

    motion: Motion
    for_controllers: bytes  # Content of the file with targets and gains.
    scene: PhysicsScene
    reference: Reference
    rollout: Rollout  # Up to the end or a fall, beyond the loss of an object.
    holds: tuple[ObjectHold, ...]
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

    Args: `motion`: the result; its last stage is the reference; `clip`: its clip, for the objects' shapes; None for a
    motion without objects; `physics`: masses and frictions; `settings`: samples and iterations of the search; `seed`:
    of the random numbers; of a second attempt's, one more; `on_progress`: is called after every plan, with the
    reference. Raises `ArgumentError`: it is refined already; `ClipError`: it has one frame or parts on joints, or
    somebody else handles its objects too; `RobotError`: a base carries the robot, or a joint's torque has no limit;
    `GeometryError`: an object's mesh cannot be read.
    """
    _check(motion, clip)
    start = time.process_time()
    model, tracks = load_robot(motion.robot), () if clip is None else clip.objects
    scene = scene_of(motion, model, tracks, physics)
    forces = forces_on_clip(motion, clip, model, physics)
    steady = with_steady_contacts(motion)
    firm = forces_on_clip(steady, clip, model, with_weaker_grip(physics))
    reference = with_approaches(scene, reference_of(scene, steady, firm), [track.geometry for track in tracks])
    ended, refined, seed = _best_attempt(scene, reference, settings, seed, lambda now: on_progress(now, reference))
    holds = object_holds(reference, refined.rollout, model.n)
    simulated, fell, lost = refined.rollout, refined.rollout.fell_after is not None, False
    seen = simulated  # In which causes are looked for.
    if ended < inf and not fell:
        rollout, lost, seen = up_to(simulated, ended), True, up_to(simulated, ended + SEEN_SECONDS)
        refined = replace(refined, rollout=rollout, gains=refined.gains[: len(rollout.qpos)], lead_out=None)
    rollout = refined.rollout
    certificate = None
    if not fell and not lost:
        certificate, gains = _certified(scene, rollout, refined.gains)
        refined = replace(refined, gains=gains)
    missing = infeasibilities(forces, motion)
    performance = Performance(
        rollout.seconds,
        fell,
        why_it_ended(scene, reference, seen, motion.fps, missing) if fell or lost else "",
        certificate,
        lost,
        min((hold.kept_share for hold in holds), default=None),
    )
    content = controller_file(motion, scene, refined, performance, settings=settings, seed=seed)
    seconds = {**motion.report.cpu_seconds, SIMULATED: time.process_time() - start}
    performed = simulated_motion(motion, scene, rollout)
    performed = replace(performed, report=replace(performed.report, performance=performance, cpu_seconds=seconds))
    if not performance.whole or clip is None:
        figures = performed_figures(performed)
    else:
        figures = evaluate(performed, clip, model, person=motion.person)
    performed = replace(performed, report=replace(performed.report, figures=figures))
    return SimulatedMotion(performed, content, scene, reference, simulated, holds, performance)


def write_simulated(simulated: SimulatedMotion, place: Path) -> tuple[Path, Path]:
    """Write a result to a path, or beside it where it is not whole, and the file for controllers; return both paths.

    A file of an earlier attempt in the other place is removed.

    Raises `SolveError`: it is whole, but the verdict on the motion has a fatal reason. It is beside the path, too;
    `WriteError`: a file cannot be written.
    """
    aside, fault = set_aside(place), fatal_fault(simulated.motion)
    kept, outdated = (aside, place) if fault or not simulated.performance.whole else (place, aside)
    for_controllers = place.parent / FOR_CONTROLLERS / place.name
    write_together({kept: encode(simulated.motion), for_controllers: simulated.for_controllers})
    remove([outdated])
    if fault and simulated.performance.whole:
        raise SolveError(f"{fault} To look at, not to use: {aside.name}.")
    return kept, for_controllers


def _best_attempt(
    scene: PhysicsScene, reference: Reference, settings: Refinement, seed: int, on_progress: Callable[[Progress], None]
) -> tuple[float, Refined, int]:
    """Return the attempt with the latest fall or loss, its time [s], infinite without, and its seed.

    Of several without, it is that with objects near their paths for longest; held strictly, they are not tried again.
    """
    found: list[tuple[tuple[float, float], Refined, int]] = []
    for own in range(seed, seed + settings.attempts):
        refined = refine(scene, reference, settings, seed=own, on_progress=on_progress)
        holds = object_holds(reference, refined.rollout, scene.model.n)
        ends = (refined.rollout.fell_after, *(hold.lost_after for hold in holds))
        ended = min((end for end in ends if end is not None), default=inf)
        kept = min((hold.kept_share for hold in holds), default=1.0)
        found.append(((ended, kept), refined, own))
        if ended == inf and kept >= STRICT_SHARE:
            break
    (ended, _), refined, own = max(found, key=itemgetter(0))
    return ended, refined, own


def _certified(scene: PhysicsScene, rollout: Rollout, gains: np.ndarray) -> tuple[Certificate, np.ndarray]:
    """Return the certificate and the gains of a motion: calmer feedback where more replays keep to it then."""
    usual = certificate_of(scene, rollout, gains)
    if usual.passed:
        return usual, gains
    calmer_gains = rollout_gains(scene, rollout, EFFORTS[1])
    calmer = certificate_of(scene, rollout, calmer_gains)
    return (calmer, calmer_gains) if calmer.kept > usual.kept else (usual, gains)


def _check(motion: Motion, clip: Clip | None) -> None:
    if any(stage.name == SIMULATED for stage in motion.stages):
        raise ArgumentError("it is refined already. Name the result that it was made from.")
    if motion.frames == 1:
        raise ClipError("it has one frame, which is no motion.")
    if clip is not None and held_by_others(clip, motion.person).any():
        raise ClipError("somebody else handles its objects too, and one robot alone is simulated.")
    if clip is not None and any(track.joint is not None for track in clip.objects):
        raise ClipError("it has parts on joints, which are not refined yet; `scene` and `export --to mjlab-task` do.")
