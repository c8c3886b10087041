"""Contacts that the robot did not reach: named one by one, never hidden in a mean."""

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.evaluation.object_distances import PART_SITES
from hoi_retarget.evaluation.statistics import norms
from hoi_retarget.evaluation.surface_curves import surface_curves
from hoi_retarget.evaluation.view import Comparison
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.report import ELSEWHERE_M, UNREACHED_M, UnreachedContact
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.robots.model import Kinematics

SHORTEST_UNREACHED = 3
"""Frames; a hand that takes one or two more to arrive did reach its contact."""


def unreached_contacts(
    motion: Motion,
    kinematics: Kinematics,
    *,
    residuals: Float[np.ndarray, "T C"] | None = None,
    limit_m: float = UNREACHED_M,
) -> tuple[UnreachedContact, ...]:
    """Return where contact links stay further than `limit_m` [m] from their targets, in order of link and time.

    The residual is the distance in the object's frame between a contact link and the target that the motion
    was asked to touch. Stretches of `SHORTEST_UNREACHED` frames count, and contacts that are missed altogether
    however short. All frames count, the first one too.

    Args:
        motion: The robot's motion; its contact links are sites of the robot, or human parts standing for them.
        kinematics: The model's `forward(motion.qpos)`.
        residuals: Other distances to judge by [m], such as `surface_residuals`.
        limit_m: Largest residual that counts as reached [m].
    """
    found = []
    residuals = contact_residuals(motion, kinematics) if residuals is None else residuals
    for column, link in enumerate(motion.contact_links):
        off = ~(residuals[:, column] <= limit_m)
        touched = _touched(motion, column)
        for index in range(len(motion.object_names)):
            for first, end in _unreached_runs(touched == index, off):
                lengths = residuals[first:end, column]
                mean, largest = float(lengths.mean()), float(lengths.max())
                found.append(UnreachedContact(link, motion.object_names[index], first, end - 1, mean, largest))
    return tuple(sorted(found, key=lambda segment: (motion.contact_links.index(segment.link), segment.first_frame)))


def contact_residuals(motion: Motion, kinematics: Kinematics) -> Float[np.ndarray, "T C"]:
    """Return the distance on the object [m] of each contact link from its target; NaN where it touches nothing."""
    residuals = np.full(motion.contact_flags.shape, np.nan)
    for column, link in enumerate(motion.contact_links):
        touched = _touched(motion, column)
        frames = np.flatnonzero(touched >= 0)
        if not len(frames):
            continue
        objects = touched[frames]
        away = kinematics.site_position(PART_SITES.get(link, link))[frames] - motion.object_pos[frames, objects]
        inside = se3.rotate_inverse(motion.object_quat[frames, objects], away)
        residuals[frames, column] = norms(inside - motion.contact_points[frames, column])
    return residuals


def surface_residuals(view: Comparison) -> Float[np.ndarray, "T C"]:
    """Return how far each contact link is from touch [m]; NaN where there is none.

    That is how far its skin is from the surface; where it is at another place of the object, it is how far that one is.
    Frames before the first that counts are as that one. Raises `GeometryError` when an object's mesh cannot be read.
    """
    motion = view.motion
    residuals = np.full(motion.contact_flags.shape, np.nan)
    sites = [PART_SITES.get(link, link) for link in motion.contact_links]
    for curve in view.once(surface_curves).touches:
        column = sites.index(PART_SITES[curve.part])
        asked = _touched(motion, column) == curve.object
        off = np.where(curve.place > ELSEWHERE_M, curve.place, np.maximum(curve.gap, 0.0))
        off = np.concatenate([np.repeat(off[:1], view.first), off])
        residuals[asked, column] = off[asked]
    return residuals


def _touched(motion: Motion, column: int) -> Int[np.ndarray, "T"]:
    """Return the index of the object that a contact link touches, -1 where none."""
    return np.where(motion.contact_flags[:, column], motion.contact_object[:, column], -1)


def _unreached_runs(touched: Bool[np.ndarray, "T"], off: Bool[np.ndarray, "T"]) -> list[tuple[int, int]]:
    """Return stretches of contacts that are off: those that last, and contacts that are off altogether."""
    contacts = set(runs(touched))
    return [run for run in runs(touched & off) if run[1] - run[0] >= SHORTEST_UNREACHED or run in contacts]
