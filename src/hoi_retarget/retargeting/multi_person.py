"""From a clip to result files, one for each person."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError, SolveError
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import encode, set_aside
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.local_resolve import draft
from hoi_retarget.retargeting.robots_apart import kept_apart
from hoi_retarget.retargeting.targets import shared_scalings
from hoi_retarget.robots.model import RobotModel


def result_paths(clip: Clip, stem: str, out: Path) -> tuple[Path, ...]:
    """Return one result path per person of a clip."""
    if len(clip.people) == 1:
        return (out / f"{stem}.npz",)
    return tuple(out / f"{stem}.p{person}.npz" for person in range(len(clip.people)))


def retarget_people(
    clip: Clip, models: Sequence[RobotModel], config: Config = Config(), *, command: Mapping[str, Any] | None = None
) -> tuple[Motion, ...]:
    """Return one motion per person of a clip, in one world with the same objects, robots outside each other.

    Args:
        clip: The recording.
        models: One robot for all people, or one for each.
        config: What else decides the motions.
        command: How the clip was called and read, for the reports.

    Raises:
        ArgumentError: There are other numbers of robots and people.
        SolveError: A window ends without a usable trajectory.
    """
    people = len(clip.people)
    if len(models) not in (1, people):
        raise ArgumentError(
            f"{len(models)} robots are named for the {people} {'people' if people > 1 else 'person'} of {clip.name}. "
            "Name one robot for all, or one for each."
        )
    team = tuple(models) * (people if len(models) == 1 else 1)
    drafts = [
        draft(clip, model, replace(config, scaling=scaling), person=person)
        for person, (model, scaling) in enumerate(zip(team, shared_scalings(clip, team, config.scaling), strict=True))
    ]
    # Scalings that make different robots share one world follow from what was asked for.
    asked = {"config": config.as_json(), "command": command or {}}
    return tuple(with_report(item.motion, **asked) for item in kept_apart(drafts, team, config))


def with_report(motion: Motion, **fields: Any) -> Motion:
    """Return a motion with other fields in its report."""
    return replace(motion, report=replace(motion.report, **fields))


def write(motions: Sequence[Motion], paths: Sequence[Path], *, read_seconds: float = 0.0) -> tuple[Motion, ...]:
    """Write a clip's results, all of them or none, and return them.

    Their reports tell the time that reading the clip and writing take. The time to write must be known
    before a file is: it is that of encoding the result.

    Raises:
        SolveError: A motion has faults. All are set aside, at `set_aside(path)`, and nothing is written to the paths.
        WriteError: A file cannot be written.
    """
    timed = tuple(_timed(motion, read_seconds / len(motions)) for motion in motions)
    contents = {path: encode(motion) for path, motion in zip(paths, timed, strict=True)}
    faults = [fault for motion in timed for fault in motion.faults]
    if faults:
        aside = {set_aside(path): content for path, content in contents.items()}
        write_together(aside)
        raise SolveError(f"{faults[0]} To look at, not to use: {', '.join(path.name for path in aside)}.")
    write_together(contents)
    for path in paths:
        set_aside(path).unlink(missing_ok=True)
    return timed


def _timed(motion: Motion, read_seconds: float) -> Motion:
    start = time.process_time()
    encode(motion)
    seconds = {"read": read_seconds, **motion.report.cpu_seconds, "write": time.process_time() - start}
    return with_report(motion, cpu_seconds=seconds)
