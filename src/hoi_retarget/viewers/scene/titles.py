"""Titles of results shown together: what tells them apart, as short as it can be."""

from collections.abc import Sequence
from pathlib import Path

from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.spec import RobotSpec


def short_name(spec: RobotSpec) -> str:
    """Return a robot's name without its maker and its joints, such as `G1`."""
    return spec.title.partition(",")[0].removeprefix("Unitree ")


def titles_of(results: Sequence[tuple[Path, Motion]]) -> tuple[str, ...]:
    """Return a name for each result: its file's stem, with robot, edits or folder where others bear the same.

    Where all files bear one name, it is left out.
    """
    one_name = len(results) > 1 and len({path.stem for path, _ in results}) == 1
    return tuple(
        _title(result, [other for other in results if other[0].stem == result[0].stem], one_name) for result in results
    )


def _title(result: tuple[Path, Motion], namesakes: Sequence[tuple[Path, Motion]], one_name: bool) -> str:
    path, motion = result
    if len(namesakes) == 1:
        return path.stem
    for differing in (_robot, _edits, _folder):
        if len({differing(*other) for other in namesakes}) == len(namesakes):
            name = differing(path, motion)
            return name if one_name else f"{path.stem}, {name}"
    return str(path)


def _robot(_: Path, motion: Motion) -> str:
    try:
        return short_name(load_robot(motion.robot).spec)
    except HoiRetargetError:  # One that the user added, and that is gone.
        return motion.robot


def _edits(_: Path, motion: Motion) -> str:
    return "edited" if motion.report.source.contact_edits else "as recorded"


def _folder(path: Path, _: Motion) -> str:
    return path.absolute().parent.name
