"""Settings of a `Config` as words of the command line: those of the file that `--config` names, and a result's own."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from hoi_retarget.errors import ArgumentError
from hoi_retarget.retargeting.config import BandedInteriorPoint, Config, read_config


def words_of_config(words: Sequence[str]) -> list[str]:
    """Return the words that ask for the settings in the file after `--config`; none without it.

    Raises:
        ReadError: The file cannot be read, or has a key or a value that means nothing.
        ArgumentError: A setting is out of its range, or cannot be told on the command line.
    """
    path = _named(words)
    if path is None:
        return []
    config = config_in(path)
    if not isinstance(config.solver, BandedInteriorPoint):
        raise ArgumentError(f"--config {path}: its solver is {type(config.solver).__name__}; use it from Python.")
    return setting_words(config)


def setting_words(config: Config) -> list[str]:
    """Return the words for all settings that are not as by default."""
    default = dict(_options(Config()))
    changed = [(option, text) for option, text in _options(config) if text != default.get(option)]
    return [word for pair in changed for word in pair]


def _options(config: Config) -> Iterator[tuple[str, str]]:
    table = config.as_json()
    yield from _leaves("--", table["scaling"])
    yield "--horizon", config.horizon.text
    yield "--contact", config.contact
    yield from _leaves("--weights.", table["weights"])
    yield from _leaves("--ik.", table["ik"])
    yield from _leaves("--physics.", table["physics"])
    yield from _leaves("--solver.", {name: value for name, value in table["solver"].items() if name != "name"})


def _leaves(prefix: str, table: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, value in table.items():
        option = f"{prefix}{name.replace('_', '-')}"
        if isinstance(value, Mapping):
            yield from _leaves(f"{option}.", value)
        else:
            yield option, str(value)


def _named(words: Sequence[str]) -> Path | None:
    """Return the file after `--config`, the last one where there are several."""
    found = None
    for word, following in pairwise((*words, "")):
        if word == "--config" and following:
            found = Path(following)
        elif word.startswith("--config="):
            found = Path(word.removeprefix("--config="))
    return found


def config_in(path: Path) -> Config:
    """Return the configuration in a TOML file or in a result; raises what `words_of_config` raises."""
    if path.suffix.lower() != ".npz":
        return read_config(path)
    from hoi_retarget.motion.result_file import load  # noqa: PLC0415  # help needs none of it

    return Config.from_table(load(path).report.config, f"{path}: config")
