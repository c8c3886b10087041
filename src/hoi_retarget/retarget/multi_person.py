"""From a clip to result files, one a person, and what is not right with them by their own reports."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from hoi_retarget.clip.clip import Clip
from hoi_retarget.errors import ArgumentError
from hoi_retarget.evaluate import UNREACHED_M, HandToHand, UnreachedSegment, hand_to_hand
from hoi_retarget.files.atomic import write_together
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import encode
from hoi_retarget.retarget.config import Config
from hoi_retarget.retarget.orientation_flips import TurnedSegment
from hoi_retarget.retarget.pipeline import retarget
from hoi_retarget.retarget.targets import shared_scalings
from hoi_retarget.retarget.trajopt.solvers.base import Status
from hoi_retarget.robots.model import RobotModel

STAGES = {"inverse kinematics": "ik_windows", "trajectory": "windows"}
"""Where the report has the windows of each stage."""


def result_paths(clip: Clip, stem: str, out: Path) -> tuple[Path, ...]:
    """Return one result path per person of a clip."""
    if len(clip.people) == 1:
        return (out / f"{stem}.npz",)
    return tuple(out / f"{stem}.p{person}.npz" for person in range(len(clip.people)))


def retarget_people(
    clip: Clip, models: Sequence[RobotModel], config: Config, extra: Mapping[str, Any]
) -> tuple[Motion, ...]:
    """Return one motion per person of a clip, in one world with the same objects.

    Args:
        clip: The recording.
        models: One robot for all people, or one for each.
        config: What else decides the motions.
        extra: What their reports say beside.

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
    motions = [
        retarget(clip, model, replace(config, scaling=scaling), person=person)
        for person, (model, scaling) in enumerate(zip(team, shared_scalings(clip, team, config.scaling), strict=True))
    ]
    if people > 1:
        extra = {"hand_to_hand": [asdict(pair) for pair in hand_to_hand(motions, team)], **extra}
    return with_report(motions, extra)


def with_report(motions: Iterable[Motion], extra: Mapping[str, Any]) -> tuple[Motion, ...]:
    """Return motions whose reports also say what is in `extra`."""
    return tuple(replace(motion, report={**motion.report, **extra}) for motion in motions)


def write(motions: Sequence[Motion], paths: Sequence[Path], *, read_seconds: float = 0.0) -> tuple[Motion, ...]:
    """Write a clip's results, all of them or none, and return them; raises `WriteError`.

    Their reports tell the time that reading the clip and writing take. The time to write must be known
    before a file is: it is that of encoding the result.
    """
    timed = tuple(_timed(motion, read_seconds / len(motions)) for motion in motions)
    write_together({path: encode(motion) for path, motion in zip(paths, timed, strict=True)})
    return timed


def _timed(motion: Motion, read_seconds: float) -> Motion:
    start = time.process_time()
    encode(motion)
    seconds = {"read": read_seconds, **motion.report["cpu_seconds"], "write": time.process_time() - start}
    return replace(motion, report={**motion.report, "cpu_seconds": seconds})


def converged(motion: Motion) -> bool:
    """Return whether every window of both stages was solved to tolerance."""
    return all(
        window["status"] == Status.SOLVED.name for stage in ("ik_windows", "windows") for window in motion.report[stage]
    )


def complaints(motion: Motion) -> tuple[str, ...]:
    """Return what is not right with a result, by its report: a sentence for each."""
    found: list[str] = []
    for stage, windows in STAGES.items():
        for window in motion.report[windows]:
            if window["status"] != Status.SOLVED.name:
                message = Status[window["status"]].value
                found.append(f"{stage}, frames {window['start']} to {window['stop'] - 1}: {message}.")
    found += [f"not reached: {UnreachedSegment(**segment)}." for segment in motion.report["unreached_contacts"]]
    pairs = (HandToHand(**pair) for pair in motion.report.get("hand_to_hand", ()))
    found += [f"{pair}." for pair in pairs if pair.max_m > UNREACHED_M]
    found += [f"{TurnedSegment(**segment)}." for segment in motion.report["turned_over"]]
    return tuple(found)
