"""One thread for a browser's requests, one after the other."""

import time
from collections.abc import Callable
from threading import Condition, Thread

from hoi_retarget.errors import HoiRetargetError

Task = Callable[[], None]


class Worker:
    """Does tasks in order; of tasks that replace each other, the latest. `on_error` receives a task's error."""

    def __init__(self, name: str, on_error: Callable[[HoiRetargetError], None]) -> None:
        self._changed, self._on_error = Condition(), on_error
        self._tasks: list[Task] = []
        self._latest: Task | None = None
        self._later: tuple[float, str, Task] | None = None
        self._stopped = False
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def do(self, task: Task) -> None:
        """Do this after all earlier tasks, and drop the waiting task of `do_latest`."""
        with self._changed:
            self._latest = None
            self._hurry()
            self._tasks.append(task)
            self._changed.notify()

    def do_latest(self, task: Task) -> None:
        """Do this when nothing else waits, unless there is another task until then."""
        with self._changed:
            self._hurry()
            self._latest = task
            self._changed.notify()

    def do_drag(self, task: Task, *, released: bool) -> None:
        """Do this for a handle that is dragged: of its places only the latest counts, and the one of its release."""
        (self.do if released else self.do_latest)(task)

    def do_later(self, task: Task, delay: float, kind: str = "") -> None:
        """Do this after a delay [s], or before the next other task.

        A waiting task of the same kind is dropped; one of another kind is done now.
        """
        with self._changed:
            if self._later is not None and self._later[1] != kind:
                self._hurry()
            self._later = (time.monotonic() + delay, kind, task)
            self._changed.notify()

    def stop(self) -> None:
        """Do nothing more, and wait for the end of the current task."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while (task := self._next()) is not None:
            try:
                task()
            except HoiRetargetError as error:
                self._on_error(error)

    def _hurry(self) -> None:
        """Move the task of `do_later` to the end of the queue."""
        if self._later is not None:
            self._tasks.append(self._later[2])
            self._later = None

    def _next(self) -> Task | None:
        with self._changed:
            while not self._stopped:
                wait = None if self._later is None else self._later[0] - time.monotonic()
                if wait is not None and wait <= 0:
                    self._hurry()
                if self._tasks:
                    return self._tasks.pop(0)
                if self._latest is not None:
                    task, self._latest = self._latest, None
                    return task
                self._changed.wait(wait)
        return None
