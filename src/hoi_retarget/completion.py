"""What a source leaves open about a clip, found from its motion: where the floor is, and who touches what.

Every finding becomes a note of the clip.
"""

from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from hoi_retarget import se3
from hoi_retarget.capsules import PART_CAPSULES, spheres
from hoi_retarget.clip import Clip, ObjectTrack
from hoi_retarget.contact_labels import PROXIMITY, InterAct, Nearness, label_contacts, nearness
from hoi_retarget.errors import ClipError
from hoi_retarget.skeleton import FEET

Labels = Literal["auto", "proximity", "interact"]

STANDING_SPEED = 0.15
"""[m/s]; a sole that is slower stands on something."""
FLOOR_PERCENTILE = 10.0
"""Of the heights of standing soles: low enough for people who also stand on things, above what noise reaches."""
LEAST_STANDING = 5
"""Frames of standing that a floor's height is believed from."""
FLOOR_TOLERANCE = 0.15
"""[m]; soles that stand farther from the floor than this stand on something, or the floor is elsewhere."""
MOVING_SPEED = 0.15
"""[m/s]; an object that is faster is moved by somebody, or falls."""
LEAST_MOVING = 10
"""Frames of moving that an object's poses are judged from."""
LEAST_HELD, CLEARLY_HELD = 0.5, 0.3
"""Share of these frames with somebody at the object below which its poses are doubted, and how much better
inverted rotations must be to be believed."""


def on_floor(clip: Clip, *, at_zero: bool, floor: float | None = None) -> Clip:
    """Return a clip shifted so that the floor is at z = 0.

    Args:
        clip: z is up.
        at_zero: whether its format promises that the floor is there already.
        floor: height of the floor in the clip [m], where somebody knows it; otherwise it is estimated.
    """
    if floor is not None:
        lowered = _lowered(clip, floor, f"The floor is at z = {floor:.3f} m in the recording, as was asked for.")
        return _doubted(lowered, _floor_doubts(lowered, floor))
    if at_zero:
        return _doubted(clip, _floor_doubts(clip, 0.0))
    height, frames = floor_height(clip)
    how = (
        f"{frames} frames of standing feet" if frames else "the lowest point of anybody's feet, which never stand still"
    )
    return _lowered(clip, height, f"The floor is at z = {height:.3f} m in the recording, estimated from {how}.")


def floor_height(clip: Clip) -> tuple[float, int]:
    """Return the height of the floor [m] that soles stand on, and in how many frames of a foot they do."""
    heights, slow = [], []
    for person in clip.people:
        for foot in FEET:
            balls = spheres(person, PART_CAPSULES[foot])
            heights.append((balls.middles[..., 2] - balls.radii).min(axis=1))
            speed = np.linalg.norm(np.gradient(balls.middles, axis=0), axis=-1).max(axis=1) * clip.fps
            slow.append(speed < STANDING_SPEED)
    soles, stands = np.concatenate(heights), np.concatenate(slow)
    if stands.sum() < LEAST_STANDING:
        return float(soles.min()), 0
    return float(np.percentile(soles[stands], FLOOR_PERCENTILE)), int(stands.sum())


def with_contacts(clip: Clip, labels: Labels = "auto") -> Clip:
    """Return a clip whose contacts are those of its source, or where it has none, or others are asked for, geometry's.

    Args:
        clip: its floor is at z = 0.
        labels: `auto` keeps the source's contacts where it has any; `proximity` and `interact` find them anew by the
            rule of that name (`contact_labels.Proximity`, `contact_labels.InterAct`).

    Raises:
        ClipError: objects move with nobody near, but not when their rotations are inverted.
        GeometryError: an object's mesh cannot be read.
    """
    if not clip.objects:
        return clip
    if clip.contacts and labels == "auto":
        return _doubted(clip, _untouched(clip))
    rule = InterAct() if labels == "interact" else PROXIMITY
    near = nearness(clip)
    doubts = _unheld(clip, near)
    contacts = label_contacts(clip, rule=rule, near=near)
    why = "as was asked for" if clip.contacts else "as the source labels none"
    note = f"Contacts are found from distances between body and object ({type(rule).__name__}'s rule), {why}."
    source = replace(clip.source, notes=(*clip.source.notes, note))
    found = replace(clip, contacts=contacts, source=source)
    return _doubted(found, doubts or _untouched(found))


def _doubted(clip: Clip, doubts: tuple[str, ...]) -> Clip:
    return replace(clip, source=replace(clip.source, doubts=(*clip.source.doubts, *doubts))) if doubts else clip


def _floor_doubts(clip: Clip, floor: float) -> tuple[str, ...]:
    """Return a doubt where feet stand elsewhere than on the floor, which was put at zero from the height `floor`."""
    height, frames = floor_height(clip)
    if not frames or abs(height) <= FLOOR_TOLERANCE:
        return ()
    return (
        f"Feet stand at z = {height:.2f} m, not on the floor at 0: pass --floor {floor + height:.2f} unless they stand "
        "on something.",
    )


def _untouched(clip: Clip) -> tuple[str, ...]:
    """Return a doubt where objects move and nothing is ever touched."""
    moving = {track.name: int(_moving(track, clip.fps).sum()) for track in clip.objects}
    moved = [f"{name} moves in {frames} frames" for name, frames in moving.items() if frames >= LEAST_MOVING]
    if not moved or any(track.active.any() for track in clip.contacts):
        return ()
    return (
        f"Nobody touches anything, although {' and '.join(moved)}: see --labels, or add contacts with "
        "`hoi-retarget contacts --add` or in the editor.",
    )


def _lowered(clip: Clip, height: float, note: str) -> Clip:
    down = np.array([0.0, 0.0, height])
    return replace(
        clip,
        people=tuple(replace(person, joint_positions=person.joint_positions - down) for person in clip.people),
        objects=tuple(replace(track, positions=track.positions - down) for track in clip.objects),
        source=replace(clip.source, notes=(*clip.source.notes, note)),
    )


def _unheld(clip: Clip, near: tuple[Nearness, ...]) -> tuple[str, ...]:
    """Return a doubt for each object that moves with nobody near; raises `ClipError` where rotations are inverted."""
    doubts: tuple[str, ...] = ()
    for index, track in enumerate(clip.objects):
        moving = _moving(track, clip.fps)
        held = _held(near, index, moving)
        if moving.sum() < LEAST_MOVING or held >= LEAST_HELD:
            continue
        inverted = replace(clip, objects=(replace(track, quats=se3.quat_conjugate(track.quats)),), contacts=())
        other = _held(nearness(inverted), 0, moving)
        if other > held + CLEARLY_HELD:
            raise ClipError(
                f"{clip.source.path or clip.name}: the rotations of {track.name!r} are read wrongly: a hand or a foot "
                f"is at it in {held:.0%} of the frames in which it moves, with inverse rotations in {other:.0%}. "
                "This copy of the data has another convention than its source."
            )
        doubts += (
            f"{track.name} moves in {moving.sum()} frames, in {1 - held:.0%} of them with no hand or foot within "
            "10 cm: its poses, its shape or the recording's alignment may be wrong.",
        )
    return doubts


def _moving(track: ObjectTrack, fps: float) -> Bool[np.ndarray, "T"]:
    """Return when the middle of an object's box moves."""
    points = track.geometry.points
    middle: Float[np.ndarray, "3"] = 0.5 * (points.min(axis=0) + points.max(axis=0))
    path = track.positions + se3.rotate(track.quats, middle)
    return np.asarray(np.linalg.norm(np.gradient(path, axis=0), axis=1) * fps > MOVING_SPEED)


def _held(near: tuple[Nearness, ...], index: int, moving: Bool[np.ndarray, "T"]) -> float:
    """Return in which share of the frames in which an object moves somebody's part is near it."""
    there = np.any([np.isfinite(item.distances) for item in near if item.object == index], axis=0)
    return float(there[moving].mean()) if moving.any() else 1.0
