"""Scenes to compare robots and humans in, each where it was computed, and short titles of results shown together.

A page puts the subjects beside each other on one floor, in views of their own with one camera, or over each other.
"""

import re
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ArgumentError, HoiRetargetError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.robots import load_robot
from hoi_retarget.robots.spec import RobotSpec
from hoi_retarget.studio.scene import scene
from hoi_retarget.studio.scene.drawing import DrawnScene, Subject


def make_subplots(shown: Sequence[scene.SceneItem]) -> DrawnScene:
    """Return results and clips with a subject for each robot, and one for each human, where they were computed.

    Robots that move the same objects of one clip are one subject, and so are their humans. Who is there several times
    with the same motion, such as the human whom several results follow, is there once, and first. Titles name the
    robots. Raises `ArgumentError` when there is nothing to show, `GeometryError` when an object's mesh file cannot be
    read.
    """
    if not shown:
        raise ArgumentError("there is nothing to show. Name a result or a clip.")
    places: dict[tuple[int, str], list[tuple[scene.SceneItem, scene.RobotOrHuman]]] = {}
    for item, host in zip(shown, scene.group_by_shared_objects(shown), strict=True):
        for side in scene.robot_and_human(item):
            places.setdefault((host, side.name), []).append((item, side))
    humans: dict[Hashable, list[tuple[scene.SceneItem, scene.RobotOrHuman]]] = {}
    for (_, name), members in places.items():
        if name == "human":
            paths = tuple((side.fps, side.pelvis.tobytes(), side.objects.tobytes()) for _, side in members)
            humans.setdefault(paths, members)
    robots = [members for (_, name), members in places.items() if name == "robot"]
    ordered = [*humans.values(), *robots]
    shifts = scene.shifts_of([scene.reach_of([side for _, side in members]) for members in ordered])
    clips = len(humans) > 1
    return DrawnScene(tuple(_subplot(members, shift, clips) for members, shift in zip(ordered, shifts, strict=True)))


def on_one_floor(subplots: DrawnScene) -> DrawnScene:
    """Return the subjects of `make_subplots` beside each other."""
    return DrawnScene(
        tuple(
            replace(
                subject,
                layers=tuple(scene.moved(layer, subject.shift) for layer in subject.layers),
                centre=subject.centre + subject.shift,
                look_at_targets={name: path + subject.shift for name, path in subject.look_at_targets.items()},
                shift=np.zeros(3),
            )
            for subject in subplots.subjects
        )
    )


def _subplot(
    members: Sequence[tuple[scene.SceneItem, scene.RobotOrHuman]], shift: Float[np.ndarray, "3"], clips: bool
) -> Subject:
    (first, side), *rest = members
    layers = [*side.layers]
    looks = dict(side.look_at_targets)
    for item, other in rest:
        layers += [layer for layer in other.layers if layer.name not in scene.OBJECT_LAYERS]
        looks |= {f"{name}, {item.title}": path for name, path in other.look_at_targets.items()}
    centre = np.mean([scene.centre_of(each) for _, each in members], axis=0)
    if side.name == "robot":
        return Subject(", ".join(item.title for item, _ in members), side.fps, tuple(layers), centre, looks, shift)
    title = f"human, {first.clip.name}" if clips and first.clip is not None else "human"
    scale = first.motion.report.root_scale if first.motion is not None else None
    return Subject(title, side.fps, tuple(layers), centre, looks, shift, scale or 1.0)


def short_name(spec: RobotSpec) -> str:
    """Return a robot's name without its manufacturer and its joints, such as `G1`."""
    return spec.title.partition(",")[0].removeprefix("Unitree ")


def title_together(titles: Sequence[str]) -> str:
    """Return the title of results that are shown together, such as `carry` of `carry.p0` and `carry.p1`."""
    plain = titles if len(titles) == 1 else [re.sub(r"\.p\d+(?=$|, |\.npz$)", "", title) for title in titles]
    return " + ".join(dict.fromkeys(plain))


def names_together(people: Sequence[tuple[RobotSpec, int]]) -> tuple[str, ...]:
    """Return the names of robots that are shown together, with their people where two have the same."""
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
    differences: tuple[Callable[[Path, Motion], str], ...] = (
        lambda _, motion: _robot_name(motion),
        lambda _, motion: "edited" if motion.report.source.contact_edits else "as recorded",
        lambda path, _: path.absolute().parent.name,
    )
    for difference in differences:
        if len({difference(*other) for other in namesakes}) == len(namesakes):
            name = difference(path, motion)
            return name if one_name else f"{path.stem}, {name}"
    return str(path)


def _robot_name(motion: Motion) -> str:
    try:
        return short_name(load_robot(motion.robot).spec)
    except HoiRetargetError:  # One that the user added, and that is gone.
        return motion.robot
