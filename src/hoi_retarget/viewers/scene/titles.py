"""What results that are shown together are called: as their files, and by what tells them apart."""

from collections.abc import Sequence
from pathlib import Path

from hoi_retarget.motion.motion import Motion


def titles_of(results: Sequence[tuple[Path, Motion]]) -> tuple[str, ...]:
    """Return a name for each result: its file's stem, with robot, edits or folder where others bear the same."""
    named: list[str] = []
    for index, (path, _) in enumerate(results):
        group = [other for other, (there, _) in enumerate(results) if there.stem == path.stem]
        named.append(path.stem if len(group) == 1 else _told_apart(index, group, results))
    return tuple(named)


def _told_apart(index: int, group: Sequence[int], results: Sequence[tuple[Path, Motion]]) -> str:
    path = results[index][0]
    for tell in (_robot, _edits, _folder):
        told = {member: tell(*results[member]) for member in group}
        if len(set(told.values())) == len(group):
            return f"{path.stem}, {told[index]}"
    return str(path)


def _robot(_: Path, motion: Motion) -> str:
    return motion.robot


def _edits(_: Path, motion: Motion) -> str:
    return "edited" if motion.report.source.contact_edits else "as recorded"


def _folder(path: Path, _: Motion) -> str:
    return path.absolute().parent.name
