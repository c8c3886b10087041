"""From which side of an object each of the human's contacts is made: a robot's hand comes out of it on that side."""

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import frames_in
from hoi_retarget.retargeting.surfaces.moving_object import MovingObject
from hoi_retarget.retargeting.targets import Targets

APPROACH_SECONDS = 1 / 3
"""Before and after a contact, in which the human's part is outside the object on the side from which it came."""
STEADY_SECONDS = 0.27
"""A side turns over this time, as where a hand slips around an edge."""
CLEARLY_OUTSIDE = 0.04
"""[m]; a part that is so far outside shows its side as well as any."""
EDITED = 0.03
"""[m]; a contact point that is so far from the human's part was placed by somebody."""


def contact_sides(targets: Targets, objects: tuple[MovingObject, ...]) -> Float[np.ndarray, "T C 3"]:
    """Return the outward direction of every contact, in the object's frame; zero in frames without.

    In each run of contact it is the mean of the surface's normals nearest to the human's part, in frames of the run and
    of its approach, weighted by how far outside the part is and by nearness in time. So a part inside a thin wall
    has the side on which it was before.
    """
    sides = np.zeros_like(targets.part_points)
    margin = frames_in(APPROACH_SECONDS, targets.fps)
    for link in range(len(targets.contact_links)):
        for first, stop in runs(targets.contact_weights[:, link] > 0):
            window = slice(max(0, first - margin), min(targets.frames, stop + margin))
            for index in np.unique(targets.carried_contact_object[first:stop, link]):
                inside = np.flatnonzero(targets.carried_contact_object[first:stop, link] == index) + first
                sides[inside, link] = _sides(targets, objects[index], link, window)[inside - window.start]
    return sides


def _sides(targets: Targets, thing: MovingObject, link: int, window: slice) -> Float[np.ndarray, "F 3"]:
    points = _points(targets, link)[window]
    distances, normals = thing.distances_and_normals(points.T)
    shown = np.clip(distances, 1e-5, CLEARLY_OUTSIDE) * normals
    time = np.arange(len(points)) / frames_in(STEADY_SECONDS, targets.fps)
    # Falls slowly: in the midst of a long contact inside a wall, only the approach shows the side.
    nearness = 1.0 / (1.0 + (time[:, None] - time) ** 2)
    mean = nearness @ shown.T
    lengths = np.linalg.norm(mean, axis=1, keepdims=True)
    return np.where(lengths > 1e-9, mean / np.maximum(lengths, 1e-9), normals.T)


def _points(targets: Targets, link: int) -> Float[np.ndarray, "T 3"]:
    """Return the part's path in the object's frame; the contact points where these were placed elsewhere."""
    placed = np.nan_to_num(targets.contact_points[:, link])
    apart = np.linalg.norm(placed - targets.part_points[:, link], axis=1)
    edited = targets.contact_flags[:, link] & (apart > EDITED)
    return np.where(edited[:, None], placed, targets.part_points[:, link])
