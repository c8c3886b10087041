"""A pool of processes on this machine: a dead or hanging worker costs its own task alone.

Each worker has a pipe and one task at a time. When its pipe breaks, it is dead; when its time is up, it is killed.
Either way the task is lost, with the reason, and another worker takes its place.
"""

import os
import resource
import signal
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection, wait
from threading import Thread
from typing import Any, Literal

from hoi_retarget.errors import HoiRetargetError

READY = "ready"


def serve(connection: Connection, function: Callable[[Any], Any], memory_limit: float | None) -> None:
    """Say that this process is ready, answer each task with the function's value, and end it when nobody asks any more.

    An exception ends the process, too: a function that is given here returns its failures.
    """
    Thread(target=_end_with_parent, daemon=True).start()
    limit_memory(memory_limit)
    value: Any = READY
    while True:
        try:
            connection.send(value)
            task = connection.recv()
        except (EOFError, OSError):  # The parent process has gone.
            break
        value = function(task)
    _end()


def limit_memory(megabytes: float | None) -> None:
    """Let this process allocate no more than some memory [MB]; beyond it, Python raises `MemoryError`."""
    if megabytes is not None:
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        resource.setrlimit(resource.RLIMIT_DATA, (int(megabytes * 2**20), hard))


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        _end()  # In the middle of its task: nobody is left to take the value.


def _end() -> None:
    """End this process silently: at Python's own end, libraries warn of their caches."""
    os._exit(1)


POLL_SECONDS = 0.2  # Between two looks at time limits and at `stopped`.
FAILED_STARTS = 3  # Workers in a row that may die before they are ready.


@dataclass(frozen=True)
class LostTask:
    """A task that ended without a value."""

    status: Literal["killed", "timeout"]
    reason: str
    seconds: float


@dataclass(frozen=True)
class LocalPool:
    """Processes on this machine."""

    function: Callable[[Any], Any]  # Of a task, importable by name; it returns failures instead of raising them.
    workers: int
    time_limit: float | None = None  # Longest time for a task [s].
    memory_limit: float | None = None  # Most memory that a worker may allocate [MB].

    def run(self, tasks: Sequence[Any], stopped: Callable[[], bool]) -> Generator[tuple[int, Any], None, None]:
        """Yield each task's index and its value, or `LostTask`, as they end; end early when `stopped` says so.

        Raises `HoiRetargetError` when workers cannot be started.
        """
        workers = _Workers(self, tasks)
        try:
            while workers.unfinished:
                workers.start_missing()
                stopping = stopped()
                yield from workers.collect(0.0 if stopping else POLL_SECONDS)
                if stopping:
                    return
                yield from workers.end_late()
                workers.hand_out()
        finally:
            workers.end()


class _Workers:
    """The workers of one run, and the tasks that wait for them."""

    def __init__(self, pool: LocalPool, tasks: Sequence[Any]) -> None:
        self._pool = pool
        self._tasks = tasks
        self._waiting = deque(range(len(tasks)))
        self._workers: list[_Worker] = []
        self._failed_starts = 0

    @property
    def unfinished(self) -> int:
        """Number of tasks that wait or run."""
        return len(self._waiting) + sum(worker.task is not None for worker in self._workers)

    def start_missing(self) -> None:
        """Start missing workers; where the system has room for no more, the present ones do the work."""
        while len(self._workers) < min(self._pool.workers, self.unfinished):
            try:
                self._workers.append(_Worker(self._pool))
            except OSError as error:
                if self._workers:
                    return
                raise HoiRetargetError(
                    f"no worker can be started: {error.strerror or error}. Free memory, or allow more processes."
                ) from error

    def collect(self, seconds: float) -> Iterator[tuple[int, Any]]:
        """Yield finished and lost tasks; wait for the first one for some time [s]."""
        answering = wait([worker.connection for worker in self._workers], seconds)
        for worker in [worker for worker in self._workers if worker.connection in answering]:
            task = worker.task
            try:
                value = worker.receive()
            except (EOFError, OSError):
                lost = LostTask("killed", self._end(worker), worker.seconds)
                self._check_start(worker, lost.reason)
                if task is not None:
                    yield task, lost
            else:
                self._failed_starts = 0
                if task is not None:
                    yield task, value

    def end_late(self) -> Iterator[tuple[int, Any]]:
        """End workers beyond the time limit, and yield their tasks as lost."""
        limit = self._pool.time_limit
        for worker in tuple(self._workers):
            if limit is not None and worker.task is not None and worker.seconds > limit:
                lost = LostTask("timeout", f"it took longer than the limit of {limit:g} s", worker.seconds)
                self._end(worker)
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

    def _end(self, worker: "_Worker") -> str:
        self._workers.remove(worker)
        return worker.end()

    def _check_start(self, worker: "_Worker", reason: str) -> None:
        self._failed_starts += not worker.is_ready
        if self._failed_starts == FAILED_STARTS:
            raise HoiRetargetError(
                f"{FAILED_STARTS} workers in a row ended as they started: {reason}. Try fewer --workers, or a higher "
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
        """Time since it was given its task [s]."""
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
        """Return the value of its task; the first answer says only that the worker is ready."""
        value = self.connection.recv()
        self.task, self.is_ready = None, self.is_ready or value == READY
        return value

    def end(self) -> str:
        """End it at once, and return the cause of its death."""
        self._process.join(0.0)
        self._process.kill()
        self._process.join()
        self.connection.close()
        code = self._process.exitcode or 0
        if code >= 0:
            return f"its process ended with exit code {code}"
        name = signal.Signals(-code).name
        return f"its process was ended by {name}{', perhaps for lack of memory' if name == 'SIGKILL' else ''}"
