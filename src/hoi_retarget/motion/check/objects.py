"""Findings about objects: what moves is held, and what is held keeps its place in the hand."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.change import Change
from hoi_retarget.motion.check.finding import Check, Finding
from hoi_retarget.motion.check.interpretation import Interpretation, changes
from hoi_retarget.motion.check.layout import UNIT_TOLERANCE, off_unit
from hoi_retarget.motion.check.rates import differences
from hoi_retarget.motion.check.surroundings import Surroundings
from hoi_retarget.motion.formats import ObjectPoses
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import MOVING_SPEED
from hoi_retarget.robots.spec import SIDES

_ENOUGH = 8  # Frames of movement that tell anything.
_FAR = 1.3
"""Hands of real retargets are within this of the origin of what they move [m]."""
_LOOSE, _PART = 0.1, 0.5
"""A palm that slides faster in the object's frame [m/s] does not hold it, unless no reading halves that."""
_SAME_SLIDE, _SAME_PART, _SAME_DISTANCE = 0.01, 0.2, 0.02
"""Readings that differ by less [m/s, part of the slide, m] are one as good as the other."""


@dataclass(frozen=True, eq=False)
class ObjectPath:
    """One object's pose as it was found to be: z up, metres, wxyz."""

    name: str
    pos: Float[np.ndarray, "T 3"]
    quat: Float[np.ndarray, "T 4"]


@dataclass(frozen=True, eq=False)
class _Way:
    """One way to read an object's pose."""

    words: str
    """That follow 'its pose is', empty for the claim."""
    advice: str
    mend: tuple[Change, ...]
    pos: Float[np.ndarray, "T 3"]
    quat: Float[np.ndarray, "T 4"]


@dataclass(frozen=True)
class _Hold:
    distance: float
    """From the nearer palm to the object's origin while it moves, median [m]."""
    slide: float
    """Of the steadier palm in the object's frame, median [m/s]."""
    speed: float
    """Of the object, median [m/s]."""

    def __str__(self) -> str:
        return f"nearer palm {self.distance:.2f} m away, sliding {self.slide:.2f} m/s in its frame"

    def is_like(self, other: "_Hold") -> bool:
        """Return whether two readings cannot be told from one another."""
        near = abs(self.distance - other.distance) < _SAME_DISTANCE
        return near and abs(self.slide - other.slide) < max(_SAME_SLIDE, _SAME_PART * self.slide)


def check_object(item: ObjectPoses, claim: Interpretation, around: Surroundings) -> Check[ObjectPath | None]:
    """Return the object's path as the numbers say, None where it has none.

    Args:
        item: What the file holds of it.
        claim: How the format reads its poses, in the world that the robot was found to stand in.
        around: The robot's motion.
    """
    words = f"the pose of {item.name} as the format demands"
    raw_pos, raw_quat = around.convention.split(item.pose)
    off = off_unit(raw_quat)
    if off > UNIT_TOLERANCE:
        yield _no_rotation(item, words, off)
        return None
    ways = list(_ways(item.name, raw_pos, raw_quat, claim))
    claimed = ways[0]
    path = ObjectPath(item.name, claimed.pos, claimed.quat)
    if (_speed(claimed.pos, around.fps) > MOVING_SPEED).sum() < _ENOUGH:
        yield Finding("unknown", "object", words, f"{item.name} hardly moves: cannot be told")
        return path
    kinematics = around.model.forward(around.qpos)
    palms = np.stack([kinematics.site_position(f"{side}_palm") for side in SIDES], axis=1)
    first, *others = [_hold(palms, way, around.fps) for way in ways]
    best, way = min(zip(others, ways[1:], strict=True), key=lambda pair: pair[0].slide + pair[0].distance)
    far = first.distance > _FAR and best.distance < 0.7 * first.distance
    loose = first.slide > _LOOSE and best.slide < _PART * first.slide and best.distance < first.distance + 0.1
    if far or loose:
        says = f"its pose is {way.words}: {best}; as claimed {first}"
        yield Finding("contradiction", "object", words, says, way.advice, "objects", way.mend)
        return ObjectPath(item.name, way.pos, way.quat)
    if first.distance > _FAR:
        says = f"moves at {first.speed:.2f} m/s while no palm is near: {first}"
        yield Finding("note", "object", words, says, "Do object and robot share one world and one scale?")
        return path
    alike = [way.words for way, other in zip(ways[1:], others, strict=True) if first.is_like(other)]
    if alike:
        says = f"{first}; as near if its pose were {', or '.join(alike)}: cannot be told"
        yield Finding("unknown", "object", words, says)
    else:
        yield Finding("ok", "object", words, f"{first}; if its pose were {way.words} {best}")
    return path


def _no_rotation(item: ObjectPoses, claim: str, off: float) -> Finding:
    says = f"the lengths of its quaternions differ from 1 by up to {off:.2g}"
    if min(off_unit(item.pose[:, 3:]), off_unit(item.pose[:, :4])) < UNIT_TOLERANCE:
        advice = "Exchange position and rotation."
        mend = (Change("exchange position and rotation", item.name),)
        says += "; position and rotation are exchanged"
    else:
        advice, mend = "Write a unit quaternion there.", ()
    return Finding("contradiction", "object", claim, says, advice, "objects", mend)


def _ways(name: str, pos: np.ndarray, quat: np.ndarray, claim: Interpretation) -> Iterator[_Way]:
    """Yield the claimed reading first, then the others."""
    other = "xyzw" if claim.quat_order == "wxyz" else "wxyz"
    order = f"Reorder its quaternions to {claim.quat_order}."
    readings = (
        ("", "", claim),
        (f"with {other} quaternions", order, replace(claim, quat_order=other)),
        ("with inverted quaternions", "Negate the three imaginary components.", replace(claim, inverted=True)),
        ("in centimetres", "Multiply its positions by 0.01.", replace(claim, metres=0.01 * claim.metres)),
        ("in millimetres", "Multiply its positions by 0.001.", replace(claim, metres=0.001 * claim.metres)),
    )
    for words, advice, reading in readings:
        mend = changes(claim, reading, name, 0)
        yield _Way(words, advice, mend, reading.position(pos), reading.rotation(quat))
    inverse = se3.quat_conjugate(claim.rotation(quat))
    advice, mend = "Write the inverse: its pose in the world.", (Change("invert poses", name),)
    yield _Way("inverted", advice, mend, -se3.rotate(inverse, claim.position(pos)), inverse)


def _hold(palms: Float[np.ndarray, "T 2 3"], way: _Way, fps: float) -> _Hold:
    speed = _speed(way.pos, fps)
    moving = speed > MOVING_SPEED if (speed > MOVING_SPEED).any() else speed >= 0
    local = se3.rotate_inverse(way.quat[:, None], palms - way.pos[:, None])
    distance = np.linalg.norm(local, axis=-1).min(axis=1)[1:-1]
    slide = np.linalg.norm(differences(local), axis=-1).min(axis=1) * fps
    return _Hold(float(np.median(distance[moving])), float(np.median(slide[moving])), float(np.median(speed[moving])))


def _speed(pos: Float[np.ndarray, "T 3"], fps: float) -> Float[np.ndarray, "steps"]:
    return np.linalg.norm(differences(pos), axis=1) * fps
