"""From the words of the command line to the command that does what they ask for."""

import ctypes
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

_TYRO_COLOURS = "PYTHON_TYRO_ANSI_CODES"
_PLAIN = bool(os.environ.get("NO_COLOR")) or not (sys.stdout.isatty() and sys.stderr.isatty())
_DECIDED = _TYRO_COLOURS in os.environ
if _PLAIN and not _DECIDED:
    os.environ[_TYRO_COLOURS] = "False"  # tyro reads it when imported, and NO_COLOR not at all

import tyro  # noqa: E402

if _PLAIN and not _DECIDED:
    del os.environ[_TYRO_COLOURS]

from hoi_retarget import __version__  # noqa: E402
from hoi_retarget.cli.commands import COMMANDS, DESCRIPTION, Command, Render, Report, Robots, Share, Solving  # noqa: E402
from hoi_retarget.cli.settings import words_of_config  # noqa: E402
from hoi_retarget.cli.spelling import check_spelling  # noqa: E402
from hoi_retarget.cli.terminal import STDOUT, fail, say, stdout_for_json  # noqa: E402
from hoi_retarget.errors import ArgumentError, HoiRetargetError  # noqa: E402

_TYRO = (tyro.conf.OmitSubcommandPrefixes,)
_THREAD_VARIABLES = (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "IGL_NUM_THREADS",
)


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code.

    Raises:
        SystemExit: Help was asked for, or the arguments do not parse.
    """
    words = list(arguments)
    if words == ["--version"]:
        say(f"hoi-retarget {__version__}")
        return 0
    _use_one_thread()
    try:
        check_spelling(words)
        command = _parsed(words)
        _check_named(words[0], command)
        if isinstance(command, Render | Report | Robots | Share):
            _draw_without_a_screen()
        with stdout_for_json(json_of(command) == STDOUT):
            return _module(type(command).__name__.lower()).execute(command)
    except ArgumentError as error:
        fail(str(error))
        return 2
    except HoiRetargetError as error:
        fail(str(error))
        return 1


def _parsed(words: list[str]) -> Any:
    """Return the command that the words ask for; raises `SystemExit` as `run` does."""
    kind = COMMANDS.get(words[0]) if words else None
    if kind is None:
        return tyro.cli(
            Command,  # pyright: ignore[reportArgumentType]  # a union of dataclasses is what tyro asks for
            prog="hoi-retarget",
            description=DESCRIPTION,
            args=words,
            config=_TYRO,
        )
    # Options that come later win: those of the user stand behind those of the file that --config names.
    settings = words_of_config(words[1:]) if issubclass(kind, Solving) else []
    return tyro.cli(kind, prog=f"hoi-retarget {words[0]}", args=[*settings, *words[1:]], config=_TYRO)


def json_of(command: Any) -> Path | None:
    """Return where a command, or its action, is to write what it says as JSON."""
    return getattr(getattr(command, "action", command), "json", None)


def _check_named(word: str, command: Command) -> None:
    """Raise `ArgumentError` where a command is given none of the files that it is for."""
    for name, noun, shown in (
        ("clips", "clip", "CLIP"),
        ("results", "result", "RESULT"),
        ("paths", "file", "DIR|FILE"),
    ):
        if getattr(command, name, None) == ():
            raise ArgumentError(f"no {noun} is named. Usage: hoi-retarget {word} {shown}... (see --help).")


def _module(name: str) -> ModuleType:
    """Import what does a command; raises `HoiRetargetError` when MuJoCo cannot draw as `MUJOCO_GL` asks for.

    MuJoCo loads what it draws with as it is imported, even where nothing will be drawn.
    """
    try:
        return import_module(f"hoi_retarget.cli.{name}")
    except (ImportError, AttributeError, RuntimeError, OSError) as error:
        if not os.environ.get("MUJOCO_GL") or "mujoco" in sys.modules:
            raise
        raise HoiRetargetError(
            f"MUJOCO_GL={os.environ['MUJOCO_GL']}: MuJoCo cannot be loaded with this way to draw ({error}). Unset "
            "MUJOCO_GL, or install what it needs (Debian: libegl1 and libgl1-mesa-dri for egl, libosmesa6 for osmesa)."
        ) from error


def _use_one_thread() -> None:
    """Let linear algebra use one thread, unless the user says otherwise: its matrices here are small.

    The libraries read this once, when numpy is imported.
    """
    for variable in _THREAD_VARIABLES:
        os.environ.setdefault(variable, "1")


def _draw_without_a_screen() -> None:
    """Choose how MuJoCo draws on a Linux machine without a display; MuJoCo reads it when imported."""
    if sys.platform != "linux" or os.environ.get("MUJOCO_GL") or os.environ.get("DISPLAY"):
        return
    for library, backend in (("libEGL.so.1", "egl"), ("libOSMesa.so.8", "osmesa")):
        try:
            ctypes.CDLL(library)
        except OSError:
            continue
        os.environ["MUJOCO_GL"] = backend
        return
