"""The arguments of `run`: as a result's report keeps them, and as the words that ask for the same again."""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from hoi_retarget.cli.commands import Run, Solving
from hoi_retarget.cli.settings import setting_words
from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.retargeting.config import Config

_IN_CONFIG = {item.name for item in fields(Solving)} - {"robot"}
_PATHS = ("objects", "body_models", "edits", "out")
_OPTIONS = {"object_name": "--object"}
"""Options that are not called what their fields are."""


def settings_of(command: Run) -> dict[str, Any]:
    """Return a command's arguments as plain JSON values, without those that a report keeps in its configuration."""
    plain = {
        item.name: getattr(command, item.name) for item in fields(command) if item.name not in (*_IN_CONFIG, "json")
    }
    settings = {name: str(value) if isinstance(value, Path) else value for name, value in plain.items()}
    return {**settings, "clips": [str(clip) for clip in command.clips]}


def words_of(
    settings: Mapping[str, Any], config: Mapping[str, Any] | None = None, *, shown: Callable[[str], str] = str
) -> list[str]:
    """Return the words of the `run` with these arguments; those of another version are left out.

    Args:
        settings: What `settings_of` returned.
        config: The configuration that the report keeps.
        shown: How paths are written.
    """
    clips = settings.get("clips")
    words = ["run", *(shown(str(clip)) for clip in (clips if isinstance(clips, list) else ()))]
    for field in fields(Run):
        value = settings.get(field.name)
        if field.name in ("clips", *_IN_CONFIG) or value is None:
            continue
        if field.default is not MISSING and value == field.default:
            continue
        option = _OPTIONS.get(field.name, f"--{field.name.replace('_', '-')}")
        words += [option, shown(str(value)) if field.name in _PATHS else str(value)]
    return words + _config_words(config or {})


def _config_words(config: Mapping[str, Any]) -> list[str]:
    try:
        return setting_words(Config.from_table(config, "config"))
    except HoiRetargetError:
        return []  # A solver that only its author has.
