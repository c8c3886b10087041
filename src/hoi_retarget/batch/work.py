"""One job from its clip to its results, in whatever process: it always ends with an entry, never with an exception."""

import hashlib
import re
import time
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from hoi_retarget.batch.jobs import Job
from hoi_retarget.batch.manifest import Entry
from hoi_retarget.clip.augment import augment
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import apply, load
from hoi_retarget.errors import GeometryError, HoiRetargetError, ReadError
from hoi_retarget.evaluate.thresholds import verdict_of
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retarget.multi_person import STAGES, complaints, converged, result_paths, retarget_people, write
from hoi_retarget.retarget.trajopt.solvers.base import Status
from hoi_retarget.robots import robot, team
from hoi_retarget.robots.model import RobotModel, load_model

_OF_THE_INPUT = (FileNotFoundError, PermissionError, IsADirectoryError, NotADirectoryError)
_FRAME = re.compile(r"\bframes? \(?(\d+)")  # As messages name them.


@dataclass(frozen=True)
class Task:
    """A job and where its results belong."""

    job: Job
    out: Path


def do(task: Task) -> Entry:
    """Do one job and return what became of it; its results are there, all of them, or none is."""
    start = time.monotonic()
    return replace(_done(task), seconds=round(time.monotonic() - start, 3))


def blank(job: Job, status: str, reason: str) -> Entry:
    """Return the entry of a job of which only the reason of its end is known."""
    asked = job.scaling
    return Entry(
        name=job.name,
        status=status,
        robot=job.robot,
        source={"path": job.shown},
        scales={"root": asked.root_scale, "object": asked.object_scale, "size_multiplier": asked.size_multiplier},
        lineage={**asdict(job.augmentation), "contact_edits": ""},
        reason=reason,
    )


def _done(task: Task) -> Entry:
    job = task.job
    entry = blank(job, "failed", "")
    try:
        start = time.process_time()
        clip = open_clip(job.clip, job.reading)
        entry = replace(entry, source=_source(job, clip), frames=clip.frames, fps=clip.fps)
        if job.edits is not None:
            clip = apply(clip, load(job.edits))
        clip = augment(clip, job.augmentation)
        edits = clip.source.contact_edits
        lineage = {**entry.lineage, "contact_edits": edits and hashlib.sha256(edits.encode()).hexdigest()}
        entry = replace(entry, lineage=lineage, frames=clip.frames)
        models = [_model(spec.name) for spec in team(job.robot)]
        seconds = time.process_time() - start
        motions = retarget_people(clip, models, job.config, {"command": _command(job)})
        paths = result_paths(clip, Path(job.name).name, (task.out / job.name).parent)
        motions = write(motions, paths, read_seconds=seconds)
        return _finished(entry, task, motions, paths)
    except HoiRetargetError as error:
        return _failed(entry, error, str(error))
    except MemoryError as error:
        return _failed(entry, error, "the memory that a worker may use did not suffice")
    except Exception as error:  # noqa: BLE001 - whatever a clip does costs that clip alone
        return _failed(entry, error, f"unexpected {type(error).__name__}: {error}")


def _finished(entry: Entry, task: Task, motions: tuple[Motion, ...], paths: tuple[Path, ...]) -> Entry:
    verdicts = [verdict_of(motion, _model(motion.robot)) for motion in motions]
    results = tuple(
        {
            "path": path.relative_to(task.out).as_posix(),
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "figures": motion.report["figures"],
            "verdict": verdict.as_json(),
        }
        for path, motion, verdict in zip(paths, motions, verdicts, strict=True)
    )
    scales = {"root": motions[0].report["root_scale"], "object": motions[0].object_scale.tolist()}
    good = all(map(converged, motions))
    told = () if good else [text for motion in motions for text in complaints(motion)]
    return replace(
        entry,
        status="solved" if good else "loose",
        verdict=str(max(verdict.level for verdict in verdicts)),
        reason=told[0] if told else "",
        frame=None if good else _first_loose_frame(motions),
        scales={**entry.scales, **scales},
        results=results,
    )


def _first_loose_frame(motions: tuple[Motion, ...]) -> int:
    windows = (window for motion in motions for stage in STAGES.values() for window in motion.report[stage])
    return min(window["start"] for window in windows if window["status"] != Status.SOLVED.name)


def _failed(entry: Entry, error: Exception, text: str) -> Entry:
    reason = " ".join(text.split())
    found = _FRAME.search(reason)
    by_machine = isinstance(error, OSError) or (isinstance(error, ReadError | GeometryError) and _is_fault(error))
    kind = "OSError" if by_machine else type(error).__name__
    return replace(entry, reason=reason, error=kind, frame=int(found[1]) if found else None)


def _is_fault(error: Exception) -> bool:
    """Return whether a file could not be read although it is there, whole, and may be read."""
    cause = error.__cause__
    # An error without a number is numpy's of damaged files.
    return isinstance(cause, OSError) and cause.errno is not None and not isinstance(cause, _OF_THE_INPUT)


def _source(job: Job, clip: Clip) -> dict[str, Any]:
    source = clip.source
    return {
        "path": job.shown,
        "sha256": source.sha256,
        "format": source.format,
        "licence": source.licence,
        "objects": [track.name for track in clip.objects],
        "files": list(source.files),
        "notes": [*source.notes, *source.doubts],
    }


def _command(job: Job) -> dict[str, Any]:
    """Return what the report tells of the settings, as that of `run` does.

    No single `run` makes an augmented clip, so there it names no clips.
    """
    clips = {} if job.augmentation != type(job.augmentation)() else {"clips": [job.clip]}
    return clips | {
        "robot": job.robot,
        **asdict(job.scaling),
        "horizon": job.horizon,
        **job.reading.as_json(),
        "edits": None if job.edits is None else str(job.edits),
    }


@lru_cache(maxsize=8)
def _model(name: str) -> RobotModel:
    return load_model(robot(name))
