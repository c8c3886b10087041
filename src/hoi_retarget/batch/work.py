"""One job from its clip to its results, in any process: it ends with a manifest entry, never with an exception."""

import hashlib
import re
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from hoi_retarget.batch.jobs import Job
from hoi_retarget.batch.manifest import ManifestEntry, ManifestResult, ManifestSource, Status
from hoi_retarget.batch.refining import Refining, refined, unrefined
from hoi_retarget.clip.augment import augment
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import apply, load
from hoi_retarget.errors import GeometryError, HoiRetargetError, ReadError
from hoi_retarget.evaluation.thresholds import verdict_of
from hoi_retarget.motion.motion import Motion
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.multi_person import result_paths, retarget_people, write
from hoi_retarget.robots import load_robot, load_team

_INPUT_ERRORS = (FileNotFoundError, PermissionError, IsADirectoryError, NotADirectoryError)
_FRAME = re.compile(r"\bframes? \(?(\d+)")  # In messages.


@dataclass(frozen=True)
class Task:
    """A job and the folder of its results."""

    job: Job
    out: Path


def run_job(task: Task | Refining) -> ManifestEntry:
    """Run one job and return its manifest entry; all of its result files are written, or none."""
    start = time.monotonic()
    entry = _run(task) if isinstance(task, Task) else _refine(task)
    return replace(entry, seconds=round(time.monotonic() - start, 3))


def entry_without_results(job: Job, status: Status, reason: str) -> ManifestEntry:
    """Return the manifest entry of a job whose clip was not read."""
    asked = job.config.scaling
    return ManifestEntry(
        name=job.name,
        status=status,
        robot=job.robot,
        source=ManifestSource(job.shown),
        scales={"root": asked.root_scale, "object": asked.object_scale, "size_multiplier": asked.size_multiplier},
        lineage={**asdict(job.augmentation), "contact_edits": ""},
        reason=reason,
    )


def _run(task: Task) -> ManifestEntry:
    job = task.job
    entry = entry_without_results(job, "failed", "")
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
        models = load_team(job.robot)
        seconds = time.process_time() - start
        motions = retarget_people(clip, models, job.config, command=_command(job))
        paths = result_paths(clip, Path(job.name).name, (task.out / job.name).parent)
        motions = write(motions, paths, read_seconds=seconds)
        return _finished(entry, task, motions, paths)
    except Exception as error:  # noqa: BLE001 - any fault of a clip costs that clip alone
        return failed(entry, error)


def _refine(task: Refining) -> ManifestEntry:
    try:
        return refined(task)
    except Exception as error:  # noqa: BLE001 - as above
        return failed(unrefined(task, "failed", ""), error)


def _finished(entry: ManifestEntry, task: Task, motions: tuple[Motion, ...], paths: tuple[Path, ...]) -> ManifestEntry:
    verdicts = [verdict_of(motion, load_robot(motion.robot)) for motion in motions]
    results = tuple(
        ManifestResult(
            path=path.relative_to(task.out).as_posix(),
            sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
            figures=motion.report.figures,
            verdict=verdict.as_json(),
        )
        for path, motion, verdict in zip(paths, motions, verdicts, strict=True)
    )
    scales = {"root": motions[0].report.root_scale, "object": motions[0].object_scale.tolist()}
    return replace(
        entry,
        status="solved",
        verdict=str(max(verdict.level for verdict in verdicts)),
        scales={**entry.scales, **scales},
        results=results,
    )


def failed(entry: ManifestEntry, error: Exception) -> ManifestEntry:
    """Return the entry of a job that an error ended."""
    text = f"unexpected {type(error).__name__}: {error}"
    if isinstance(error, HoiRetargetError):
        text = str(error)
    elif isinstance(error, MemoryError):
        text = "the memory that a worker may use did not suffice"
    reason = " ".join(text.split())
    found = _FRAME.search(reason)
    by_machine = isinstance(error, OSError) or (isinstance(error, ReadError | GeometryError) and _is_disk_error(error))
    kind = "OSError" if by_machine else type(error).__name__
    return replace(entry, reason=reason, error=kind, frame=int(found[1]) if found else None)


def _is_disk_error(error: Exception) -> bool:
    """Return whether the machine failed to read a file, not the file itself: it exists and may be read."""
    cause = error.__cause__
    # An error without a number is numpy's of damaged files.
    return isinstance(cause, OSError) and cause.errno is not None and not isinstance(cause, _INPUT_ERRORS)


def _source(job: Job, clip: Clip) -> ManifestSource:
    source = clip.source
    return ManifestSource(
        path=job.shown,
        sha256=source.sha256,
        format=source.format,
        licence=source.licence,
        objects=tuple(track.name for track in clip.objects),
        files=tuple(source.files),
        notes=(*source.notes, *map(str, source.warnings)),
    )


def _command(job: Job) -> dict[str, Any]:
    """Return the settings for the report, as `run` keeps them.

    No single `run` makes an augmented clip, so there it names no clips.
    """
    clips = {} if job.augmentation != type(job.augmentation)() else {"clips": [job.clip]}
    return clips | {
        "robot": job.robot,
        **job.reading.as_json(),
        "edits": None if job.edits is None else str(job.edits),
    }
