"""Titles of results shown together: their files' names, and what tells equal ones apart."""

from collections.abc import Sequence
from pathlib import Path

from hoi_retarget.motion.motion import Motion


def titles_of(results: Sequence[tuple[Path, Motion]]) -> tuple[str, ...]:
    """Return a name for each result: its file's stem, with robot, edits or folder where others bear the same."""
    return tuple(_title(result, [other for other in results if other[0].stem == result[0].stem]) for result in results)


def _title(result: tuple[Path, Motion], namesakes: Sequence[tuple[Path, Motion]]) -> str:
    path, motion = result
    if len(namesakes) == 1:
        return path.stem
    for differing in (_robot, _edits, _folder):
        if len({differing(*other) for other in namesakes}) == len(namesakes):
            return f"{path.stem}, {differing(path, motion)}"
    return str(path)


def _robot(_: Path, motion: Motion) -> str:
    return motion.robot


def _edits(_: Path, motion: Motion) -> str:
    return "edited" if motion.report.source.contact_edits else "as recorded"


def _folder(path: Path, _: Motion) -> str:
    return path.absolute().parent.name
