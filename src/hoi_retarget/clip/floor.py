"""The floor of a recording, from its format, from the user, or from standing soles; what rests is a second witness.

Every decision becomes a note of the clip.
"""

from dataclasses import replace

import numpy as np

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.resting import floor_rests
from hoi_retarget.human.capsules import PART_CAPSULES, spheres
from hoi_retarget.human.skeleton import FEET
from hoi_retarget.numerics.filters import speeds

STANDING_SPEED = 0.15
"""[m/s]; a sole that is slower stands on something. Stricter than `stance.STANCE_SPEED`: stance looks at the height
over the floor, too, which is not known here."""
FLOOR_PERCENTILE = 10.0
"""Of the heights of standing soles: low enough for people who also stand on things, above what noise reaches."""
LEAST_STANDING = 5
"""Frames of standing that a floor's height is believed from."""
FLOOR_TOLERANCE = 0.15
"""[m]; soles that stand farther from the floor than this stand on something, or the floor is elsewhere."""

WITNESS_TOLERANCE = 0.025
"""[m]; soles are known this well. What rests on the floor is not farther from where they have it."""


def on_floor(clip: Clip, *, at_zero: bool, floor: float | None = None) -> Clip:
    """Return a clip shifted so that the floor is at z = 0.

    Args:
        clip: z is up.
        at_zero: whether its format promises that the floor is there already.
        floor: height of the floor in the clip [m], where somebody knows it; otherwise it is estimated.
    """
    if floor is not None:
        lowered = _lowered(clip, floor, f"The floor is at z = {floor:.3f} m in the recording, as was asked for.")
        return lowered.with_warnings("floor_elsewhere", _feet_elsewhere(lowered, floor))
    if at_zero:
        return clip.with_warnings("floor_elsewhere", _feet_elsewhere(clip, 0.0))
    height, frames = floor_height(clip)
    how = (
        f"{frames} frames of standing feet" if frames else "the lowest point of anybody's feet, which never stand still"
    )
    lowered = _lowered(clip, height, f"The floor is at z = {height:.3f} m in the recording, estimated from {how}.")
    return lowered.with_warnings("floor_elsewhere", _objects_elsewhere(lowered, height))


def floor_height(clip: Clip) -> tuple[float, int]:
    """Return the height of the floor [m] that soles stand on, and in how many frames of a foot they do."""
    heights, slow = [], []
    for person in clip.people:
        for foot in FEET:
            balls = spheres(person, PART_CAPSULES[foot])
            heights.append(
                balls.lowest if person.toe_height is None else person.position(foot)[:, 2] - person.toe_height
            )
            slow.append(speeds(balls.middles, clip.fps).max(axis=1) < STANDING_SPEED)
    soles, stands = np.concatenate(heights), np.concatenate(slow)
    if stands.sum() < LEAST_STANDING:
        return float(soles.min()), 0
    return float(np.percentile(soles[stands], FLOOR_PERCENTILE)), int(stands.sum())


def _feet_elsewhere(clip: Clip, floor: float) -> tuple[str, ...]:
    """Return a warning where feet stand elsewhere than on the floor, which was put at zero from the height `floor`."""
    height, frames = floor_height(clip)
    if not frames or abs(height) <= FLOOR_TOLERANCE:
        return ()
    return (
        f"Feet stand at z = {height:.2f} m, not on the floor at 0: pass --floor {floor + height:.2f} unless they stand "
        "on something.",
    )


def _objects_elsewhere(clip: Clip, floor: float) -> tuple[str, ...]:
    """Return a warning where what rests lies off the floor, which was put at zero from the height `floor`."""
    rests = floor_rests(clip)
    heights = {
        track.name: float(np.median(track.lowest[resting]))
        for track, resting in zip(clip.objects, rests, strict=True)
        if resting.any()
    }
    name = min(heights, key=lambda name: heights[name], default="")
    if not name or abs(heights[name]) <= WITNESS_TOLERANCE:
        return ()
    return (
        f"{name} rests at z = {heights[name]:.3f} m, where feet have the floor at 0: pass --floor "
        f"{floor + heights[name]:.3f} if it stands on the floor.",
    )


def _lowered(clip: Clip, height: float, note: str) -> Clip:
    down = np.array([0.0, 0.0, height])
    return replace(
        clip,
        people=tuple(replace(person, joint_positions=person.joint_positions - down) for person in clip.people),
        objects=tuple(replace(track, positions=track.positions - down) for track in clip.objects),
        source=replace(clip.source, notes=(*clip.source.notes, note)),
    )
