"""The loop of a worker process: one task after the other, from a pipe and back into it."""

import os
import resource
from collections.abc import Callable
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from threading import Thread
from typing import Any

READY = "ready"


def serve(connection: Connection, function: Callable[[Any], Any], memory_limit: float | None) -> None:
    """Say that this process is ready, answer each task with the function's value, and end it when nobody asks any more.

    An exception ends the process, too: a function that is given here returns its failures.
    """
    Thread(target=_end_with_parent, daemon=True).start()
    limit_memory(memory_limit)
    value: Any = READY
    while _sent(connection, value):
        try:
            task = connection.recv()
        except (EOFError, OSError):
            break
        value = function(task)
    _end()


def _sent(connection: Connection, value: Any) -> bool:
    """Send a value; return False where whoever asked for it has gone."""
    try:
        connection.send(value)
    except OSError:
        return False
    return True


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
    """End this process without a word: where Python ends it, libraries tell of all that is still cached."""
    os._exit(1)
