"""Slip figures: robots' hands that move over objects while the person's own hold still on them."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget.evaluation.comparison import HAND_SITES, Comparison, figure, mean_or_none, norms
from hoi_retarget.numerics.arrays import runs

_MIN_SECONDS, _END_SECONDS = 5 / 6, 4 / 15
"""Shorter contacts do not count, nor each one's ends: hands arrive and leave there."""
_HELD_MPS = 0.05  # A person's hand slower than this over the object holds it [m/s].
_FAST_MPS = 0.10  # No hand that holds anything is as fast [m/s].


@dataclass(frozen=True, eq=False)
class SlipCurve:
    """One hand on one object that it is labelled to touch, over the F counted frames."""

    part: str
    object: int
    robot: Float[np.ndarray, "F"]
    """Speed of the robot's palm in the object's frame since the frame before [m/s]; NaN outside contact."""
    human: Float[np.ndarray, "F"]  # The same of the person's palm.
    held: Bool[np.ndarray, "F"]  # Frames that count: well within a contact, the person's hand still on the object.
    wanders: Float[np.ndarray, "S 2"]
    """How far robot's and person's palm wander within each contact: diagonal of the box, along the object's axes,
    around its places [m]."""


@figure("hand slip", "mm/s")
def hand_slip_mps(view: Comparison) -> float | None:
    """Mean speed of a hand over the object it touches while the person's own holds still [m/s]."""
    return mean_or_none(_held_speeds(view))


@figure("person's slip", "mm/s")
def person_slip_mps(view: Comparison) -> float | None:
    """Mean speed of the person's own hand over the object in the same frames [m/s]."""
    return mean_or_none(_pooled(curve.human[curve.held] for curve in _curves(view)))


@figure("fast slip", "%")
def hand_slip_fast_share(view: Comparison) -> float | None:
    """Share of these frames in which the hand moves over the object at more than 10 cm/s."""
    return mean_or_none((_held_speeds(view) > _FAST_MPS).astype(float))


@figure("hand wander", "mm")
def hand_wander_excess_m(view: Comparison) -> float | None:
    """Way that a hand wanders over the object within one contact, beyond the person's [m]."""
    return mean_or_none(_pooled(np.subtract(*curve.wanders.T) for curve in _curves(view)))


@figure("person's wander", "mm")
def person_wander_m(view: Comparison) -> float | None:
    """Way that the person's own hand wanders over the object within one contact [m]."""
    return mean_or_none(_pooled(curve.wanders[:, 1] for curve in _curves(view)))


def slip_curves(view: Comparison) -> tuple[SlipCurve, ...]:
    """Return the slip of every labelled contact of a hand, part by part and object by object."""
    return tuple(
        _slip(view, part, index, active)
        for part in HAND_SITES
        for index in range(view.object_count)
        if (active := _labelled(view, part, index)).any()
    )


def _curves(view: Comparison) -> tuple[SlipCurve, ...]:
    return view.cached(slip_curves)


def _held_speeds(view: Comparison) -> Float[np.ndarray, "K"]:
    return _pooled(curve.robot[curve.held] for curve in _curves(view))


def _pooled(arrays: Iterable[Float[np.ndarray, "_"]]) -> Float[np.ndarray, "K"]:
    return np.concatenate([np.zeros(0), *arrays])


def _labelled(view: Comparison, part: str, index: int) -> Bool[np.ndarray, "F"]:
    active = np.zeros(view.clip.frames - view.first, dtype=bool)
    own = (track.active for track in view.contacts if (track.part, track.object) == (part, index))
    return np.logical_or.reduce([active, *own])


def _slip(view: Comparison, part: str, index: int, active: Bool[np.ndarray, "F"]) -> SlipCurve:
    fps = view.motion.fps
    robot = view.robot_objects[index].points_inside(view.robot_point(HAND_SITES[part]))
    human = view.human_objects[index].points_inside(view.human_part_point(part))
    speed, own = (np.concatenate([[np.nan], fps * norms(np.diff(path, axis=0))]) for path in (robot, human))
    shortest, end = round(_MIN_SECONDS * fps), round(_END_SECONDS * fps)
    held, wanders = np.zeros(len(active), dtype=bool), []
    for first, stop in runs(active, shortest):
        within = slice(first + end, stop - end)
        held[first + end + 1 : stop - end] = True  # The speed since a frame that counts, too.
        wanders.append([float(np.linalg.norm(np.ptp(path[within], axis=0))) for path in (robot, human)])
    outside = ~np.concatenate([[False], active[1:] & active[:-1]])
    speed[outside], own[outside] = np.nan, np.nan
    with np.errstate(invalid="ignore"):
        held &= own < _HELD_MPS
    return SlipCurve(part, index, speed, own, held, np.reshape(wanders, (-1, 2)))
