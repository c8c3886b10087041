"""One thread that does what a browser asks for, one thing after the other."""

import time
from collections.abc import Callable
from threading import Condition, Thread

Task = Callable[[], None]


class Worker:
    """Does tasks in order; of those of which only the latest counts, that one."""

    def __init__(self, name: str) -> None:
        self._changed = Condition()
        self._tasks: list[Task] = []
        self._latest: Task | None = None
        self._later: tuple[float, str, Task] | None = None
        self._stopped = False
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def do(self, task: Task) -> None:
        """Do this after what was asked for before; drop what waits in `do_latest`."""
        with self._changed:
            self._latest = None
            self._hurry()
            self._tasks.append(task)
            self._changed.notify()

    def do_latest(self, task: Task) -> None:
        """Do this when nothing else waits, unless something else is asked for until then."""
        with self._changed:
            self._hurry()
            self._latest = task
            self._changed.notify()

    def do_later(self, task: Task, delay: float, kind: str = "") -> None:
        """Do this after so many seconds [s], or before what is asked for until then.

        What waits here of the same kind is forgotten; of another kind it is done now.
        """
        with self._changed:
            if self._later is not None and self._later[1] != kind:
                self._hurry()
            self._later = (time.monotonic() + delay, kind, task)
            self._changed.notify()

    def stop(self) -> None:
        """Do nothing more; what is being done is brought to its end."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while (task := self._next()) is not None:
            task()

    def _hurry(self) -> None:
        """Let what waits in `do_later` wait no longer."""
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
