"""The floor of a recording, from its format, from the user, or from standing soles; resting objects are witnesses.

Every decision becomes a note of the clip. An object rests on the floor while all of it is still within a hand's breadth
of the floor, nobody touches it, and no other object reaches deeper below its middle. In 45 recordings resting furniture
and boxes are within 5 mm of the floor, but for two desks (22 mm). A hull of sample points may end up to 37 mm above the
object's lowest point, which no file has; sample points without any surface are no witnesses.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from hoi_retarget.clip.clip import Clip, Severity
from hoi_retarget.human.capsules import PART_CAPSULES, spheres
from hoi_retarget.human.skeleton import FEET
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.numerics.filters import speeds
from hoi_retarget.objects.track import ObjectTrack

_STANDING_SPEED = 0.15
"""[m/s]; a sole that is slower stands on something. Stricter than `person.STANCE_SPEED`: stance looks at the height
over the floor, too, which is not known here."""
_FLOOR_PERCENTILE = 10.0
"""Of the heights of standing soles: low enough for people who also stand on objects, above the reach of noise."""
_MIN_STANDING_FRAMES = 5  # A floor's height is believed from at least so many frames of standing.
FLOOR_TOLERANCE = 0.15
"""[m]; soles that stand farther from the floor than this stand on something, or the floor is elsewhere."""
_MAX_STEP = 1.0  # [m]; nobody stands on something higher: a table has 0.75 m.

WITNESS_TOLERANCE = 0.025
"""[m]; objects on the floor are not farther from the floor of the soles, which are known this well."""
_STILL_SPEED = 0.05  # [m/s]; the corners of a resting object are slower. Recorded ones tremble by a millimetre.
_MIN_REST_SECONDS = 0.15  # A shorter rest is a turn.
FLOOR_REACH = 0.10  # [m]; an object that rests higher stands on something that is not recorded.
MIN_DEPTH_BELOW, MAX_GAP_BELOW = 0.005, 0.02
"""[m]; an object below another one reaches this much deeper, and up to this much below it."""


def on_floor(clip: Clip, *, at_zero: bool, floor: float | None = None) -> Clip:
    """Return a clip with z up, shifted so that the floor is at z = 0.

    The floor is at the height `floor` [m] where that is known, at zero where the format promises it, else estimated.
    """
    if floor is not None:
        lowered = _lowered(clip, floor, f"The floor is at z = {floor:.3f} m in the recording, as was asked for.")
        return _with_feet_elsewhere(lowered, floor)
    if at_zero:
        return _with_feet_elsewhere(clip, 0.0)
    height, frames = floor_height(clip)
    how = (
        f"{frames} frames of standing feet" if frames else "the lowest point of anybody's feet, which never stand still"
    )
    lowered = _lowered(clip, height, f"The floor is at z = {height:.3f} m in the recording, estimated from {how}.")
    return lowered.with_warnings("floor_elsewhere", _objects_elsewhere(lowered, height))


def floor_height(clip: Clip) -> tuple[float, int]:
    """Return the height of the floor [m] below standing soles, and the number of frames of a standing foot."""
    heights, slow = [], []
    for person in clip.people:
        for foot in FEET:
            balls = spheres(person, PART_CAPSULES[foot])
            heights.append(
                balls.lowest if person.toe_height is None else person.position(foot)[:, 2] - person.toe_height
            )
            slow.append(speeds(balls.middles, clip.fps).max(axis=1) < _STANDING_SPEED)
    soles, stands = np.concatenate(heights), np.concatenate(slow)
    if stands.sum() < _MIN_STANDING_FRAMES:
        return float(soles.min()), 0
    return float(np.percentile(soles[stands], _FLOOR_PERCENTILE)), int(stands.sum())


def rests_on_floor(clip: Clip) -> Bool[np.ndarray, "O T"]:
    """Return when each object of a clip, if its surface is known, rests on the floor, which is near z = 0."""
    rests = np.zeros((len(clip.objects), clip.frames), dtype=bool)
    shortest = max(2, round(_MIN_REST_SECONDS * clip.fps))
    for index, track in enumerate(clip.objects):
        if not track.geometry.has_surface:
            continue
        touched = [contact.active for contact in clip.contacts if contact.object == index]
        still = (speeds(track.corners, clip.fps) < _STILL_SPEED).all(axis=1) & ~np.any(touched, axis=0)
        for first, stop in runs(still, shortest):
            rests[index, first:stop] = _is_on_floor(clip, index, (first + stop) // 2)
    return rests


def _is_on_floor(clip: Clip, index: int, frame: int) -> bool:
    track = clip.objects[index].at(frame)
    others = [other.at(frame) for place, other in enumerate(clip.objects) if place != index]
    return bool(track.lowest[0] < FLOOR_REACH) and not any(_carries(other, track) for other in others)


def _carries(below: ObjectTrack, above: ObjectTrack) -> bool:
    """Return whether one object may lie on or in another, which reaches deeper and is under its middle."""
    (own,), (box,) = above.corners, below.corners
    bottom, middle = float(above.lowest[0]), own.mean(axis=0)[:2]
    under = (box.min(axis=0)[:2] <= middle).all() and (middle <= box.max(axis=0)[:2]).all()
    return bool(under and below.lowest[0] < bottom - MIN_DEPTH_BELOW and box[:, 2].max() > bottom - MAX_GAP_BELOW)


def _with_feet_elsewhere(clip: Clip, floor: float) -> Clip:
    """Return a clip with a warning where feet stand off the floor, which was put at zero from the height `floor`."""
    height, frames = floor_height(clip)
    if not frames or abs(height) <= FLOOR_TOLERANCE:
        return clip
    advice = f"pass --floor {floor + height:.2f} unless they stand on something."
    text = f"Feet stand at z = {height:.2f} m, not on the floor at 0: {advice}"
    severity = Severity.ERROR if abs(height) > _MAX_STEP else Severity.WARNING
    return clip.with_warnings("floor_elsewhere", (text,), severity)


def _objects_elsewhere(clip: Clip, floor: float) -> tuple[str, ...]:
    """Return a warning where resting objects lie off the floor, which was put at zero from the height `floor`."""
    rests = rests_on_floor(clip)
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
    lowered = replace(
        clip,
        people=tuple(replace(person, joint_positions=person.joint_positions - down) for person in clip.people),
        objects=tuple(replace(track, positions=track.positions - down) for track in clip.objects),
    )
    return lowered.with_note(note)
