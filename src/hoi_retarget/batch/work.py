"""One job in any process, from its clip to its results: it ends with a manifest entry, never with an exception.

In the second stage of a batch, a simulated robot performs the solved results.
"""

import json
import re
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from hoi_retarget.batch.jobs import Job
from hoi_retarget.batch.manifest import ManifestEntry, ManifestResult, ManifestSource, Status
from hoi_retarget.batch.specification import Specification
from hoi_retarget.clip.augment import augment
from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import apply
from hoi_retarget.clip.edits import load as load_edits
from hoi_retarget.dynamics.feasibility import physics_of_motion
from hoi_retarget.dynamics.physics_settings import Refinement
from hoi_retarget.errors import GeometryError, HoiRetargetError, ReadError
from hoi_retarget.evaluation.thresholds import verdict_of
from hoi_retarget.files.python_wheel import sha256_of_file
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.result_file import load
from hoi_retarget.readers.open import clip_of, open_clip
from hoi_retarget.retargeting.retarget import result_paths, retarget_people, write
from hoi_retarget.robots import load_robot, load_team
from hoi_retarget.simulation.physics_stage import add_physics_stage, write_simulated

FOLDER = "refined"  # Folder for performed motions below that of the results.


@dataclass(frozen=True)
class BatchTask:
    """A job and the folder of its results, as a value for any process."""

    job: Job
    out: Path

    @property
    def name(self) -> str:
        """Name of the job."""
        return self.job.name

    def entry(self, status: Status, reason: str) -> ManifestEntry:
        """Return the manifest entry of the job without a clip."""
        job, scaling = self.job, self.job.config.scaling
        scales = {"root": scaling.root_scale, "object": scaling.object_scale}
        return ManifestEntry(
            name=job.name,
            status=status,
            robot=job.robot,
            source=ManifestSource(job.shown),
            scales={**scales, "size_multiplier": scaling.size_multiplier},
            lineage={**asdict(job.augmentation), "contact_edits": ""},
            reason=reason,
        )


@dataclass(frozen=True)
class RefineTask:
    """A result to be refined, as a value for any process."""

    solved: ManifestEntry  # The entry of the result's job.
    result: ManifestResult
    out: Path  # Folder of the batch.
    refinement: Refinement
    seed: int

    @property
    def name(self) -> str:
        """The path of the performed motion below the output folder, without the suffix."""
        return f"{FOLDER}/{self.result.path.removesuffix('.npz')}"

    @property
    def key(self) -> str:
        """Digest of all inputs of the performed motion."""
        parts = {"solved": self.solved.key, "refinement": asdict(self.refinement), "seed": self.seed}
        return sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    def entry(self, status: Status, reason: str) -> ManifestEntry:
        """Return the manifest entry of the result without its performance."""
        return replace(self.solved, name=self.name, status=status, reason=reason, verdict="", results=(), seconds=0.0)


Task = BatchTask | RefineTask


def refinement_tasks(specification: Specification, solved: Iterable[ManifestEntry], out: Path) -> Iterator[RefineTask]:
    """Yield the second stage of solved jobs: one for each person's result; none unless it is asked for."""
    if specification.refine:
        for entry in solved:
            for result in entry.results:
                yield RefineTask(entry, result, out, specification.refinement, specification.seed)


def refine_result(task: RefineTask) -> ManifestEntry:
    """Refine a result and write the performed motion; a fall and a lost object are failures, written with the reason.

    Raises `HoiRetargetError` where the result cannot be refined.
    """
    motion = load(task.out / task.result.path)
    clip = clip_of(motion) if motion.object_names or motion.report.source.path else None
    performed = add_physics_stage(motion, clip, physics_of_motion(motion), task.refinement, seed=task.seed)
    place = task.out / f"{task.name}.npz"
    place.parent.mkdir(parents=True, exist_ok=True)
    motion_path, for_controllers = write_simulated(performed, place)
    performance, frames = performed.performance, performed.motion.frames
    entry = replace(task.entry("solved", ""), frames=frames)
    if not performance.whole:
        how = "falls" if performance.fell else "loses its object"
        reason = f"the robot {how} after {performance.seconds:.1f} s, in frame {frames}: {performance.cause}"
        error = "Fall" if performance.fell else "Loss"
        failed = replace(entry, status="failed", reason=reason, error=error, frame=frames)
        return replace(failed, fell_after=performed.rollout.fell_after)
    verdict = verdict_of(performed.motion, performed.scene.model)
    result = ManifestResult(
        path=motion_path.relative_to(task.out).as_posix(),
        sha256=sha256_of_file(motion_path),
        figures=performed.motion.report.figures,
        verdict=verdict.as_json(),
        companions={for_controllers.relative_to(task.out).as_posix(): sha256_of_file(for_controllers)},
    )
    return replace(entry, verdict=str(verdict.level), results=(result,), certificate=performance.robustness)


_INPUT_ERRORS = (FileNotFoundError, PermissionError, IsADirectoryError, NotADirectoryError)
_FRAME = re.compile(r"\bframes? \(?(\d+)\b(?! %)")  # In messages, where "unsolved frames 60 %" names none.


def run_job(task: Task) -> ManifestEntry:
    """Run one job and return its manifest entry; all of its result files are written, or none."""
    start, entry = time.monotonic(), task.entry("failed", "")
    try:
        if isinstance(task, RefineTask):
            entry = refine_result(task)
        else:
            job, read_start = task.job, time.process_time()
            clip = open_clip(job.clip, job.reading)
            entry = replace(entry, source=_source(job, clip), frames=clip.frames, fps=clip.fps)
            if job.edits is not None:
                clip = apply(clip, load_edits(job.edits))
            clip = augment(clip, job.augmentation)
            edits = clip.source.contact_edits
            lineage = {**entry.lineage, "contact_edits": edits and sha256(edits.encode()).hexdigest()}
            entry = replace(entry, lineage=lineage, frames=clip.frames)
            models = load_team(job.robot)
            read_seconds = time.process_time() - read_start
            motions = retarget_people(clip, models, job.config, command=_command(job))
            paths = result_paths(clip, Path(job.name).name, (task.out / job.name).parent)
            entry = _finished(entry, task, write(motions, paths, read_seconds=read_seconds), paths)
    except Exception as error:  # noqa: BLE001 - any fault of a clip or a result costs that alone
        entry = failed(entry, error)
    return replace(entry, seconds=round(time.monotonic() - start, 3))


def _finished(
    entry: ManifestEntry, task: BatchTask, motions: tuple[Motion, ...], paths: tuple[Path, ...]
) -> ManifestEntry:
    verdicts = [verdict_of(motion, load_robot(motion.robot)) for motion in motions]
    results = tuple(
        ManifestResult(
            path=path.relative_to(task.out).as_posix(),
            sha256=sha256_of_file(path),
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
    cause = error.__cause__ if isinstance(error, ReadError | GeometryError) else None
    # The machine failed to read a file that may be read; errors without a number are numpy's, of damaged files.
    by_disk = isinstance(cause, OSError) and cause.errno is not None and not isinstance(cause, _INPUT_ERRORS)
    kind = "OSError" if by_disk or isinstance(error, OSError) else type(error).__name__
    return replace(entry, reason=reason, error=kind, frame=int(found[1]) if found else None)


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
    return clips | {"robot": job.robot, **job.reading.as_json(), "edits": None if job.edits is None else str(job.edits)}
