"""Whether what is held stays where it is held: what shows most mistakes in an object's poses and contacts.

While a part touches a moving object, its contact point keeps its place in the object's frame, up to slip. Read
with the inverse rotation, with another order of the quaternion, or with contacts of other frames, it does not. In 36
recordings points wander by 0.8 to 7.2 cm within a contact, and farther with inverted rotations: up to 20 times as
far where the object turns, hardly farther where it does not. What does not turn cannot be judged.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.errors import ClipError
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs

SHORTEST_SECONDS = 1 / 3
"""Contacts that are shorter say nothing about slip."""
LARGEST_SPREAD = 0.12
"""[m]; nothing is held that slips farther within one contact."""
SUSPECT_SPREAD = 0.04
"""[m]; from there on it is asked whether the contacts belong to other frames."""
LARGEST_REACH = 0.25
"""[m]; no part touches an object that is this far from its contact point."""
ANOTHER_UNIT = 5.0
"""[m]; a contact this far away is not only wrong, but in another unit."""
CLEARLY = 1.3
"""How many times smaller another reading's spread must be to be believed..."""
CLEARLY_BY = 0.01
"""...and by how much [m]."""
SHIFTS_SECONDS = (-1.0, -0.5, 0.5, 1.0)
"""Contacts are tried this much earlier and later."""

_READINGS: Mapping[str, str] = {
    "inverse": "inverse rotations",
    "scalar_last": "rotations in scalar-last order",
    "scalar_first": "rotations in scalar-first order",
}


@dataclass(frozen=True)
class GraspFigures:
    """How far contact points wander in the object's frame, root mean square over all frames of longer contacts."""

    frames: int
    """How many frames of contacts were looked at; without any, all spreads are 0."""
    spread: float
    """As read [m]."""
    other_readings: Mapping[str, float]
    """With the objects' rotations read otherwise [m]."""
    shifted: Mapping[float, float]
    """With contacts shifted by some seconds [m]."""
    reach: float
    """Median distance from contact points to the box around the touched object [m]; 0 without contacts."""


def grasp_figures(clip: Clip) -> GraspFigures:
    """Return how rigid the grasps of a clip are."""
    least = max(2, round(SHORTEST_SECONDS * clip.fps))
    held = [track for track in clip.contacts if track.active.any()]
    squares: dict[str, list[np.ndarray]] = {name: [] for name in ("as read", *_READINGS)}
    for track in held:
        item = clip.objects[track.object]
        offsets = clip.people[track.person].part_position(track.part) - item.positions
        quats = {
            "as read": item.quats,
            "inverse": se3.quat_conjugate(item.quats),
            "scalar_last": se3.quat_from_xyzw(item.quats),
            "scalar_first": se3.quat_to_xyzw(item.quats),
        }
        for name, rotations in quats.items():
            points = se3.rotate_inverse(rotations, offsets)
            squares[name] += [_deviations(points[a:b]) for a, b in track.segments if b - a >= least]
    spreads = {name: _root_mean(parts) for name, parts in squares.items()}
    return GraspFigures(
        frames=sum(map(len, squares["as read"])),
        spread=spreads.pop("as read"),
        other_readings=spreads,
        shifted={seconds: _shifted_spread(clip, held, round(seconds * clip.fps), least) for seconds in SHIFTS_SECONDS},
        reach=_reach(clip, held),
    )


def grasp_faults(figures: GraspFigures) -> tuple[str, ...]:
    """Return what the figures say against a clip, one sentence each; a fault of rotations or units comes first."""
    fatal = fatal_fault(figures)
    if fatal:
        return (fatal,)
    texts: tuple[str, ...] = ()
    if figures.reach > LARGEST_REACH:
        texts += (
            f"Parts that are said to touch are mostly {figures.reach:.2f} m or more from the object: contacts, "
            "positions or the object's size are wrong.",
        )
    best = min(figures.shifted, key=lambda seconds: figures.shifted[seconds])
    if _clearly_better(figures.shifted[best], figures.spread) and figures.spread > SUSPECT_SPREAD:
        texts += (
            f"Contacts fit better {abs(best):g} s {'later' if best > 0 else 'earlier'}: points wander by "
            f"{figures.shifted[best]:.3f} m in the object's frame then, by {figures.spread:.3f} m as they are.",
        )
    elif figures.spread > LARGEST_SPREAD:
        texts += (
            f"What is held slips: contact points wander by {figures.spread:.3f} m in the object's frame within one "
            f"contact, expected at most {LARGEST_SPREAD:g} m. The object's poses or the contacts are wrong.",
        )
    return texts


def fatal_fault(figures: GraspFigures) -> str:
    """Return why a clip must not be used: other rotations fit clearly better, or units differ; empty where neither."""
    if figures.reach > ANOTHER_UNIT:
        return (
            f"Parts that are said to touch are mostly {figures.reach:.4g} m from the object: the object's positions "
            "are in another unit than the person's, or of another world. Convert the clip again."
        )
    best = min(figures.other_readings, key=lambda name: figures.other_readings[name])
    if _clearly_better(figures.other_readings[best], figures.spread):
        return (
            f"The objects' rotations are read wrongly: with {_READINGS[best]}, contact points wander by "
            f"{figures.other_readings[best]:.3f} m in the object's frame, as read by {figures.spread:.3f} m. What is "
            "held does not slip that far. Convert the clip again."
        )
    return ""


def checked(clip: Clip) -> Clip:
    """Return a clip with warnings of grasps that contradict its object's path.

    Raises `ClipError` where rotations or units are wrong beyond doubt.
    """
    figures = grasp_figures(clip)
    fatal = fatal_fault(figures)
    if fatal:
        raise ClipError(f"{clip.source.path or clip.name}: {fatal}")
    known = {str(warning) for warning in clip.source.warnings}
    return clip.with_warnings("grasp", tuple(text for text in grasp_faults(figures) if text not in known))


def _clearly_better(other: float, spread: float) -> bool:
    return spread > CLEARLY * other and spread > other + CLEARLY_BY


def _deviations(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    return np.sum((points - points.mean(axis=0)) ** 2, axis=1)


def _root_mean(parts: list[np.ndarray]) -> float:
    return float(np.sqrt(np.concatenate(parts).mean())) if parts else 0.0


def _shifted_spread(clip: Clip, held: list[ContactTrack], shift: int, least: int) -> float:
    """Return the spread with contacts some frames later; frames that leave the clip are left out."""
    parts = []
    for track in held:
        points = clip.objects[track.object].to_object(clip.people[track.person].part_position(track.part))
        before = np.arange(len(points)) - shift
        within = (before >= 0) & (before < len(points))
        moved = within & track.active[np.where(within, before, 0)]
        parts += [_deviations(points[a:b]) for a, b in runs(moved) if b - a >= least]
    # Where few frames of contact are left, nothing speaks for the shift.
    held_before = sum(b - a for track in held for a, b in track.segments if b - a >= least)
    return _root_mean(parts) if 2 * sum(map(len, parts)) > held_before else float("inf")


def _reach(clip: Clip, held: list[ContactTrack]) -> float:
    distances = []
    for track in held:
        item = clip.objects[track.object]
        points = item.to_object(clip.people[track.person].part_position(track.part))[track.active]
        low, high = item.geometry.points.min(axis=0), item.geometry.points.max(axis=0)
        distances.append(np.linalg.norm(np.maximum(np.maximum(low - points, points - high), 0.0), axis=1))
    return float(np.median(np.concatenate(distances))) if distances else 0.0
