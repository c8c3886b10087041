"""`hoi-retarget refine`: results made into motions that a simulated robot performs."""

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
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.motion.motion import SIMULATED
from hoi_retarget.physics.reference import Reference
from hoi_retarget.physics.refine import Progress
from hoi_retarget.physics.rollout import base_errors_deg, object_errors
from hoi_retarget.retargeting.performing import FOR_CONTROLLERS, Performed, perform, write_performed

_HEADER = ("result", "whole", "performed [s]", "of [s]", "object [cm]", "base [cm]", "base [deg]", "CPU [s]")


def execute(command: Refine) -> int:
    """Refine every result; return 0 when all were performed whole."""
    check_writable("--out", command.out)
    check_stems(command.results, lambda path: path.stem, f"{command.out}/{{}}.npz. Refine them one after the other.")
    written = [
        command.out / folder / f"{path.stem}.npz" for path in command.results for folder in ("", FOR_CONTROLLERS)
    ]
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
    motion = load_motion(path, command.robot)
    physics, clip = physics_of(motion, command), clip_with_objects(motion, command)

    def tell(progress: Progress, reference: Reference) -> None:
        working.describe(
            f"{path.name}: {progress.seconds:.1f} of {reference.seconds:.1f} s, cost {progress.cost:.2f}, "
            f"{progress.samples} samples"
        )

    performed = perform(motion, clip, physics, command.refinement, seed=command.seed, on_progress=tell)
    frames, performance = performed.motion.frames, performed.performance
    cpu = performed.motion.report.cpu_seconds[SIMULATED]
    kept, for_controllers = write_performed(performed, command.out / f"{path.stem}.npz")
    if performance.fell:
        warn(f"{path.name}: falls in frame {frames} of {motion.frames}: {performance.cause}.")
    if performance.let_go_after is not None:
        when = f"after {performance.let_go_after:.1f} s"
        warn(f"{path.name}: the robot fell over its object, which counts little {when}.")
    say(f"  {kept}  ({frames} frames, {cpu:.0f} s of CPU; for controllers: {for_controllers})")
    say(f"  certificate: {performance.robustness}")
    return path.stem, *_row(performed), f"{cpu:.0f}"


def _row(performed: Performed) -> tuple[str, ...]:
    reference, rollout = performed.reference, performed.rollout
    errors = object_errors(rollout, reference, performed.scene.model.n)
    base = np.linalg.norm(rollout.qpos[:, :3] - reference.qpos[: len(rollout.qpos), :3], axis=1)
    return (
        *("no" if performed.performance.fell else "yes", f"{rollout.seconds:.1f}", f"{reference.seconds:.1f}"),
        f"{100 * errors.mean():.1f}" if errors.size else "-",
        *(f"{100 * base.mean():.1f}", f"{base_errors_deg(rollout, reference).mean():.1f}"),
    )
