"""Options of `run` as a `Config`, as plain values for a result's report, and as words of the command line."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

from hoi_retarget.cli.commands import Run, SolveOptions
from hoi_retarget.clip.read_options import option_of
from hoi_retarget.errors import ArgumentError, HoiRetargetError
from hoi_retarget.retargeting.config import Config, Horizon, Scaling, parse_horizon, read_config
from hoi_retarget.retargeting.trajopt.solvers.solver import BandedInteriorPoint

_CONFIG_FIELDS = tuple(field.name for field in fields(Config))
_NOT_IN_REPORT = {*_CONFIG_FIELDS, "config", "json", "all"}
_PATHS = ("objects", "body_models", "edits", "out")


def config_of(options: SolveOptions) -> Config:
    """Return the configuration of a command's options; raises `ArgumentError`."""
    values = {name: getattr(options, name) for name in _CONFIG_FIELDS}
    return Config(**{**values, "horizon": parse_horizon(options.horizon)})


def config_in(path: Path) -> Config:
    """Return the configuration in a TOML file or in a result.

    Raises `ReadError`: the file cannot be read, or has a key or a value without a meaning; `ArgumentError`: a setting
    is out of its range.
    """
    if path.suffix.lower() != ".npz":
        return read_config(path)
    from hoi_retarget.motion.result_file import load  # noqa: PLC0415  # help needs none of it

    return Config.from_table(load(path).report.config, f"{path}: config")


def fields_in(path: Path) -> dict[str, Any]:
    """Return the fields of `SolveOptions` for the file of `--config`; raises as `config_in`."""
    config = config_in(path)
    if not isinstance(config.solver, BandedInteriorPoint):
        raise ArgumentError(f"--config {path}: its solver is {type(config.solver).__name__}; use it from Python.")
    return {**{name: getattr(config, name) for name in _CONFIG_FIELDS}, "horizon": config.horizon.text}


def arguments_of(command: Run) -> dict[str, Any]:
    """Return a command's arguments as plain JSON values for a report, which has its configuration elsewhere."""
    plain = {field.name: getattr(command, field.name) for field in fields(command) if field.name not in _NOT_IN_REPORT}
    arguments = {name: str(value) if isinstance(value, Path) else value for name, value in plain.items()}
    return {**arguments, "clips": [str(clip) for clip in command.clips]}


def to_argv(
    arguments: Mapping[str, Any], config: Mapping[str, Any] | None = None, *, shown: Callable[[str], str] = str
) -> list[str]:
    """Return the words of a `run`; arguments of another version are left out."""
    clips = arguments.get("clips")
    words = ["run", *(shown(str(clip)) for clip in (clips if isinstance(clips, list) else ()))]
    for field in fields(Run):
        value = arguments.get(field.name)
        if field.name == "clips" or field.name in _NOT_IN_REPORT or value is None:
            continue
        if field.default is not MISSING and value == field.default:
            continue
        words += [option_of(field.name), shown(str(value)) if field.name in _PATHS else str(value)]
    try:
        return [*words, *_changed("--", Config.from_table(config or {}, "config"), Config())]
    except HoiRetargetError:
        return words  # A solver that only its author has.


def _changed(prefix: str, settings: Any, default: Any) -> Iterator[str]:
    """Yield option and text of each setting that differs from its default, of settings in settings too."""
    for field in fields(settings):
        value, usual = getattr(settings, field.name), getattr(default, field.name, None)
        option = f"{prefix}{field.name.replace('_', '-')}"
        if is_dataclass(value) and not isinstance(value, Horizon):
            yield from _changed("--" if isinstance(value, Scaling) else f"{option}.", value, usual)
        elif value != usual:
            yield from (option, value.text if isinstance(value, Horizon) else str(value))
