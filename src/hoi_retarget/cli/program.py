"""Words of the command line parsed, and the command executed that they name."""

import ctypes
import os
import platform
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

_TYRO_COLOURS = "PYTHON_TYRO_ANSI_CODES"
_PLAIN = bool(os.environ.get("NO_COLOR")) or not (sys.stdout.isatty() and sys.stderr.isatty())
_DECIDED = _TYRO_COLOURS in os.environ
if _PLAIN and not _DECIDED:
    os.environ[_TYRO_COLOURS] = "False"  # tyro reads it when imported, and NO_COLOR not at all

import tyro  # noqa: E402  # after its environment is set

if _PLAIN and not _DECIDED:
    del os.environ[_TYRO_COLOURS]

from hoi_retarget import __version__  # noqa: E402  # as above
from hoi_retarget.cli.commands import COMMANDS, DESCRIPTION, ROBOT_ACTIONS, AnyCommand, Doctor, Settings, SolveOptions  # noqa: E402  # as above
from hoi_retarget.cli.run_options import fields_in  # noqa: E402  # as above
from hoi_retarget.cli.short_help import EXAMPLES, commands_text, settings_text, short_help, whole_help  # noqa: E402  # as above
from hoi_retarget.cli.terminal import STDOUT, fail, program, say, stdout_for_json  # noqa: E402  # as above
from hoi_retarget.errors import EXTRAS, ArgumentError, DrawingError, HoiRetargetError, did_you_mean, install_hint  # noqa: E402  # as above

_MODULES = {
    "demo": "run",
    **dict.fromkeys(("check-motion", "convert", "inspect", "sample"), "files"),
    "contacts": "edit_contacts",
    **dict.fromkeys(("edit", "share", "view"), "pages"),
    "evaluate": "report",
    **dict.fromkeys(("doctor", "settings"), "program"),
    **dict.fromkeys(("feasible", "refine", "scene"), "physics"),
}
"""Module of each command that has none of its own name."""
_DRAWING = ("doctor", "render", "report", "robots", "share")
_THREAD_VARIABLES = tuple(f"{name}_NUM_THREADS" for name in ("OPENBLAS", "OMP", "MKL", "VECLIB_MAXIMUM", "IGL"))


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code; raises `SystemExit` for help and arguments that do not parse."""
    words = list(arguments)
    if words == ["--version"]:
        say(f"hoi-retarget {__version__}")
        return 0
    _use_one_thread()
    try:
        command = _with_names(_parsed(words))
        _check_named(words[0], command)
        if words[0] in _DRAWING:
            _draw_without_a_screen()
        with stdout_for_json(json_of(command) == STDOUT):
            return _executor(words[0])(command)
    except ArgumentError as error:
        fail(str(error))
        return 2
    except HoiRetargetError as error:
        fail(str(error))
        return 1


def _parsed(words: Sequence[str]) -> Any:
    """Return the command of the words, as a value of its class in `COMMANDS`; raises as `run` does."""
    if words in (["-h"], ["--help"]):
        say(commands_text(DESCRIPTION, {name: kind.__doc__ or "" for name, kind in COMMANDS.items()}))
        raise SystemExit(0)
    if not words or words[0].startswith("-"):
        return parse(AnyCommand, "hoi-retarget", words, description=DESCRIPTION)
    if words[0] not in COMMANDS:
        near = did_you_mean(words[0], COMMANDS)
        raise ArgumentError(f"hoi-retarget has no command {words[0]!r}.{near} Each command: {', '.join(COMMANDS)}.")
    action = words[1] if words[0] == "robots" and len(words) > 1 else "-"
    if not action.startswith("-") and action not in ROBOT_ACTIONS:
        near = did_you_mean(action, ROBOT_ACTIONS)
        raise ArgumentError(
            f"hoi-retarget robots has no action {action!r}.{near} Each action: {', '.join(ROBOT_ACTIONS)}."
        )
    kind, prog = COMMANDS[words[0]], f"hoi-retarget {words[0]}"
    if "--help-all" in words:
        return parse(kind, prog, ["--help"])
    if words[0] in EXAMPLES and {"-h", "--help"} & set(words):
        say(short_help(whole_help(lambda: parse(kind, prog, ["--help"])), words[0]))
        raise SystemExit(0)
    command = parse(kind, prog, words[1:])
    if (file := getattr(command, "config", None)) is None or not issubclass(kind, SolveOptions):
        return command
    # Again, with the file's settings as defaults: options win.
    return parse(kind, prog, words[1:], default=replace(command, **fields_in(file)))


def parse(kind: Any, prog: str, words: Sequence[str], **options: Any) -> Any:
    """Return the words as a value of a class; raises `SystemExit` for help and for words that do not parse."""
    return tyro.cli(kind, prog=prog, args=words, config=(tyro.conf.OmitSubcommandPrefixes,), **options)


def execute_settings(command: Settings) -> int:
    """Show the settings of `run`, which `edit` has, too, and `batch` takes from a file."""
    text = whole_help(lambda: parse(COMMANDS["run"], "hoi-retarget run", ["--help"]))
    try:
        say(settings_text(text, command.group))
    except KeyError as error:
        raise ArgumentError(
            f"there is no group {command.group!r}. hoi-retarget settings shows those there are."
        ) from error
    return 0


def execute_doctor(command: Doctor) -> int:
    """Tell whether this installation retargets and draws, and commands for missing parts; 1 if it cannot retarget."""
    versions = ", ".join(f"{name} {version(name)}" for name in ("hoi-retarget", "numpy", "scipy", "mujoco"))
    try:
        drawing = _drawing()
    except (ImportError, OSError, HoiRetargetError) as error:
        drawing = ""
        say(f"retargeting: fails. {error}")
    else:
        say(f"retargeting: works (Python {platform.python_version()}, {versions})")
        say(f"drawing: {drawing}")
    hints = {work: install_hint(module) for module, (_, work) in EXTRAS.items()}
    there = ", ".join(work for work, hint in hints.items() if not hint) or "nothing"
    say("\n".join([f"optional: {there}", *(f"no {work}. {hint}" for work, hint in hints.items() if hint)]))
    return 0 if drawing else 1


def _drawing() -> str:
    """Return whether pictures are drawn and robots look as they do; raises where the package or a robot is damaged."""
    from hoi_retarget.retargeting import retarget  # noqa: F401, PLC0415  # the whole of it may fail
    from hoi_retarget.robots import ROBOTS, load_robot, user_robots  # noqa: PLC0415  # as above
    from hoi_retarget.robots.fetched_meshes import fetched_meshes  # noqa: PLC0415  # as above
    from hoi_retarget.studio.offscreen.stage import check_can_draw  # noqa: PLC0415  # as above

    plain = [name for name in ROBOTS if fetched_meshes(load_robot(name).spec) is None]
    for name in user_robots.names():
        load_robot(name)
    looks = "; for the real look, once: " + ", ".join(f"{program()} robots meshes {name}" for name in plain)
    try:
        check_can_draw()
    except DrawingError as error:
        return f"in a browser alone. {error}"
    return "works" + (looks if plain else "")


def json_of(command: Any) -> Path | None:
    """Return the file of a command's, or its action's, option `--json`."""
    return getattr(getattr(command, "action", command), "json", None)


def _with_names(command: Any) -> Any:
    """Return a command with the full paths of files and folders that are named `.` or `..`: names follow from them."""
    paths = {name: getattr(command, name) for name in ("clips", "results") if hasattr(command, name)}
    named = {
        name: tuple(path.resolve() if path.name in ("", "..") else path for path in value)
        for name, value in paths.items()
        if isinstance(value, tuple) and all(isinstance(path, Path) for path in value)
    }
    return replace(command, **named) if named else command


def _check_named(word: str, command: Any) -> None:
    """Raise `ArgumentError` where no file is named for a command."""
    for name, noun, shown in (
        ("clips", "clip", "CLIP"),
        ("results", "result", "RESULT"),
        ("paths", "file", "DIR|FILE"),
    ):
        if getattr(command, name, None) == ():
            raise ArgumentError(f"no {noun} is named. Usage: hoi-retarget {word} {shown}... (see --help).")


def _executor(word: str) -> Callable[[Any], int]:
    """Import the function that executes a command; raises `HoiRetargetError` when MuJoCo cannot draw with `MUJOCO_GL`.

    MuJoCo loads its drawing library as it is imported, even where nothing will be drawn.
    """
    try:
        module = import_module(f"hoi_retarget.cli.{_MODULES.get(word, word)}")
    except (ImportError, AttributeError, RuntimeError, OSError) as error:
        if not os.environ.get("MUJOCO_GL") or "mujoco" in sys.modules:
            raise
        raise HoiRetargetError(
            f"MUJOCO_GL={os.environ['MUJOCO_GL']}: MuJoCo cannot be loaded with this way to draw ({error}). Unset "
            "MUJOCO_GL, or install what it needs (Debian: libegl1 and libgl1-mesa-dri for egl, libosmesa6 for osmesa)."
        ) from error
    return getattr(module, f"execute_{word.replace('-', '_')}")


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
