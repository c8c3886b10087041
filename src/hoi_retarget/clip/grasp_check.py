"""A check that grasps are rigid: most mistakes in an object's poses and contacts show in slipping grasps.

While a part touches a moving object, its contact point keeps its place in the object's frame, up to slip. Read
with the inverse rotation, with another order of the quaternion, or with contacts of other frames, it does not. In 36
recordings points wander by 0.8 to 7.2 cm within a contact, and farther with inverted rotations: up to 20 times as
far where the object turns, hardly farther where it does not. Grasps of objects that do not turn cannot be judged.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.clip.clip import Clip, ContactTrack, Severity
from hoi_retarget.clip.read_options import Grasps
from hoi_retarget.errors import ClipError
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import runs

_MIN_CONTACT_SECONDS = 1 / 3  # Shorter contacts are no evidence of slip.
MAX_SPREAD = 0.12  # [m]; an object that slips farther within one contact is not held.
_SUSPECT_SPREAD = 0.04  # [m]; from there on contacts of other frames are compared.
ADVICE = "If it is right nonetheless, as of an object that is turned in the hand, pass --grasps warn."
"""For a clip that is refused wrongly."""
_MAX_REACH = 0.25  # [m]; no part touches an object that is this far from its contact point.
_HOPELESS_REACH = 0.5  # [m]; no motion of it is of use.
_MAX_METRIC_REACH = 5.0  # [m]; a contact this far away is not only wrong, but in another unit.
MIN_SPREAD_RATIO, MIN_SPREAD_GAIN = 1.3, 0.01
"""Another reading is believed if its spread is so many times smaller, and by so much [m]."""
SHIFTS_SECONDS = (-1.0, -0.5, 0.5, 1.0)  # Contacts of a source are compared at so much earlier and later frames.

READINGS: Mapping[str, tuple[str, Callable[[np.ndarray], np.ndarray]]] = {
    "inverse": ("inverse rotations", se3.quat_conjugate),
    "scalar_last": ("rotations in scalar-last order", se3.quat_from_xyzw),
    "scalar_first": ("rotations in scalar-first order", se3.quat_to_xyzw),
}
"""Other readings of an object's rotations, by name: in words, and the rotations by them."""
ONLY_INVERSE = ("inverse",)
"""The other readings where rotations are stored as matrices or vectors: there is no order of numbers."""


@dataclass(frozen=True)
class GraspFigures:
    """Wandering of contact points in the object's frame, root mean square over all frames of longer contacts."""

    frames: int  # Number of frames of these contacts; without any, all spreads are 0.
    spread: float  # As read [m].
    other_readings: Mapping[str, float]  # With the objects' rotations read otherwise [m].
    shifted: Mapping[float, float]  # With contacts shifted by some seconds [m].
    reach: float  # Median distance from contact points to the box around the touched object [m]; 0 without contacts.


def grasp_figures(
    clip: Clip, readings: Collection[str] = tuple(READINGS), shifts: Collection[float] = SHIFTS_SECONDS
) -> GraspFigures:
    """Return the figures of a clip's grasps, with some of `READINGS` and shifts of contacts [s] to compare with."""
    least = max(2, round(_MIN_CONTACT_SECONDS * clip.fps))
    held = [track for track in clip.contacts if track.active.any()]
    points = [_points(clip, track) for track in held]
    longer = [runs(track.active, least) for track in held]
    deviations = _deviations(points, longer)

    def shifted(frames: int) -> float:
        moved = _deviations(points, [runs(_later(track.active, frames), least) for track in held])
        # Where few frames of contact are left, nothing speaks for the shift.
        return _root_mean(moved) if 2 * len(moved) > len(deviations) else float("inf")

    return GraspFigures(
        frames=len(deviations),
        spread=_root_mean(deviations),
        other_readings={
            name: _root_mean(_deviations([_points(clip, track, READINGS[name][1]) for track in held], longer))
            for name in readings
        },
        shifted={seconds: shifted(round(seconds * clip.fps)) for seconds in shifts},
        reach=_reach(clip, held, points),
    )


def grasp_faults(figures: GraspFigures) -> tuple[str, ...]:
    """Return the faults of a clip by its figures, a sentence each; one of rotations or units stands alone."""
    fatal = fatal_fault(figures)
    if fatal:
        return (fatal,)
    texts: tuple[str, ...] = ()
    if figures.reach > _MAX_REACH:
        texts += (
            f"Parts that are said to touch are mostly {figures.reach:.2f} m or more from the object: contacts, "
            "positions or the object's size are wrong.",
        )
    shifted, best = min(((spread, seconds) for seconds, spread in figures.shifted.items()), default=(np.inf, 0.0))
    if _clearly_better(shifted, figures.spread) and figures.spread > _SUSPECT_SPREAD:
        texts += (
            f"Contacts fit better {abs(best):g} s {'later' if best > 0 else 'earlier'}: points wander by "
            f"{shifted:.3f} m in the object's frame then, by {figures.spread:.3f} m as they are.",
        )
    elif figures.spread > MAX_SPREAD:
        texts += (
            f"What is held slips: contact points wander by {figures.spread:.3f} m in the object's frame within one "
            f"contact, expected at most {MAX_SPREAD:g} m. The object's poses or the contacts are wrong.",
        )
    return texts


def fatal_fault(figures: GraspFigures) -> str:
    """Return why a clip must not be used: other rotations fit clearly better, or units differ; empty where neither."""
    if figures.reach > _MAX_METRIC_REACH:
        return (
            f"Parts that are said to touch are mostly {figures.reach:.4g} m from the object: the object's positions "
            "are in another unit than the person's, or of another world. Convert the clip again."
        )
    other, best = min(((spread, name) for name, spread in figures.other_readings.items()), default=(np.inf, ""))
    if _clearly_better(other, figures.spread):
        return (
            f"The objects' rotations are read wrongly: with {READINGS[best][0]}, contact points wander by "
            f"{other:.3f} m in the object's frame, as read by {figures.spread:.3f} m. What is "
            "held does not slip that far. Convert the clip again."
        )
    return ""


def with_grasp_warnings(
    clip: Clip,
    readings: Collection[str] = tuple(READINGS),
    shifts: Collection[float] = SHIFTS_SECONDS,
    *,
    grasps: Grasps = "refuse",
) -> Clip:
    """Return a clip with warnings of grasps that contradict its object's path.

    Raises `ClipError` where rotations or units are wrong, and `grasps` is `refuse`.

    `clip`: its contacts are checked; `readings`: those of `READINGS` that its format leaves open; `shifts`: by which
    labels may be late [s]; none where contacts were found in these very frames; `grasps`: `warn` keeps a clip that is
    wrong, and takes no fault of its grasps for an error.
    """
    figures = grasp_figures(clip, readings, shifts)
    fatal = fatal_fault(figures)
    if fatal and grasps == "refuse":
        raise ClipError(f"{clip.source.path or clip.name}: {fatal} {ADVICE}")
    known = {str(warning) for warning in clip.source.warnings}
    severity = Severity.ERROR if grasps == "refuse" and figures.reach > _HOPELESS_REACH else Severity.WARNING
    return clip.with_warnings("grasp", tuple(text for text in grasp_faults(figures) if text not in known), severity)


def _clearly_better(other: float, spread: float) -> bool:
    return spread > MIN_SPREAD_RATIO * other and spread > other + MIN_SPREAD_GAIN


def _points(
    clip: Clip, track: ContactTrack, reading: Callable[[np.ndarray], np.ndarray] | None = None
) -> Float[np.ndarray, "T 3"]:
    """Return a part's place in the frame of the object that it touches [m], with another reading of its rotations."""
    item = clip.objects[track.object]
    offsets = clip.people[track.person].part_position(track.part) - item.positions
    return se3.rotate_inverse(reading(item.quats) if reading else item.quats, offsets)


def _deviations(points: list[np.ndarray], spans: list[tuple[tuple[int, int], ...]]) -> Float[np.ndarray, "n"]:
    """Return the squared distances of points from their mean in each of their spans [m^2]."""
    parts = [own[first:stop] for own, runs_of_it in zip(points, spans, strict=True) for first, stop in runs_of_it]
    return np.concatenate([np.zeros(0), *(np.sum((part - part.mean(axis=0)) ** 2, axis=1) for part in parts)])


def _root_mean(squares: Float[np.ndarray, "n"]) -> float:
    return float(np.sqrt(squares.mean())) if len(squares) else 0.0


def _later(active: Bool[np.ndarray, "T"], frames: int) -> Bool[np.ndarray, "T"]:
    """Return flags some frames later, without those beyond the clip."""
    before = np.arange(len(active)) - frames
    within = (before >= 0) & (before < len(active))
    return within & active[np.where(within, before, 0)]


def _reach(clip: Clip, held: list[ContactTrack], points: list[np.ndarray]) -> float:
    distances = []
    for track, own in zip(held, points, strict=True):
        corners = clip.objects[track.object].geometry.points
        beyond = np.maximum(corners.min(axis=0) - own[track.active], own[track.active] - corners.max(axis=0))
        distances.append(np.linalg.norm(np.maximum(beyond, 0.0), axis=1))
    return float(np.median(np.concatenate(distances))) if distances else 0.0
