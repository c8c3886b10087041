"""The same tasks on Ray: on this machine, or on a cluster with shared files."""

import logging
import signal
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

from hoi_retarget.batch.pool import POLL_SECONDS, LostTask, limit_memory
from hoi_retarget.errors import HoiRetargetError

MACHINES_LOST = 3
"""So many machines may be lost with a task before it counts as what ends them."""


@dataclass(frozen=True)
class RayPool:
    """Processes of Ray, an extra.

    Raises `HoiRetargetError` where Ray is not installed.
    """

    function: Callable[[Any], Any]
    """Of a task, importable by name on every machine; it returns failures instead of raising them."""
    workers: int | None = None
    """Tasks at a time; by default one for each core."""
    address: str | None = None
    """Of a cluster that runs; without one, Ray is started on this machine."""
    time_limit: float | None = None
    """Longest time for a task [s]."""
    memory_limit: float | None = None
    """Most memory that a worker may allocate [MB]."""

    def __post_init__(self) -> None:
        if find_spec("ray") is None:
            raise HoiRetargetError(
                'Ray is not installed. In a clone: pip install ".[ray]"; else: pip install "hoi-retarget[ray]". '
                "Without --engine ray, the processes of this machine are used."
            )

    def run(self, tasks: Sequence[Any], stopped: Callable[[], bool]) -> Generator[tuple[int, Any], None, None]:
        """Yield each task's index and its value, or `LostTask`, as they end; end early when `stopped` says so.

        Raises `HoiRetargetError` when there is no cluster at the address.
        """
        ray = self._start()
        try:
            do = ray.remote(num_cpus=1, max_retries=0)(_do_limited)
            waiting, running, machines_lost = deque(range(len(tasks))), {}, Counter[int]()
            while (waiting or running) and not stopped():
                # Machines come and go.
                at_a_time = self.workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
                while waiting and len(running) < at_a_time:
                    index = waiting.popleft()
                    reference = do.remote(self.function, tasks[index], self.memory_limit)
                    running[reference] = (index, time.monotonic())
                done, _ = ray.wait(list(running), num_returns=1, timeout=POLL_SECONDS)
                for reference in done:
                    index, since = running.pop(reference)
                    value, machine_lost = _value(ray, reference, since)
                    machines_lost[index] += machine_lost
                    if machine_lost and machines_lost[index] < MACHINES_LOST:
                        waiting.append(index)  # Nothing speaks against the task itself.
                    else:
                        yield index, value
                for reference, (index, since) in tuple(running.items()):
                    seconds = time.monotonic() - since
                    if self.time_limit is not None and seconds > self.time_limit:
                        ray.cancel(reference, force=True)
                        del running[reference]
                        yield (
                            index,
                            LostTask("timeout", f"it took longer than the limit of {self.time_limit:g} s", seconds),
                        )
        finally:
            ray.shutdown()

    def _start(self) -> Any:
        import ray  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - an extra

        local = {} if self.address else {"num_cpus": self.workers, "include_dashboard": False}
        handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            ray.init(address=self.address or "local", log_to_driver=False, logging_level=logging.ERROR, **local)
        except (ConnectionError, ValueError, RuntimeError) as error:
            where = f"at --address {self.address}" if self.address else "on this machine"
            raise HoiRetargetError(f"Ray cannot be used {where}: {error}") from error
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)  # Ray puts its own in their place.
        return ray


def _do_limited(function: Callable[[Any], Any], task: Any, memory_limit: float | None) -> Any:
    limit_memory(memory_limit)
    return function(task)


def _value(ray: Any, reference: Any, since: float) -> tuple[Any, bool]:
    """Return a task's value, or `LostTask`, and whether the machine that it was on is lost."""
    try:
        return ray.get(reference), False
    except ray.exceptions.RayError as error:
        reason = " ".join(str(error).split())[:200]
        lost = LostTask("killed", f"its process ended: {reason}", time.monotonic() - since)
        return lost, isinstance(error, ray.exceptions.NodeDiedError)
