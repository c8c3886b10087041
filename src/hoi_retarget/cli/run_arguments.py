"""What `run` was asked for: as a result's report keeps it, and as the words that ask for it again."""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from typing import Any

from hoi_retarget.cli.commands import Run

_PATHS = ("objects", "body_models", "edits", "out")
_OPTIONS = {"object_name": "--object"}
"""Options that are not called what their fields are."""


def settings_of(command: Run) -> dict[str, Any]:
    """Return a command's settings as plain JSON values."""
    settings = {name: str(value) if isinstance(value, Path) else value for name, value in asdict(command).items()}
    return {**settings, "clips": [str(clip) for clip in command.clips]}


def words_of(settings: Mapping[str, Any], *, shown: Callable[[str], str] = str) -> list[str]:
    """Return the words of the `run` with these settings; those of another version are left out.

    Args:
        settings: What `settings_of` returned.
        shown: How paths are written.
    """
    clips = settings.get("clips")
    words = ["run", *(shown(str(clip)) for clip in (clips if isinstance(clips, list) else ()))]
    for field in fields(Run):
        value = settings.get(field.name)
        if field.name == "clips" or value is None or (field.default is not MISSING and value == field.default):
            continue
        option = _OPTIONS.get(field.name, f"--{field.name.replace('_', '-')}")
        words += [option, shown(str(value)) if field.name in _PATHS else str(value)]
    return words
