"""Contacts that the robot did not reach, named one by one, never hidden in a mean."""

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.evaluation.comparison import Comparison, norms
from hoi_retarget.evaluation.contact_figures import surface_curves
from hoi_retarget.evaluation.surface_distances import PART_SITES
from hoi_retarget.human.skeleton import FINGER_PARTS
from hoi_retarget.motion.motion import Motion
from hoi_retarget.motion.motion_report import ELSEWHERE_M, UNREACHED_M, Event
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.robots.model import Kinematics
from hoi_retarget.robots.spec import BODY_SITES

_MIN_FRAMES = 3  # Frames; a hand that takes one or two more to arrive did reach its contact.


def unreached_contacts(
    motion: Motion,
    kinematics: Kinematics,
    *,
    residuals: Float[np.ndarray, "T C"] | None = None,
    limit_m: float = UNREACHED_M,
) -> tuple[Event, ...]:
    """Return where contact links stay further than `limit_m` [m] from their targets, in order of link and time.

    The residual is the distance in the object's frame between a contact link and its target. Stretches of 3 frames
    count, and contacts that are missed altogether however short. All frames count, the first one too.

    `motion`: the robot's motion; its contact links are sites of the robot, or human parts standing for them;
    `kinematics`: the model's `forward(motion.qpos)`; `residuals`: other distances to judge by [m], such as
    `surface_residuals`; `limit_m`: largest residual that counts as reached [m].
    """
    found = []
    residuals = contact_residuals(motion, kinematics) if residuals is None else residuals
    for column, link in enumerate(motion.contact_links):
        off = ~(residuals[:, column] <= limit_m)
        touched = _touched(motion, column)
        for index in range(len(motion.object_names)):
            for first, end in _unreached_runs(touched == index, off):
                lengths = residuals[first:end, column]
                found.append(
                    Event(
                        "unreached_contact",
                        first,
                        end - 1,
                        float(lengths.max()),
                        subject=link,
                        object=motion.object_names[index],
                        mean=float(lengths.mean()),
                    )
                )
    return tuple(sorted(found, key=lambda event: (motion.contact_links.index(event.subject), event.first_frame)))


def contact_residuals(motion: Motion, kinematics: Kinematics) -> Float[np.ndarray, "T C"]:
    """Return the distance on the object [m] of each contact link from its target; NaN where it touches nothing."""
    return norms(contact_offsets(motion, kinematics))


def contact_offsets(motion: Motion, kinematics: Kinematics) -> Float[np.ndarray, "T C 3"]:
    """Return the path on the object [m] from each contact link's target to the link; NaN where it touches nothing."""
    offsets = np.full(motion.contact_points.shape, np.nan)
    for column, link in enumerate(motion.contact_links):
        touched = _touched(motion, column)
        frames = np.flatnonzero(touched >= 0)
        if not len(frames):
            continue
        objects = touched[frames]
        away = kinematics.site_position(PART_SITES.get(link, link))[frames] - motion.object_pos[frames, objects]
        inside = se3.rotate_inverse(motion.object_quat[frames, objects], away)
        offsets[frames, column] = inside - motion.contact_points[frames, column]
    return offsets


NEAR_SURFACE_M = 0.05
"""From the surface to a point that is never in thin air [m]: palms' middles lie 3 cm off it in the median recording."""
FARTHER_M = 0.01
"""Farther than this beyond all recorded points of a part on an object, an edited one is in thin air [m]."""


def thin_air_contacts(clip: Clip, person: int = 0) -> tuple[Event, ...]:
    """Return where edited contacts of a person ask for touch in thin air; none where nothing was edited.

    Raises `GeometryError` when an object's mesh cannot be read.
    """
    if not clip.recorded_contacts:
        return ()
    found, farthest = [], {}
    for track in clip.recorded_contacts:
        key = track.person, track.part, track.object
        farthest[key] = max(farthest.get(key, 0.0), float(_off_surface(clip, track)[track.active].max(initial=0.0)))
    for track in clip.contacts:
        off, key = _off_surface(clip, track), (track.person, track.part, track.object)
        if track.person == person and track.part not in FINGER_PARTS:  # Fingers are put on it.
            limit, name = max(NEAR_SURFACE_M, farthest.get(key, 0.0) + FARTHER_M), clip.objects[track.object].name
            found += [
                Event("thin_air_contact", first, stop - 1, float(off[first:stop].max()), track.part, name)
                for first, stop in runs(off > limit)
            ]
    return tuple(found)


def _off_surface(clip: Clip, track: ContactTrack) -> Float[np.ndarray, "T"]:
    """Return the distance of contact points from the object's surface at captured size [m]; 0 where inactive."""
    off = np.zeros(clip.frames)
    if track.active.any():
        off[track.active] = surface_of(clip.objects[track.object].geometry).distances(
            track.contact_points[track.active]
        )
    return off


def surface_residuals(view: Comparison) -> Float[np.ndarray, "T C"]:
    """Return the distance of each contact link from touch [m]; NaN where it touches nothing.

    That is the distance of its skin from the surface, or of touching skin from the human's place where that is
    elsewhere. Frames before the first that counts are as that one. Raises `GeometryError` when an object's mesh cannot
    be read.
    """
    motion = view.motion
    residuals = np.full(motion.contact_flags.shape, np.nan)
    sites = [PART_SITES.get(link, link) for link in motion.contact_links]
    for curve in view.cached(surface_curves).touches:
        if PART_SITES[curve.part] not in sites:
            continue  # Landmarks are of hands and feet alone, and nothing rests that a base carries.
        column = sites.index(PART_SITES[curve.part])
        labelled = _touched(motion, column) == curve.object
        elsewhere = (curve.uncovered > ELSEWHERE_M) & (curve.part not in BODY_SITES)  # Short legs sit on the edge.
        off = np.where(elsewhere, curve.uncovered, np.maximum(curve.gap, 0.0))
        off = np.concatenate([np.repeat(off[:1], view.first), off])
        residuals[labelled, column] = off[labelled]
    return residuals


def _touched(motion: Motion, column: int) -> Int[np.ndarray, "T"]:
    """Return the index of the object that a contact link touches, -1 where none."""
    return np.where(motion.contact_flags[:, column], motion.contact_object[:, column], -1)


def _unreached_runs(touched: Bool[np.ndarray, "T"], off: Bool[np.ndarray, "T"]) -> list[tuple[int, int]]:
    """Return stretches of contacts that are off, if they last or are whole contacts, as (first, one past the last)."""
    contacts = set(runs(touched))
    return [run for run in runs(touched & off) if run[1] - run[0] >= _MIN_FRAMES or run in contacts]
