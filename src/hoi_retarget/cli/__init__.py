"""The command line: the only part of the package that prints, reads the environment and sets it.

`commands` declares what can be asked for and imports nothing heavy, so that help is quick. Each
command is done by the module of this package that bears its name, imported when it is asked for.
"""

import ctypes
import os
import sys
from collections.abc import Sequence
from importlib import import_module

import tyro

from hoi_retarget import __version__
from hoi_retarget.cli.commands import DESCRIPTION, Command, Robots
from hoi_retarget.cli.terminal import fail, say
from hoi_retarget.errors import ArgumentError, HoiRetargetError

INTERRUPTED, PIPE_CLOSED = 130, 141  # What a shell reports for a command that such a signal ended.
_THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0, 1 for a failure, 2 for a wrong argument.

    Args:
        arguments: What follows the program's name; by default what the program was started with.

    Raises:
        SystemExit: Help was asked for, or the arguments do not parse.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words == ["--version"]:
        say(f"hoi-retarget {__version__}")
        return 0
    command = tyro.cli(
        Command,  # pyright: ignore[reportArgumentType]  # a union of dataclasses is what tyro asks for
        prog="hoi-retarget",
        description=DESCRIPTION,
        args=words,
        config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes),
    )
    _use_one_thread()
    if isinstance(command, Robots):
        _draw_without_a_screen()
    module = import_module(f"hoi_retarget.cli.{type(command).__name__.lower()}")
    try:
        return module.execute(command)
    except ArgumentError as error:
        fail(str(error))
        return 2
    except HoiRetargetError as error:
        fail(str(error))
        return 1
    except KeyboardInterrupt:
        fail("interrupted; what was finished before is complete.")
        return INTERRUPTED
    except BrokenPipeError:
        # Whoever read the output has gone: nothing is left to say, not even when Python closes it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return PIPE_CLOSED


def _use_one_thread() -> None:
    """Let linear algebra use one thread, unless the user says otherwise: its matrices here are small.

    The libraries read this once, when numpy is imported.
    """
    for variable in _THREAD_VARIABLES:
        os.environ.setdefault(variable, "1")


def _draw_without_a_screen() -> None:
    """Choose how MuJoCo draws on a Linux machine without a display; MuJoCo reads it when imported."""
    if sys.platform != "linux" or "MUJOCO_GL" in os.environ or os.environ.get("DISPLAY"):
        return
    for library, backend in (("libEGL.so.1", "egl"), ("libOSMesa.so.8", "osmesa")):
        try:
            ctypes.CDLL(library)
        except OSError:
            continue
        os.environ["MUJOCO_GL"] = backend
        return
