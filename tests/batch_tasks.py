"""What test pools do with their tasks: workers import it by name."""

import os
import signal
import time
from pathlib import Path


def act(task: str) -> str:
    """Do what the task says; most of it ends the process."""
    match task.split():
        case ["die", number]:
            os.kill(os.getpid(), getattr(signal, number))
        case ["exit", code]:
            os._exit(int(code))
        case ["raise"]:
            raise ZeroDivisionError
        case ["hang"]:
            time.sleep(600)
        case ["interrupt"]:  # As the terminal does to all processes at Ctrl-C.
            os.kill(os.getpid(), signal.SIGINT)
        case ["hog", megabytes]:
            try:
                return f"{len(bytearray(int(megabytes) << 20)) >> 20} MB"
            except MemoryError:
                return "MemoryError"
        case ["stay", folder]:
            (Path(folder) / str(os.getpid())).touch()
            time.sleep(600)
    return task.upper()


def unpicklable(_task: str) -> object:
    """Return what no pipe can carry."""
    return lambda: None


if os.environ.get("BATCH_TASKS_BROKEN"):
    os._exit(7)
