"""A clip's motions with their figures: solved, judged, and written to result files."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hoi_retarget import evaluation
from hoi_retarget.clip.clip import Clip
from hoi_retarget.dynamics.physics_settings import FigureSet
from hoi_retarget.errors import ArgumentError, SolveError
from hoi_retarget.evaluation.surface_distances import surface_kind
from hoi_retarget.evaluation.thresholds import fatal_fault
from hoi_retarget.files.atomic import remove, write_together
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import encode, set_aside
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.robot_separation import separate_robots
from hoi_retarget.retargeting.solve import Solution, one_thread, solve
from hoi_retarget.retargeting.targets import shared_scalings
from hoi_retarget.robots.model import RobotModel


def retarget(clip: Clip, model: RobotModel, config: Config = Config(), *, person: int = 0) -> Motion:
    """Return the motion of one robot for one person of a clip, with its figures in the report.

    Raises `SolveError` where a window ends without a usable trajectory.

    `clip`: the recording; `model`: the robot; `config`: scales, weights, solvers, figures; `person`: index of the
    person that the robot follows.
    """
    return judge(solve(clip, model, config, person=person), config.figures)


def judge(solution: Solution, figures: FigureSet = "all") -> Motion:
    """Return the motion of a solution with its figures, unreached contacts and sunk links in the report.

    Without the figures of surfaces, contacts between surfaces and sunk links are not judged. Contacts asked in thin
    air always are: they are the clip's.

    Raises `GeometryError` when an object's mesh cannot be read.
    """
    in_air = evaluation.thin_air_contacts(solution.clip, solution.person)
    solution = replace(solution, motion=solution.motion.with_report(thin_air_contacts=in_air))
    if figures == "none":
        return solution.motion
    with one_thread():
        return _judged(solution, complete=figures == "all")


def _judged(solution: Solution, *, complete: bool) -> Motion:
    start = time.process_time()
    motion, clip, kinematics = solution.motion, solution.clip, solution.kinematics
    view = evaluation.Comparison(motion, clip, solution.person, kinematics)
    surfaces = motion.report.touches_with_surfaces
    found: dict[str, Any] = {"figures": evaluation.figures_of(view, "all" if complete else "fast")}
    if complete or not surfaces:
        residuals = evaluation.surface_residuals(view) if surfaces else None
        found["unreached_contacts"] = evaluation.unreached_contacts(motion, kinematics, residuals=residuals)
    if complete:
        found["sunk_links"] = evaluation.sunk_links(view) if surfaces else ()
        found["object_surfaces"] = {track.name: surface_kind(track.geometry) for track in clip.objects}
    seconds = {**motion.report.cpu_seconds, "metrics": time.process_time() - start}
    return motion.with_report(**found, cpu_seconds=seconds)


def judge_team(solutions: Sequence[Solution], figures: FigureSet = "all") -> tuple[Motion, ...]:
    """Return the judged motions of all people of a clip; reports also name penetrations between robots."""
    motions = tuple(judge(solution, figures) for solution in solutions)
    if figures == "none":
        return motions
    models = [solution.model for solution in solutions]
    errors = evaluation.inter_robot_hand_errors(motions, models)
    penetrations, depths = evaluation.inter_robot_penetrations(motions, models)
    return tuple(
        motion.with_report(
            figures={**motion.report.figures, "robot_penetration_max_m": depth},
            inter_robot_hand_errors=errors,
            inter_robot_penetrations=penetrations,
        )
        for motion, depth in zip(motions, depths, strict=True)
    )


def solve_people(clip: Clip, models: Sequence[RobotModel], config: Config = Config()) -> tuple[Solution, ...]:
    """Return one solution per person of a clip, in one world with the same objects, robots outside each other.

    `models` are one robot for all people, or one for each. Raises `ArgumentError`: there are other numbers of robots
    and people; `SolveError`: a window ends without a usable trajectory.
    """
    people = len(clip.people)
    if len(models) not in (1, people):
        raise ArgumentError(
            f"{len(models)} robots are named for the {people} {'people' if people > 1 else 'person'} of {clip.name}. "
            "Name one robot for all, or one for each."
        )
    team = tuple(models) * (people if len(models) == 1 else 1)
    solutions = [
        solve(clip, model, replace(config, scaling=scaling), person=person)
        for person, (model, scaling) in enumerate(zip(team, shared_scalings(clip, team, config.scaling), strict=True))
    ]
    return separate_robots(solutions, config)


def retarget_people(
    clip: Clip, models: Sequence[RobotModel], config: Config = Config(), *, command: Mapping[str, Any] | None = None
) -> tuple[Motion, ...]:
    """Return one motion per person of a clip, in one world with the same objects, robots outside each other.

    `clip`: the recording; `models`: one robot for all people, or one for each; `config`: scales, weights, solvers,
    figures; `command`: how the clip was called and read, for the reports. Raises `ArgumentError`: there are other
    numbers of robots and people; `SolveError`: a window ends without a usable trajectory.
    """
    motions = judge_team(solve_people(clip, models, config), config.figures)
    # Scalings that make different robots share one world follow from those of the configuration.
    stated = {"config": config.as_json(), "command": command or {}}
    return tuple(motion.with_report(**stated) for motion in motions)


def result_paths(clip: Clip, stem: str, out: Path) -> tuple[Path, ...]:
    """Return one result path per person of a clip."""
    if len(clip.people) == 1:
        return (out / f"{stem}.npz",)
    return tuple(out / f"{stem}.p{person}.npz" for person in range(len(clip.people)))


def write(motions: Sequence[Motion], paths: Sequence[Path], *, read_seconds: float = 0.0) -> tuple[Motion, ...]:
    """Write a clip's results, all of them or none, and return them; files of an earlier run go.

    Their reports tell the time that reading the clip and writing take. The time to write must be known
    before a file is: it is that of encoding the result.

    Raises `SolveError`: the verdict on a motion has a fatal reason. All are written to `set_aside(path)` instead;
    `WriteError`: a file cannot be written.
    """
    timed = tuple(_timed(motion, read_seconds / len(motions)) for motion in motions)
    contents = {path: encode(motion) for path, motion in zip(paths, timed, strict=True)}
    aside = {set_aside(path): content for path, content in contents.items()}
    fault = next(filter(None, map(fatal_fault, motions)), "")
    write_together(aside if fault else contents)
    remove(contents if fault else aside)
    if fault:
        raise SolveError(f"{fault} To look at, not to use: {', '.join(path.name for path in aside)}.")
    return timed


def _timed(motion: Motion, read_seconds: float) -> Motion:
    start = time.process_time()
    encode(motion)
    seconds = {"read": read_seconds, **motion.report.cpu_seconds, "write": time.process_time() - start}
    return motion.with_report(cpu_seconds=seconds)
