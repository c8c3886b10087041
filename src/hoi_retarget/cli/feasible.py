"""`hoi-retarget feasible`: the forces and torques that results would need, and what speaks against them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from hoi_retarget.cli.commands import Feasible
from hoi_retarget.cli.jobs import check_json, do_for_each, exit_code, load_motion, write_json
from hoi_retarget.cli.terminal import say, show_table
from hoi_retarget.cli.weighed import clip_with_objects, physics_of
from hoi_retarget.evaluation.feasibility import FEASIBILITY, forces_figures
from hoi_retarget.motion.motion import Motion
from hoi_retarget.physics.feasibility import Shortcoming, forces_on_clip, shortcomings
from hoi_retarget.physics.forces import Forces
from hoi_retarget.robots import load_robot

_MOST = 6  # Shortcomings of a result that are printed.


def execute(command: Feasible) -> int:
    """Show what speaks against every result; return 0 when all could be judged."""
    check_json(command.json, command.results)
    rows: list[tuple[str, ...]] = []
    facts: list[object] = []

    def judge(path: Path) -> None:
        motion = load_motion(path, command.robot)
        clip, physics = clip_with_objects(motion, command), physics_of(motion, command)
        forces = forces_on_clip(motion, clip, load_robot(motion.robot), physics)
        values, found = forces_figures(forces, motion), shortcomings(forces, motion)
        masses = " ".join(f"{body.mass:.2f}" for body in forces.bodies) or "-"
        rows.append((path.stem, motion.robot, masses, *(figure.text(values[figure.name]) for figure in FEASIBILITY)))
        facts.append({"file": str(path), **facts_of(motion, forces, values, found)})
        say(f"{path}: {'nothing speaks against it' if not found else ''}")
        for item in found[:_MOST]:
            say(f"  {item}")
        if len(found) > _MOST:
            say(f"  and {len(found) - _MOST} more{'' if command.json else '; --json writes all'}")

    failures = do_for_each("computing forces", command.results, judge)
    if rows:
        say()
        show_table(
            [("result", "robot", "objects [kg]", *(figure.header for figure in FEASIBILITY)), *rows], words=(0, 1)
        )
    if facts:
        write_json(command.json, facts)
    return exit_code(failures, len(command.results))


def facts_of(
    motion: Motion, forces: Forces, values: Mapping[str, float | None], found: Sequence[Shortcoming]
) -> dict[str, object]:
    """Return figures, objects and what speaks against a motion as plain JSON values."""
    return {
        **{"robot": motion.robot, "frames": motion.frames, **values},
        "objects": [{"name": body.name, "mass": body.mass, "mass_is": body.reason} for body in forces.bodies],
        "shortcomings": [asdict(item) for item in found],
    }
