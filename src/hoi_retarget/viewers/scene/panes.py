"""A scene to be compared in: a subject for each robot and one for each human, each where it was computed.

A page puts them beside each other on one floor, in views of their own with one camera, or over each other.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.errors import ArgumentError
from hoi_retarget.viewers.scene.drawing import Scene, Subject
from hoi_retarget.viewers.scene.scene import (
    OBJECT_LAYERS,
    Shown,
    Side,
    centre_of,
    group_by_shared_objects,
    moved,
    reach_of,
    shifts_of,
    sides_of,
)


def make_panes(shown: Sequence[Shown]) -> Scene:
    """Return results and clips with a subject for each robot, and one for each human, where they were computed.

    Robots that move the same objects of one clip are one subject, and so are their humans. Who is there several times
    with the same motion, such as the human whom several results follow, is there once, and first.

    Args:
        shown: What to draw; titles name the robots.

    Raises:
        ArgumentError: There is nothing to show.
        GeometryError: An object's mesh file cannot be read.
    """
    if not shown:
        raise ArgumentError("there is nothing to show. Name a result or a clip.")
    places: dict[tuple[int, str], list[tuple[Shown, Side]]] = {}
    for item, host in zip(shown, group_by_shared_objects(shown), strict=True):
        for side in sides_of(item):
            places.setdefault((host, side.name), []).append((item, side))
    humans: list[list[tuple[Shown, Side]]] = []
    for (_, name), members in places.items():
        if name == "human" and not any(_same_people(members, others) for others in humans):
            humans.append(members)
    robots = [members for (_, name), members in places.items() if name == "robot"]
    ordered = [*humans, *robots]
    shifts = shifts_of([reach_of([side for _, side in members]) for members in ordered], "auto")
    clips = len(humans) > 1
    return Scene(tuple(_pane(members, shift, clips) for members, shift in zip(ordered, shifts, strict=True)))


def on_one_floor(panes: Scene) -> Scene:
    """Return the subjects of `make_panes` beside each other."""
    return Scene(
        tuple(
            replace(
                subject,
                layers=tuple(moved(layer, subject.shift) for layer in subject.layers),
                centre=subject.centre + subject.shift,
                looks={name: path + subject.shift for name, path in subject.looks.items()},
                shift=np.zeros(3),
            )
            for subject in panes.subjects
        )
    )


def _same_people(some: Sequence[tuple[Shown, Side]], others: Sequence[tuple[Shown, Side]]) -> bool:
    paths = [[(side.fps, side.pelvis.tobytes(), side.objects.tobytes()) for _, side in each] for each in (some, others)]
    return paths[0] == paths[1]


def _pane(members: Sequence[tuple[Shown, Side]], shift: Float[np.ndarray, "3"], clips: bool) -> Subject:
    (first, side), *rest = members
    layers = [*side.layers]
    looks = dict(side.looks)
    for item, other in rest:
        layers += [layer for layer in other.layers if layer.name not in OBJECT_LAYERS]
        looks |= {f"{name}, {item.title}": path for name, path in other.looks.items()}
    centre = np.mean([centre_of(each) for _, each in members], axis=0)
    if side.name == "robot":
        return Subject(", ".join(item.title for item, _ in members), side.fps, tuple(layers), centre, looks, shift)
    title = f"human, {first.clip.name}" if clips and first.clip is not None else "human"
    scale = first.motion.report.root_scale if first.motion is not None else None
    return Subject(title, side.fps, tuple(layers), centre, looks, shift, scale or 1.0)
