"""What a command's settings are before its options: those of the file that `--config` names."""

from collections.abc import Sequence
from dataclasses import MISSING, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import tyro

from hoi_retarget.cli.commands import Solving
from hoi_retarget.errors import ArgumentError
from hoi_retarget.retarget.config import BandedInteriorPoint, Config, read_config


def defaults_of(kind: type[Solving], words: Sequence[str]) -> Any:
    """Return a command with the settings that its options change; None without `--config`.

    Raises:
        ReadError: The file cannot be read, or has a key or a value that means nothing.
        ArgumentError: A setting is out of its range, or cannot be told on the command line.
    """
    path = _named(words)
    if path is None:
        return None
    config = _config(path)
    if not isinstance(config.solver, BandedInteriorPoint):
        raise ArgumentError(f"--config {path}: its solver is {type(config.solver).__name__}; use it from Python.")
    required = {item.name: tyro.MISSING for item in fields(kind) if item.default is MISSING}
    return kind(
        **required,
        **vars(config.scaling),
        horizon=config.horizon.text,
        weights=config.weights,
        ik=config.ik,
        solver=config.solver,
    )


def _named(words: Sequence[str]) -> Path | None:
    """Return the file after `--config`, the last one where there are several."""
    found = None
    for word, following in pairwise((*words, "")):
        if word == "--config" and following:
            found = Path(following)
        elif word.startswith("--config="):
            found = Path(word.removeprefix("--config="))
    return found


def _config(path: Path) -> Config:
    if path.suffix.lower() != ".npz":
        return read_config(path)
    from hoi_retarget.motion.result_file import load  # noqa: PLC0415  # help needs none of it

    return Config.from_table(load(path).report["config"], f"{path}: config")
