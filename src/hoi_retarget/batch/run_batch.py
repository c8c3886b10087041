"""A batch: the jobs without a valid result are run, and the manifest stores the outcome of every job.

Its output folder is locked against a second batch, and cleared of temporary files of a crash.
"""

import os
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from hoi_retarget.batch.jobs import Job, JobDigests, digest_of_file, jobs_of
from hoi_retarget.batch.manifest import MANIFEST, Manifest, ManifestEntry
from hoi_retarget.batch.pool import LocalPool, LostTask
from hoi_retarget.batch.specification import Specification
from hoi_retarget.batch.work import FOLDER, BatchTask, RefineTask, Task, refinement_tasks
from hoi_retarget.errors import ArgumentError, HoiRetargetError
from hoi_retarget.files.atomic import EARLIER, lock, writing
from hoi_retarget.readers import has_companions

LOCK = ".batch.lock"
_TEMPORARY = re.compile(rf"\.(.+\.npz|{re.escape(MANIFEST)})\.[a-z0-9_]{{8}}({re.escape(EARLIER)})?")
"""Names that `files.atomic` gives to files that are not complete."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make a folder and hold it for one batch alone; the system lets go of it however the program ends.

    Raises `HoiRetargetError` where another batch works in it, and `WriteError`.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        file = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        _lock(folder, file)
        with writing(folder):
            os.truncate(file, 0)
            os.pwrite(file, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        with suppress(OSError):
            os.close(file)


def remove_temporaries(folder: Path) -> None:
    """Remove files that were never completed; raises `WriteError`."""
    with writing(folder):
        for path in folder.rglob(".*"):
            if _TEMPORARY.fullmatch(path.name):
                path.unlink(missing_ok=True)


def _lock(folder: Path, file: int) -> None:
    try:
        lock(file)
    except OSError as error:
        who = ""
        with suppress(OSError):
            who = os.pread(file, 20, 0).decode("ascii", "replace").strip()
        raise HoiRetargetError(
            f"{folder}: another batch is at work there{f' (process {who})' if who else ''}. "
            "Wait for it, end it, or choose another --out."
        ) from error


_RESULT = re.compile(r"(\.p\d+)?\.npz$")  # The end of a result's name, after the name of its job.


@dataclass(frozen=True)
class Summary:
    """The end of a batch."""

    jobs: int  # Number of jobs in the specification.
    entries: tuple[ManifestEntry, ...]  # Of all jobs that have ended, in order, earlier runs included.
    done_now: tuple[ManifestEntry, ...]  # Of the jobs of this run, in the order of their ends.
    seconds: float  # Duration of the run [s].

    def __add__(self, other: "Summary") -> "Summary":
        """Return the end of two batches, one after the other."""
        entries, done = self.entries + other.entries, self.done_now + other.done_now
        return Summary(self.jobs + other.jobs, entries, done, self.seconds + other.seconds)

    @property
    def is_complete(self) -> bool:
        """Whether all jobs have ended."""
        return len(self.entries) == self.jobs


def run_batch(  # noqa: PLR0913 - all but three are callbacks
    specification: Specification,
    out: Path,
    pool: LocalPool,
    *,
    begun: Callable[[type[Task], int, int], None] = lambda _kind, _all, _todo: None,
    ended: Callable[[ManifestEntry], None] = lambda _entry: None,
    stopped: Callable[[], bool] = lambda: False,
) -> Summary:
    """Run all jobs of a specification that have no valid result yet, and keep the manifest in `out`.

    Args: `specification`: clips, robots and variants; `out`: folder for results, `<robot>/<clip>...npz`, and the
    manifest; made when it does not exist; `pool`: the workers; its function is `work.run_job`; `begun`: called with the
    kind of the tasks of a stage, their number, and the number of those to run: first jobs, then results to be refined,
    once all are solved that can be; `ended`: called with the entry of each job that ends; `stopped`: returns whether to
    end early; finished jobs stay complete. Raises `ArgumentError`: the specification asks for clips that are not there,
    or whose results would be written over one; `HoiRetargetError`: another batch works in the folder, no worker can be
    started, or nothing can be written.
    """
    start, out = time.monotonic(), out.absolute()
    jobs = jobs_of(specification)
    _check_spared(jobs, out)
    with locked(out):
        remove_temporaries(out)
        digests = JobDigests()
        done_now: list[ManifestEntry] = []
        with Manifest(out, [job.name for job in jobs]) as manifest:

            def is_done(task: Task) -> bool:
                return _is_done(task, manifest.entries.get(task.name), digests, pool.time_limit)

            def work(tasks: Sequence[Task]) -> None:
                with closing(pool.run(tasks, stopped)) as outcomes:
                    for index, outcome in outcomes:
                        entry = _entry(tasks[index], outcome, digests, pool.time_limit)
                        _remove_outdated(out, manifest.entries.get(entry.name), entry)
                        manifest.add(entry)
                        done_now.append(entry)
                        ended(entry)

            todo = [task for task in (BatchTask(job, out) for job in jobs) if not is_done(task)]
            for task in todo:
                digests.key(task.job, None, ())  # Digests of the files now: they may change while the batch runs.
            begun(BatchTask, len(jobs), len(todo))
            work(todo)
            solved = [manifest.entries[job.name] for job in jobs if job.name in manifest.entries]
            refinings = list(refinement_tasks(specification, solved, out))
            left = [task for task in refinings if not is_done(task)]
            if refinings and not stopped():
                begun(RefineTask, len(refinings), len(left))
                work(left)
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


def _is_done(task: Task, entry: ManifestEntry | None, digests: JobDigests, time_limit: float | None) -> bool:
    """Return whether a task is done already, and its results are there as they were written."""
    if entry is None or not entry.is_final(time_limit) or entry.key != _key(task, entry, digests):
        return False
    if isinstance(task, BatchTask) and not entry.source.sha256 and has_companions(Path(task.job.clip)):
        return False  # A companion file that was missing may be there by now.
    files = [item for result in entry.results for item in result.files.items()]
    return all(digest_of_file(task.out / path) == digest for path, digest in files)


def _key(task: Task, entry: ManifestEntry, digests: JobDigests) -> str:
    if isinstance(task, RefineTask):
        return task.key
    return digests.key(task.job, entry.source.objects, entry.source.files)


def _entry(
    task: Task, outcome: ManifestEntry | LostTask, digests: JobDigests, time_limit: float | None
) -> ManifestEntry:
    """Return the entry of a task for the manifest."""
    if isinstance(outcome, LostTask):
        outcome = replace(task.entry(outcome.status, outcome.reason), seconds=round(outcome.seconds, 3))
    return replace(outcome, time_limit=time_limit, key=_key(task, outcome, digests))


def _remove_outdated(out: Path, before: ManifestEntry | None, after: ManifestEntry) -> None:
    """Remove results of an earlier run that the new one did not replace: their inputs have changed."""
    new = {path for result in after.results for path in result.files}
    with writing(out):
        for result in before.results if before else ():
            for path in set(result.files) - new:
                (out / path).unlink(missing_ok=True)
