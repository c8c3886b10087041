"""The command line: the only part of the package that prints, reads the environment and sets it.

`commands` declares all options and imports nothing heavy, so that help is quick. `program` imports
the module of a command when it is executed. However it ends, it ends with an exit code and at most a line.
"""

import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress

INTERRUPTED, PIPE_CLOSED = 130, 141  # What a shell reports for a command that such a signal ended.


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command, by default this program's own, and return its exit code: 0, 1 for a failure, 2 for an argument.

    Raises `SystemExit` where help is asked for, or the arguments do not parse.
    """
    try:
        _prepare_streams()
        if arguments is None and not sys.warnoptions:
            _silence_warnings()
        try:
            # Imports take most of a second, in which the user may press Ctrl-C too.
            from hoi_retarget.cli.program import run  # noqa: PLC0415  # as said above

            return run(sys.argv[1:] if arguments is None else arguments)
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt:
        _complain("interrupted; what was finished before is complete.")
        return INTERRUPTED
    except BrokenPipeError:
        # Whoever read the output has gone: nothing is left to say, not even when Python closes it.
        _discard_output()
        return PIPE_CLOSED
    except OSError as error:
        # Files that cannot be read or written are told by those who use them; what is left is the output.
        reason = error.strerror or error
        if error.filename is None:
            _complain(f"the output cannot be written ({reason}). Free some space, or send it elsewhere.")
        else:
            _complain(f"{os.fsdecode(error.filename)}: {reason}. Check the path and its permissions.")
        _discard_output()
        return 1


def _prepare_streams() -> None:
    """Let no character and no closed stream stop the output."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: PTH123, SIM115  # as long as the program runs
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _silence_warnings() -> None:
    """Keep other packages' warnings, which show lines of source code, from the terminal, also those of workers."""
    warnings.simplefilter("ignore")
    os.environ["PYTHONWARNINGS"] = "ignore"


def _complain(text: str) -> None:
    with suppress(OSError):
        sys.stderr.write(f"error: {text}\n")
        sys.stderr.flush()


def _discard_output() -> None:
    """Send output that is left nowhere, so that Python's end does not fail on it."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
            continue
        with suppress(OSError, ValueError):  # A stream that was put in the place of stdout has no number.
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
