"""Links that are inside an object: named one by one with their frames, their depth and why."""

import numpy as np

from hoi_retarget.evaluation.object_distances import part_skins
from hoi_retarget.evaluation.surface_curves import surface_curves
from hoi_retarget.evaluation.view import Comparison
from hoi_retarget.motion.report import SunkLink
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.objects.mesh import surface_of

SUNK = 5e-3
"""[m]; skins and meshes are known to a millimetre, and palms of rubber give way by as much."""
SHORTEST = 3
"""Frames."""
HUMAN_INSIDE = 2e-3
"""[m]; a human part that is so far inside the object asks the robot's to be there."""


def sunk_links(view: Comparison) -> tuple[SunkLink, ...]:
    """Return where links are more than `SUNK` inside an object for `SHORTEST` frames or longer.

    Frames are those of the motion. Raises `GeometryError` when an object's mesh cannot be read.
    """
    curves = view.once(surface_curves)
    found = []
    for index, name in enumerate(view.motion.object_names):
        for link, depth in zip(curves.links, curves.depth[index], strict=True):
            for first, stop in runs(depth > SUNK):
                if stop - first < SHORTEST:
                    continue
                reason = _reason(view, index, link, first, stop)
                largest = float(depth[first:stop].max())
                found.append(SunkLink(link, name, view.first + first, view.first + stop - 1, largest, reason))
    return tuple(found)


def _reason(view: Comparison, index: int, link: str, first: int, stop: int) -> str:
    inside = _human_depth(view, index, link, first, stop)
    if inside > HUMAN_INSIDE:
        return f"the human's own part is up to {1e3 * inside:.0f} mm inside it there"
    return "no pose near by keeps the contacts and is free of it"


def _human_depth(view: Comparison, index: int, link: str, first: int, stop: int) -> float:
    """Return how deep the contact points of the part that a link stands for are in the object [m]."""
    model = view.kinematics.model
    frames = slice(view.first + first, view.first + stop)
    points = [
        track.contact_points[frames][track.active[frames]]
        for track in view.clip.contacts
        if track.person == view.person
        and track.object == index
        and link in {skin.link for skin in part_skins(model, track.part)}
    ]
    pooled = np.concatenate([np.zeros((0, 3)), *points])
    if not len(pooled):
        return 0.0
    scale = float(view.motion.object_scale[index])
    return scale * max(0.0, -float(surface_of(view.clip.objects[index].geometry).signed_distances(pooled).min()))
