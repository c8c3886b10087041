"""Titles of results shown together: what tells them apart, as short as it can be."""

import re
from collections.abc import Sequence
from pathlib import Path

from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.spec import RobotSpec


def short_name(spec: RobotSpec) -> str:
    """Return a robot's name without its maker and its joints, such as `G1`."""
    return spec.title.partition(",")[0].removeprefix("Unitree ")


def title_together(titles: Sequence[str]) -> str:
    """Return the title of results that are shown together, such as `carry` of `carry.p0` and `carry.p1`."""
    plain = titles if len(titles) == 1 else [re.sub(r"\.p\d+(?=$|, |\.npz$)", "", title) for title in titles]
    return " + ".join(dict.fromkeys(plain))


def names_together(people: Sequence[tuple[RobotSpec, int]]) -> tuple[str, ...]:
    """Return what robots that are shown together are called: their names, with their people where two bear the same."""
    names = [short_name(spec) for spec, _ in people]
    if len(set(names)) == len(names):
        return tuple(names)
    return tuple(f"{name}, person {person}" for name, (_, person) in zip(names, people, strict=True))


def titles_of(results: Sequence[tuple[Path, Motion]], *, shortest: bool = True) -> tuple[str, ...]:
    """Return a name for each result: its file's stem, with robot, edits or folder where others bear the same.

    Where all files bear one name, it is left out if titles are to be as short as they can be.
    """
    one_name = shortest and len(results) > 1 and len({path.stem for path, _ in results}) == 1
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
