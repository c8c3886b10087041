"""`hoi-retarget batch`: a set of results in one command, which can be stopped and resumed at any time."""

import math
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType

from hoi_retarget.batch.archive_parts import archives_in, pieces
from hoi_retarget.batch.manifest import MANIFEST, STATUSES, ManifestEntry
from hoi_retarget.batch.pool import LocalPool
from hoi_retarget.batch.run_batch import Summary, locked, run_batch
from hoi_retarget.batch.specification import Specification, of_folder, read_specification
from hoi_retarget.batch.work import BatchTask, Task, run_job
from hoi_retarget.cli.commands import Batch
from hoi_retarget.cli.output_checks import check_writable
from hoi_retarget.cli.run import prepare_skin
from hoi_retarget.cli.run_options import config_in
from hoi_retarget.cli.terminal import Working, fail, say, show_table
from hoi_retarget.clip.read_options import READ_OPTIONS, option_of
from hoi_retarget.errors import ArgumentError
from hoi_retarget.readers import recordings_below
from hoi_retarget.retargeting.config import Config
from hoi_retarget.robots import load_team

_STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
UNPACKED = ".unpacked"  # Folder in OUT for the pieces of archives.
_TENTHS = 10  # Lines of progress where no bar can be drawn.


def execute_batch(command: Batch) -> int:
    """Run the jobs that have no valid result yet; return 0 when every job has one."""
    pool = _pool(command)
    check_writable("--out", command.out)
    summary = Summary(0, (), (), 0.0)
    with _stopped_by_signals() as received, ExitStack() as shown:
        progress = _Progress(shown)
        for number, source in enumerate(_sources(command)):
            specification = _specification(command, source)
            for names in () if number else specification.robots:
                for model in load_team(names):
                    prepare_skin(model)  # Else every worker would.
            summary += run_batch(
                *(specification, command.out, pool),
                begun=progress.begun,
                ended=progress.ended,
                stopped=lambda: bool(received),
            )
            if received:
                break
    if not summary.jobs:
        raise ArgumentError(
            f"{command.source}: no clip in it is asked for: there is none, or none that about and longest select. "
            "`hoi-retarget inspect` on a folder counts its objects."
        )
    _show(summary, command)
    if received and (archives_in(command.source) or not summary.is_complete):
        left = summary.jobs - len(summary.entries)
        fail(f"stopped by {received[0].name}: {left} jobs are left. The same command goes on with them.")
        return 128 + received[0]
    return 0 if all(entry.succeeded for entry in summary.entries) else 1


def _sources(command: Batch) -> Iterator[Path]:
    """Yield the named file or folder, or each folder into which a piece of its archives is unpacked."""
    archives = archives_in(command.source)
    if not archives or (command.source.is_dir() and recordings_below(command.source)):
        yield command.source
    if not archives:
        return
    folder = command.out / UNPACKED
    with locked(folder):
        for number, archive in enumerate(pieces(archives, folder / "release"), 1):
            if recordings_below(folder / "release"):
                say(f"Piece {number}, of {archive.name} ({archives.index(archive) + 1} of {len(archives)}):")
                yield folder / "release"


def _specification(command: Batch, source: Path) -> Specification:
    if source.is_dir():
        config = Config() if command.config is None else config_in(command.config)
        if command.figures is not None:
            config = replace(config, figures=command.figures)
        return of_folder(source, command, config, refine=command.refine, about=command.about, longest=command.longest)
    if command.refine:
        raise ArgumentError(f"--refine is for a folder of clips. In {command.source} write refine = true.")
    for name in (*READ_OPTIONS, "config", "figures", "about", "longest"):
        value = getattr(command, name)
        if value != getattr(Batch, name):
            option = option_of(name)
            key = f"config.{name}" if name == "figures" else name
            raise ArgumentError(f'{option} {value} is for a folder of clips. In {command.source} write {key} = "...".')
    return read_specification(command.source)


def _pool(command: Batch) -> LocalPool:
    for option, value in (
        ("--workers", command.workers),
        ("--time-limit", command.time_limit),
        ("--memory-limit", command.memory_limit),
    ):
        if value is not None and not 0 < value < math.inf:
            raise ArgumentError(f"{option} is {value:g}; it must be a positive number, which may be large.")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return LocalPool(run_job, command.workers or cores, command.time_limit, command.memory_limit)


@contextmanager
def _stopped_by_signals() -> Iterator[list[signal.Signals]]:
    """Collect signals that ask to stop, instead of being ended by them in the middle of something."""
    received: list[signal.Signals] = []

    def note(number: int, _: FrameType | None) -> None:
        received.append(signal.Signals(number))

    before = {number: signal.getsignal(number) for number in _STOPPING}
    for number, handler in before.items():
        if handler != signal.SIG_IGN:  # As nohup has it.
            signal.signal(number, note)
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Progress:
    """A bar on a terminal, else a line now and then; failures are told at once."""

    def __init__(self, shown: ExitStack) -> None:
        self.shown = shown
        self.working: Working | None = None
        self.todo = self.finished = self.failed = 0
        self.start = time.monotonic()

    def begun(self, kind: type[Task], tasks: int, todo: int) -> None:
        """Print the number of jobs, or of results that a simulated robot is to perform, and begin to count."""
        self.shown.close()
        self.todo, self.finished, self.failed, self.start = todo, 0, 0, time.monotonic()
        noun, purpose = ("job", "") if kind is BatchTask else ("result", " to refine")
        done = f", {tasks - todo} of them done before" if tasks > todo else ""
        say(f"{tasks} {noun}{'' if tasks == 1 else 's'}{purpose}{done}.")
        if todo:
            self.working = self.shown.enter_context(Working("starting workers", todo))

    def ended(self, entry: ManifestEntry) -> None:
        """Count a job; say at once when it failed."""
        assert self.working is not None
        self.finished += 1
        if not entry.succeeded:
            self.failed += 1
            fail(f"{entry.name}: {entry.status}: {entry.reason}")
        self.working.describe(self._pace())
        self.working.advance()
        tenth = _TENTHS * self.finished // self.todo > _TENTHS * (self.finished - 1) // self.todo
        if tenth and self.todo > _TENTHS and not sys.stderr.isatty():
            say(f"  {self.finished} of {self.todo}: {self._pace()}")

    def _pace(self) -> str:
        rate = self.finished / max(time.monotonic() - self.start, 1e-3)
        left = (self.todo - self.finished) / rate
        failed = f", {self.failed} failed" if self.failed else ""
        return f"{rate:.2f} clips/s{failed}, {duration_text(left)} left"


def duration_text(seconds: float) -> str:
    """Return a duration as people say it."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 6000:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


def _physics(entry: ManifestEntry) -> str:
    """Return the worst light of physics among a job's results."""
    levels = {(result.verdict.get("physics") or {}).get("level") for result in entry.results}
    return next((level for level in ("fail", "warn", "pass") if level in levels), "not judged")


def _show(summary: Summary, command: Batch) -> None:
    entries = summary.entries
    statuses = Counter(entry.status for entry in entries)
    verdicts = Counter(entry.verdict for entry in entries if entry.succeeded)
    physics = Counter(_physics(entry) for entry in entries if entry.succeeded)
    licences = Counter(entry.source.licence or "unknown" for entry in entries if entry.succeeded)
    errors = Counter(entry.error or entry.status for entry in entries if not entry.succeeded)
    rows = [("", "jobs")]
    rows += [(status, str(statuses[status])) for status in STATUSES if status in statuses]
    rows += [(f"verdict {verdict}", str(count)) for verdict, count in sorted(verdicts.items())]
    rows += [(f"physics {light}", str(count)) for light, count in sorted(physics.items())]
    rows += [(f"failed by {error}", str(count)) for error, count in errors.most_common()]
    rows += [(f"licence {licence}", str(count)) for licence, count in licences.most_common()]
    if entries:
        say()
        show_table(rows)
        say()
    if summary.done_now:
        frames = sum(entry.frames * len(entry.results) for entry in summary.done_now)
        pace = f"{3600 * len(summary.done_now) / summary.seconds:.0f} clips/h, {frames / summary.seconds:.0f} frames/s"
        say(f"{len(summary.done_now)} jobs done in {duration_text(summary.seconds)}: {pace}.")
    else:
        say("0 jobs done: nothing was left to do.")
    say(f"The outcome of each: {command.out / MANIFEST}")
