"""A pool of processes on this machine that outlives its workers: one that dies or hangs costs its task alone.

Each worker has a pipe and one task at a time. When its pipe breaks, it is dead; when its time is up, it is killed.
Either way the task is lost, with the reason, and another worker takes its place.
"""

import signal
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import wait
from typing import Any, Protocol, runtime_checkable

from hoi_retarget.batch.worker import READY, serve
from hoi_retarget.errors import HoiRetargetError

LOOK_SECONDS = 0.2  # How often time limits and the wish to stop are looked at.
STARTS = 3  # Workers in a row that may die before they are ready.


@dataclass(frozen=True)
class Lost:
    """A task that ended without a value."""

    status: str
    """`killed` or `timeout`."""
    reason: str
    seconds: float


@runtime_checkable
class Pool(Protocol):
    """Where tasks are done: on this machine, or elsewhere."""

    @property
    def time_limit(self) -> float | None:
        """What a task may take [s]."""
        ...

    def run(self, tasks: Sequence[Any], stopped: Callable[[], bool]) -> Generator[tuple[int, Any], None, None]:
        """Yield each task's index and its value, or `Lost`, as they end; end early when `stopped` says so."""
        ...


@dataclass(frozen=True)
class LocalPool:
    """Processes on this machine."""

    function: Callable[[Any], Any]
    """What is done with a task, importable by name; it returns its failures instead of raising them."""
    workers: int
    time_limit: float | None = None
    """What a task may take [s]."""
    memory_limit: float | None = None
    """What a worker may allocate [MB]."""

    def run(self, tasks: Sequence[Any], stopped: Callable[[], bool]) -> Generator[tuple[int, Any], None, None]:
        """Yield each task's index and its value, or `Lost`, as they end; end early when `stopped` says so.

        Raises `HoiRetargetError` when workers cannot be started.
        """
        crew = _Crew(self, tasks)
        try:
            while crew.unfinished:
                crew.fill_up()
                stopping = stopped()
                yield from crew.collect(0.0 if stopping else LOOK_SECONDS)
                if stopping:
                    return
                yield from crew.end_late_ones()
                crew.hand_out()
        finally:
            crew.end()


class _Crew:
    """The workers of one run, and which tasks wait for them."""

    def __init__(self, pool: LocalPool, tasks: Sequence[Any]) -> None:
        self._pool = pool
        self._tasks = tasks
        self._waiting = deque(range(len(tasks)))
        self._workers: list[_Worker] = []
        self._deaths = 0

    @property
    def unfinished(self) -> int:
        """How many tasks wait or are being done."""
        return len(self._waiting) + sum(worker.task is not None for worker in self._workers)

    def fill_up(self) -> None:
        """Start workers where some are missing; those that are there go on where the system has room for no more."""
        while len(self._workers) < min(self._pool.workers, self.unfinished):
            try:
                self._workers.append(_Worker(self._pool))
            except OSError as error:
                if self._workers:
                    return
                raise HoiRetargetError(
                    f"no worker can be started: {error.strerror or error}. Free memory, or allow more processes."
                ) from error

    def collect(self, patience: float) -> Iterator[tuple[int, Any]]:
        """Yield what workers finished or lost, waiting for it a while [s]."""
        answering = wait([worker.connection for worker in self._workers], patience)
        for worker in [worker for worker in self._workers if worker.connection in answering]:
            task = worker.task
            try:
                value = worker.receive()
            except (EOFError, OSError):
                seconds, reason = worker.seconds, self._dismiss(worker)
                self._count_death(worker, reason)
                if task is not None:
                    yield task, Lost("killed", reason, seconds)
            else:
                self._deaths = 0
                if task is not None:
                    yield task, value

    def end_late_ones(self) -> Iterator[tuple[int, Any]]:
        """End workers whose time is up, and yield what they lost."""
        limit = self._pool.time_limit
        for worker in tuple(self._workers):
            if limit is not None and worker.task is not None and worker.seconds > limit:
                lost = Lost("timeout", f"it took longer than the limit of {limit:g} s", worker.seconds)
                self._dismiss(worker)
                yield worker.task, lost

    def hand_out(self) -> None:
        """Give tasks to workers that have none."""
        for worker in self._workers:
            if worker.is_ready and worker.task is None and self._waiting:
                index = self._waiting.popleft()
                if not worker.send(index, self._tasks[index]):
                    self._waiting.appendleft(index)

    def end(self) -> None:
        """End all workers at once."""
        for worker in self._workers:
            worker.end()

    def _dismiss(self, worker: "_Worker") -> str:
        self._workers.remove(worker)
        return worker.end()

    def _count_death(self, worker: "_Worker", reason: str) -> None:
        self._deaths += not worker.is_ready
        if self._deaths == STARTS:
            raise HoiRetargetError(
                f"{STARTS} workers in a row ended as they started: {reason}. Try fewer --workers, or a higher "
                "--memory-limit."
            )


class _Worker:
    """One process; `task` is the index of the task that it has, None where it has none."""

    def __init__(self, pool: LocalPool) -> None:
        context = get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.task: int | None = None
        self.is_ready = False
        self._since = time.monotonic()
        self._process = context.Process(target=serve, args=(theirs, pool.function, pool.memory_limit), daemon=True)
        # Ctrl-C goes to all processes of a terminal, and is meant for this one: workers are born with it blocked.
        resource_tracker.ensure_running()  # Python would start it in between, and unblock the signal.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()

    @property
    def seconds(self) -> float:
        """How long it has had its task [s]."""
        return time.monotonic() - self._since

    def send(self, index: int, task: Any) -> bool:
        """Give it a task; return False when it is dead."""
        try:
            self.connection.send(task)
        except OSError:
            return False
        self.task, self._since = index, time.monotonic()
        return True

    def receive(self) -> Any:
        """Return the value of its task; the first answer says only that it is ready."""
        value = self.connection.recv()
        self.task, self.is_ready = None, self.is_ready or value == READY
        return value

    def end(self) -> str:
        """End it at once, whatever it does, and return what it died of."""
        self._process.join(0.0)
        self._process.kill()
        self._process.join()
        self.connection.close()
        code = self._process.exitcode or 0
        if code >= 0:
            return f"its process ended with exit code {code}"
        name = signal.Signals(-code).name
        return f"its process was ended by {name}{', perhaps for lack of memory' if name == 'SIGKILL' else ''}"
