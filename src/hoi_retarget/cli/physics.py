"""Physics of results: `feasible` computes forces, `refine` simulates a robot, `scene` writes files for MuJoCo."""

import sys
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from hoi_retarget.cli.commands import Feasible, Refine, Scene
from hoi_retarget.cli.open_results import clip_with_objects, load_motion, physics_of
from hoi_retarget.cli.output_checks import check_inputs_kept, check_json, check_stems, check_writable, write_json
from hoi_retarget.cli.terminal import Working, describe_work, do_for_each, exit_code, say, show_table, warn
from hoi_retarget.dynamics import usd_stage
from hoi_retarget.dynamics.feasibility import forces_on_clip, infeasibilities
from hoi_retarget.dynamics.free_hands import kept_objects
from hoi_retarget.dynamics.grip_margin import grip_margins
from hoi_retarget.dynamics.physics_scene import FILE, scene_files, scene_of
from hoi_retarget.evaluation.physics_figures import FEASIBILITY, forces_figures, grip_figures
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.motion import SIMULATED
from hoi_retarget.robots import load_robot
from hoi_retarget.simulation.physics_stage import FOR_CONTROLLERS, add_physics_stage, write_simulated
from hoi_retarget.simulation.refine import Progress
from hoi_retarget.simulation.rollout import Reference, base_errors_deg

_MAX_SHOWN = 6  # Infeasibilities of a result that are printed.


def execute_feasible(command: Feasible) -> int:
    """Show the violations of limits in every result; return 0 when all could be judged."""
    check_json(command.json, command.results)
    rows: list[tuple[str, ...]] = []
    facts: list[object] = []

    def judge(path: Path) -> None:
        motion = load_motion(path, command.robot)
        clip, physics = clip_with_objects(motion, command), physics_of(motion, command)
        model = load_robot(motion.robot)
        forces = forces_on_clip(motion, clip, model, physics)
        kept = kept_objects(motion, clip, model, physics) if command.hands and clip and motion.frames > 1 else ()
        margins = grip_margins(motion, clip, model.forward(motion.qpos), physics) if clip else ()
        values, found = {**forces_figures(forces, motion), **grip_figures(margins)}, infeasibilities(forces, motion)
        masses = " ".join(f"{body.mass:.2f}" for body in forces.bodies) or "-"
        rows.append((path.stem, motion.robot, masses, *(figure.text(values[figure.name]) for figure in FEASIBILITY)))
        bodies = [{"name": body.name, "mass": body.mass, "mass_is": body.reason} for body in forces.bodies]
        facts.append(
            {
                **{"file": str(path), "robot": motion.robot, "frames": motion.frames, **values, "objects": bodies},
                "shortcomings": [asdict(item) for item in found],
                **({"two_free_hands": [asdict(item) for item in kept]} if command.hands else {}),
            }
        )
        say(f"{path}: {'nothing speaks against it' if not found else ''}")
        for item in found[:_MAX_SHOWN]:
            say(f"  {item}")
        if len(found) > _MAX_SHOWN:
            say(f"  and {len(found) - _MAX_SHOWN} more{'' if command.json else '; --json writes all'}")
        for item in margins:
            say(f"  {item.text(motion.object_names[item.object])}")
        for item in kept:
            say(f"  {item}")
        if command.hands and not kept:
            say("  two free hands were not simulated: no object is in this robot's hands alone")

    failures = do_for_each("computing forces", command.results, judge)
    if rows:
        say()
        show_table(
            [("result", "robot", "objects [kg]", *(figure.header for figure in FEASIBILITY)), *rows], words=(0, 1)
        )
    if facts:
        write_json(command.json, facts)
    return exit_code(failures, len(command.results))


_OFF = ("object [cm]", "object [deg]", "near [%]", "base [cm]", "base [deg]")
_HEADER = ("result", "outcome", "of [s]", *_OFF, "CPU [s]")


def execute_refine(command: Refine) -> int:
    """Refine every result; return 0 when all were performed whole, with their objects."""
    check_writable("--out", command.out)
    check_stems(command.results, lambda path: path.stem, f"{command.out}/{{}}.npz. Refine them one after the other.")
    written = [
        command.out / folder / f"{path.stem}.npz" for path in command.results for folder in ("", FOR_CONTROLLERS)
    ]
    check_inputs_kept("--out", written, command.results)
    rows: list[tuple[str, ...]] = []
    failures = do_for_each("refining", command.results, lambda path: rows.append(_refined(path, command)))
    fallen, lost = (sum(row[1].startswith(word) for row in rows) for word in ("fell", "lost"))
    if rows:
        say()
        show_table([_HEADER, *rows], words=(0, 1))
        say()
    held, strictly = (sum(row[1].startswith(words) for row in rows) for words in ("held", "held strictly"))
    how = f" ({strictly} of {held} hold their objects strictly)" if held else ""
    say(f"{len(rows) - fallen - lost} performed whole{how}, {lost} lost, {fallen} fell, {len(failures)} failed.")
    return exit_code(failures, len(command.results)) or int(fallen + lost > 0)


def _refined(path: Path, command: Refine) -> tuple[str, ...]:
    """Refine one result, write the refined one, and return its row of the table."""
    motion = load_motion(path, command.robot)
    physics, clip = physics_of(motion, command), clip_with_objects(motion, command)

    def describe(progress: Progress, reference: Reference) -> None:
        done = f"{progress.seconds:.1f} of {reference.seconds:.1f} s"
        describe_work(f"{path.name}: {done}, cost {progress.cost:.2f}, {progress.samples} samples")

    performed = add_physics_stage(motion, clip, physics, command.refinement, seed=command.seed, on_progress=describe)
    frames, performance = performed.motion.frames, performed.performance
    cpu = performed.motion.report.cpu_seconds[SIMULATED]
    written, for_controllers = write_simulated(performed, command.out / f"{path.stem}.npz")
    if not performance.whole:
        how = "falls" if performance.fell else "loses its object"
        warn(f"{path.name}: {how} in frame {frames} of {motion.frames}: {performance.cause}.")
    say(f"  {written}  ({frames} frames, {cpu:.0f} s of CPU; for controllers: {for_controllers})")
    say(f"  certificate: {performance.robustness}")
    reference, rollout, holds = performed.reference, performed.rollout, performed.holds
    base = np.linalg.norm(rollout.qpos[:, :3] - reference.qpos[: len(rollout.qpos), :3], axis=1)
    return (
        *(path.stem, performance.outcome, f"{reference.seconds:.1f}"),
        _listed(f"{100 * hold.mean_m:.1f}" for hold in holds),
        _listed(f"{hold.mean_deg:.1f}" for hold in holds),
        _listed(f"{100 * hold.kept_share:.0f}" for hold in holds),
        *(f"{100 * base.mean():.1f}", f"{base_errors_deg(rollout, reference).mean():.1f}", f"{cpu:.0f}"),
    )


def _listed(numbers: Iterable[str]) -> str:
    return ", ".join(numbers) or "-"


def execute_scene(command: Scene) -> int:
    """Write the scene of a result; return 0."""
    check_writable("--out", command.out)
    if command.usd:
        usd_stage.check_installed()
    motion = load_motion(command.result, command.robot)
    physics = physics_of(motion, command)
    with Working("making the scene", None):
        clip = clip_with_objects(motion, command)
        scene = scene_of(motion, load_robot(motion.robot), () if clip is None else clip.objects, physics)
        files = {command.out / place: content for place, content in scene_files(scene, motion).items()}
        if command.usd:
            files[command.out / usd_stage.NAME] = usd_stage.usd_file(scene, motion)
    check_inputs_kept("--out", files, [command.result])
    write_together(files)
    say(f"{command.out / FILE}  ({len(files)} files)")
    source = "published gains" if scene.actuators.published else "gains estimated from its torques: none are published"
    say(f"  robot   {scene.model.spec.title}, {source}")
    for item in scene.objects:
        say(f"  object  {item.body.name}: {item.body.mass:.2f} kg ({item.body.reason}), collides as {item.shape.text}")
    at_soles = f"{physics.floor_friction:g} at soles, {physics.object_friction:g} under objects"
    say(f"  friction {physics.hand_friction:g} at hands, {at_soles}")
    say(f"Open it: {sys.executable} -m mujoco.viewer --mjcf={command.out / FILE}   # keyframes: right panel, Physics")
    return 0
