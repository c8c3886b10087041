"""A batch: the jobs without a valid result are run, and the manifest keeps the outcome of every job."""

import re
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from hoi_retarget.batch.content import Contents, digest_of_file
from hoi_retarget.batch.folder import locked, remove_temporaries
from hoi_retarget.batch.jobs import Job, jobs_of
from hoi_retarget.batch.manifest import Manifest, ManifestEntry
from hoi_retarget.batch.pool import Lost, Pool
from hoi_retarget.batch.refining import FOLDER, Refining, refinings_of, unrefined
from hoi_retarget.batch.specification import Specification
from hoi_retarget.batch.work import Task, entry_without_results
from hoi_retarget.errors import ArgumentError
from hoi_retarget.files.atomic import writing
from hoi_retarget.readers import has_companions

_RESULT = re.compile(r"(\.p\d+)?\.npz$")
"""The end of a result's name, after the name of its job."""


@dataclass(frozen=True)
class Summary:
    """The end of a batch."""

    jobs: int
    """Number of jobs in the specification."""
    entries: tuple[ManifestEntry, ...]
    """Of all jobs that have ended, in order, earlier runs included."""
    done_now: tuple[ManifestEntry, ...]
    """Of the jobs of this run, in the order of their ends."""
    seconds: float
    """Duration of the run [s]."""

    @property
    def is_complete(self) -> bool:
        """Whether all jobs have ended."""
        return len(self.entries) == self.jobs


def run_batch(  # noqa: PLR0913 - all but three are callbacks
    specification: Specification,
    out: Path,
    pool: Pool,
    *,
    planned: Callable[[int, int], None] = lambda _all, _todo: None,
    refining: Callable[[int, int], None] = lambda _all, _todo: None,
    ended: Callable[[ManifestEntry], None] = lambda _entry: None,
    stopped: Callable[[], bool] = lambda: False,
) -> Summary:
    """Run all jobs of a specification that have no valid result yet, and keep the manifest in `out`.

    Args:
        specification: Clips, robots and variants.
        out: Folder for results, `<robot>/<clip>...npz`, and the manifest; made when it does not exist.
        pool: The workers; its function is `work.run_job`.
        planned: Called with the number of jobs, and the number of those to run.
        refining: The same of results to be refined, once all are solved that can be.
        ended: Called with the entry of each job that ends.
        stopped: Returns whether to end early; finished jobs stay complete.

    Raises:
        ArgumentError: the specification asks for clips that are not there, or whose results would be written over one.
        HoiRetargetError: another batch works in the folder, or no worker can be started.
        WriteError: the folder or the manifest cannot be written.
    """
    start, out = time.monotonic(), out.absolute()
    jobs = jobs_of(specification)
    _check_spared(jobs, out)
    with locked(out):
        remove_temporaries(out)
        contents = Contents()
        done_now: list[ManifestEntry] = []
        with Manifest(out, [job.name for job in jobs]) as manifest:

            def work(
                tasks: Sequence[Task | Refining], finished: Callable[[int, ManifestEntry | Lost], ManifestEntry]
            ) -> None:
                with closing(pool.run(tasks, stopped)) as outcomes:
                    for index, outcome in outcomes:
                        entry = finished(index, outcome)
                        _remove_outdated(out, manifest.entries.get(entry.name), entry)
                        manifest.add(entry)
                        done_now.append(entry)
                        ended(entry)

            todo = [job for job in jobs if not _is_done(job, manifest.entries.get(job.name), out, contents, pool)]
            for job in todo:
                contents.key(job, None, ())  # Digests of the files now: they may change while the batch runs.
            planned(len(jobs), len(todo))
            work(
                [Task(job, out) for job in todo],
                lambda index, outcome: _entry(todo[index], outcome, contents, pool.time_limit),
            )
            solved = [manifest.entries[job.name] for job in jobs if job.name in manifest.entries]
            refinings = list(refinings_of(specification, solved, out))
            left = [task for task in refinings if not _is_refined(task, manifest.entries.get(task.name), pool)]
            if refinings and not stopped():
                refining(len(refinings), len(left))
                work(left, lambda index, outcome: _refined_entry(left[index], outcome, pool.time_limit))
            remove_temporaries(out)
        names = [*(job.name for job in jobs), *(task.name for task in refinings)]
        entries = tuple(manifest.entries[name] for name in names if name in manifest.entries)
        return Summary(len(names), entries, tuple(done_now), time.monotonic() - start)


def _check_spared(jobs: Sequence[Job], out: Path) -> None:
    """Raise `ArgumentError` when a result would be written over a recording."""
    recordings = {Path(job.clip).resolve() for job in jobs if job.clip.endswith(".npz")}
    stems = {str(path.with_name(_RESULT.sub("", path.name))): path for path in recordings}
    names = [name for job in jobs for name in (job.name, f"{FOLDER}/{job.name}")] if recordings else []
    for name in names:
        path = stems.get(str((out / name).resolve()))
        if path is not None:
            raise ArgumentError(
                f"{path}: this is a recording, and a result of {name} would be written over it. Choose another --out."
            )


def _is_done(job: Job, entry: ManifestEntry | None, out: Path, contents: Contents, pool: Pool) -> bool:
    """Return whether running a job again would give the results that are there."""
    if entry is None or not entry.is_final(pool.time_limit) or entry.key != _key(job, entry, contents):
        return False
    if not entry.source.sha256 and has_companions(Path(job.clip)):
        return False  # A companion file that was missing may be there by now.
    return _holds_results(entry, out)


def _is_refined(task: Refining, entry: ManifestEntry | None, pool: Pool) -> bool:
    """Return whether refining a result again would give what is there."""
    known = entry is not None and entry.is_final(pool.time_limit) and entry.key == task.key
    return known and entry is not None and _holds_results(entry, task.out)


def _holds_results(entry: ManifestEntry, out: Path) -> bool:
    """Return whether the results of a job are there as they were written."""
    files = [item for result in entry.results for item in result.files.items()]
    return all(digest_of_file(out / path) == digest for path, digest in files)


def _key(job: Job, entry: ManifestEntry, contents: Contents) -> str:
    return contents.key(job, entry.source.objects, entry.source.files)


def _entry(job: Job, outcome: ManifestEntry | Lost, contents: Contents, time_limit: float | None) -> ManifestEntry:
    """Return the entry of a job for the manifest."""
    if isinstance(outcome, Lost):
        outcome = replace(entry_without_results(job, outcome.status, outcome.reason), seconds=round(outcome.seconds, 3))
    return replace(outcome, time_limit=time_limit, key=_key(job, outcome, contents))


def _refined_entry(task: Refining, outcome: ManifestEntry | Lost, time_limit: float | None) -> ManifestEntry:
    if isinstance(outcome, Lost):
        outcome = replace(unrefined(task, outcome.status, outcome.reason), seconds=round(outcome.seconds, 3))
    return replace(outcome, time_limit=time_limit, key=task.key)


def _remove_outdated(out: Path, before: ManifestEntry | None, after: ManifestEntry) -> None:
    """Remove results of an earlier run that the new one did not replace: their inputs have changed."""
    new = {path for result in after.results for path in result.files}
    with writing(out):
        for result in before.results if before else ():
            for path in set(result.files) - new:
                (out / path).unlink(missing_ok=True)
