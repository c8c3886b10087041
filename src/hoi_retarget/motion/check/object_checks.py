"""Findings about objects: moving ones are held, held ones keep their place in the hand, and contacts are flagged there.

Objects of a file are its own, or the bodies that no link of the robot carries.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.body_checks import FoundBodies
from hoi_retarget.motion.check.finding import Change, Check, FormatFinding, contradiction
from hoi_retarget.motion.check.interpretation import Interpretation, changes
from hoi_retarget.motion.check.layout import UNIT_TOLERANCE, off_unit
from hoi_retarget.motion.check.rates import differences
from hoi_retarget.motion.formats import Convention, MotionFile, ObjectPoses
from hoi_retarget.numerics import se3
from hoi_retarget.objects.track import MOVING_SPEED
from hoi_retarget.robots.model import RobotModel
from hoi_retarget.robots.spec import SIDES

_WORLD, _LINK = "world", "_link"
_MAX_CARRIED_SPREAD_M, _MIN_WORLD_SPREAD_M = 1e-3, 0.02
"""A link carries a body if the body's origin wanders less in the link's frame, and more in the world."""


def objects_among_bodies(file: MotionFile, found: FoundBodies | None) -> list[ObjectPoses]:
    """Return the bodies with names that are neither links of the robot nor carried by them."""
    loose = {index: name for index, name in _loose_bodies(file, found).items() if not name.endswith(_LINK)}
    poses = (
        np.concatenate([file.bodies.pos, file.bodies.quat], axis=2)
        if file.bodies is not None and loose
        else np.zeros(0)
    )
    return [ObjectPoses(name, poses[:, index]) for index, name in loose.items()]


def _loose_bodies(file: MotionFile, found: FoundBodies | None) -> dict[int, str]:
    """Return the names of bodies that no link of the robot carries, by place.

    Fixed links, fingers and what hangs on them keep their origin's place in the frame of the link before them.
    """
    if file.bodies is None or file.body_names is None or found is None:
        return {}
    pos = found.reading.position(file.bodies.pos)
    quat = found.reading.rotation(file.bodies.quat)
    links = list(found.there.places.values())
    others = [index for index, name in enumerate(file.body_names) if index not in links and name != _WORLD]
    while carried := [index for index in others if _is_carried(pos, quat, index, links)]:
        links = carried
        others = [index for index in others if index not in carried]
    return {index: file.body_names[index] for index in others}


def _is_carried(pos: np.ndarray, quat: np.ndarray, index: int, links: list[int]) -> bool:
    if np.ptp(pos[:, index], axis=0).max() < _MIN_WORLD_SPREAD_M:
        return False
    local = se3.rotate_inverse(quat[:, links], pos[:, index, None] - pos[:, links])
    return bool((np.ptp(local, axis=0).max(axis=1) < _MAX_CARRIED_SPREAD_M).any())


@dataclass(frozen=True, eq=False)
class CheckContext:
    """The robot's motion, and the reading of poses of objects about it."""

    model: RobotModel
    qpos: Float[np.ndarray, "T nq"]
    reading: Interpretation
    convention: Convention
    fps: float
    hands_touch: bool = True  # False where the file's flags name hands, and none ever touches.


_MIN_MOVING_FRAMES = 8
_MAX_PALM_DISTANCE_M = 1.3  # Of the hands of real retargets from the origin of a moving object.
_MAX_SLIDE_MPS, _BETTER_SHARE = 0.1, 0.5
"""A palm that slides faster in the object's frame does not hold it, unless no reading halves that."""
_LOOSE_SHARE = 0.5  # Of an object's speed: palms of real retargets that hold one slide at most at 0.26 of it.
_MIN_FLAGGED_SHARE = 0.5
"""Of frames in which an object moves near a palm: in published files, 0.84 and more have a contact flag."""
_SAME_SLIDE_MPS, _SAME_SLIDE_SHARE, _SAME_DISTANCE_M = 0.01, 0.2, 0.02  # Readings that differ by less are equally good.


@dataclass(frozen=True, eq=False)
class ObjectPath:
    """One object's pose as it was found to be: z up, metres, wxyz."""

    name: str
    pos: Float[np.ndarray, "T 3"]
    quat: Float[np.ndarray, "T 4"]


@dataclass(frozen=True, eq=False)
class _ObjectReading:
    """One reading of an object's pose."""

    words: str  # That follow 'its pose is', empty for the claim.
    advice: str
    fix: tuple[Change, ...]
    path: ObjectPath


@dataclass(frozen=True)
class _Hold:
    distance: float  # From the nearer palm to the object's origin while it moves, median [m].
    slide: float  # Of the steadier palm in the object's frame, median [m/s].
    speed: float  # Of the object, median [m/s].

    def __str__(self) -> str:
        return f"nearer palm {self.distance:.2f} m away, sliding {self.slide:.2f} m/s in its frame"

    def is_like(self, other: "_Hold") -> bool:
        """Return whether two readings are indistinguishable."""
        near = abs(self.distance - other.distance) < _SAME_DISTANCE_M
        return near and abs(self.slide - other.slide) < max(_SAME_SLIDE_MPS, _SAME_SLIDE_SHARE * self.slide)


def check_object(item: ObjectPoses, claim: Interpretation, context: CheckContext) -> Check[ObjectPath | None]:
    """Return the object's path as the numbers say, None where it has none.

    The claim is the format's reading of its poses, in the world that the robot was found to stand in.
    """
    words = f"the pose of {item.name} as the format demands"
    raw_pos, raw_quat = context.convention.split(item.pose)
    off = off_unit(raw_quat)
    if off > UNIT_TOLERANCE:
        yield _no_rotation(item, words, off)
        return None
    readings = list(_readings(item.name, raw_pos, raw_quat, claim))
    path = readings[0].path
    moves = (_speed(path.pos, context.fps) > MOVING_SPEED).sum() >= _MIN_MOVING_FRAMES
    if not (moves and context.hands_touch):
        why = "no hand touches it by the file's flags" if moves else f"{item.name} hardly moves"
        yield FormatFinding("unknown", "object", words, f"{why}: cannot be told")
        return path
    palms = _palms(context)
    first, *others = [_hold(palms, way.path, context.fps) for way in readings]
    best, way = min(zip(others, readings[1:], strict=True), key=lambda pair: pair[0].slide + pair[0].distance)
    far = first.distance > _MAX_PALM_DISTANCE_M and best.distance < 0.7 * first.distance
    steadier = best.slide < _BETTER_SHARE * first.slide and best.distance < first.distance + 0.1
    loose = first.slide > _MAX_SLIDE_MPS and steadier
    if far or loose:
        numbers = f"its pose is {way.words}: {best}; as claimed {first}"
        yield contradiction("object", words, numbers, way.advice, fix=way.fix, spoils="objects")
        return way.path
    if first.distance > _MAX_PALM_DISTANCE_M:
        numbers = f"moves at {first.speed:.2f} m/s while no palm is near: {first}"
        yield FormatFinding("note", "object", words, numbers, "Do object and robot share one world and one scale?")
        return path
    if first.slide > _LOOSE_SHARE * first.speed:
        numbers = f"moves at {first.speed:.2f} m/s, and no palm goes with it: {first}"
        yield FormatFinding("note", "object", words, numbers, "Do object and robot share one time and one world?")
        return path
    alike = [way.words for way, other in zip(readings[1:], others, strict=True) if first.is_like(other)]
    if alike:
        numbers = f"{first}; as near if its pose were {', or '.join(alike)}: cannot be told"
        yield FormatFinding("unknown", "object", words, numbers)
    else:
        yield FormatFinding("ok", "object", words, f"{first}; if its pose were {way.words} {best}")
    return path


def check_contacts(file: MotionFile, paths: Sequence[ObjectPath], context: CheckContext) -> Iterator[FormatFinding]:
    """Yield whether contacts are flagged while objects move near a palm."""
    if file.contacts is None:
        return
    palms = _palms(context)
    moved = np.zeros(file.frames, dtype=bool)
    for path in paths:
        near = np.linalg.norm(palms - path.pos[:, None], axis=-1).min(axis=1) < _MAX_PALM_DISTANCE_M
        moved[1:-1] |= near[1:-1] & (_speed(path.pos, context.fps) > MOVING_SPEED)
    claim = "flagged while objects are moved"
    if moved.sum() < _MIN_MOVING_FRAMES or not context.hands_touch:
        yield FormatFinding("unknown", "contacts", claim, "no object is moved near a palm: cannot be told")
        return
    flagged = np.any(file.contacts.flags, axis=1)
    share = float(flagged[moved].mean())
    numbers = f"in {100 * share:.0f} % of frames with an object moving near a palm, {100 * flagged.mean():.0f} % of all"
    if share > _MIN_FLAGGED_SHARE:
        yield FormatFinding("ok", "contacts", claim, numbers)
    else:
        advice = "Are the flags of this motion and of its frames? Write them from the distances of hands and objects."
        yield contradiction("contacts", claim, numbers, advice, spoils="nothing")


def check_loose_links(
    file: MotionFile, found: FoundBodies | None, paths: Sequence[ObjectPath]
) -> Iterator[FormatFinding]:
    """Yield bodies that are named as links, but that neither the robot nor an object carries."""
    if file.bodies is None or found is None:
        return
    pos = found.reading.position(file.bodies.pos)
    loose = [
        name
        for index, name in _loose_bodies(file, found).items()
        if name.endswith(_LINK)
        and not any(np.allclose(pos[:, index], path.pos, atol=_SAME_DISTANCE_M) for path in paths)
    ]
    if loose:
        numbers = f"{', '.join(loose[:6])}{', ...' if len(loose) > 6 else ''}: no link of the robot carries them"
        yield FormatFinding("note", "bodies", "links move with the robot", numbers, "Are they of another robot?")


def _no_rotation(item: ObjectPoses, claim: str, off: float) -> FormatFinding:
    numbers = f"the lengths of its quaternions differ from 1 by up to {off:.2g}"
    if min(off_unit(item.pose[:, 3:]), off_unit(item.pose[:, :4])) < UNIT_TOLERANCE:
        advice = "Exchange position and rotation."
        fix = (Change("exchange position and rotation", item.name),)
        numbers += "; position and rotation are exchanged"
    else:
        advice, fix = "Write a unit quaternion there.", ()
    return contradiction("object", claim, numbers, advice, fix=fix, spoils="objects")


def _readings(name: str, pos: np.ndarray, quat: np.ndarray, claim: Interpretation) -> Iterator[_ObjectReading]:
    """Yield the claimed reading first, then the others."""
    other = "xyzw" if claim.quat_order == "wxyz" else "wxyz"
    order = f"Reorder its quaternions to {claim.quat_order}."
    candidates = (
        ("", "", claim),
        (f"with {other} quaternions", order, replace(claim, quat_order=other)),
        ("with inverted quaternions", "Negate the three imaginary components.", replace(claim, inverted=True)),
        ("in centimetres", "Multiply its positions by 0.01.", replace(claim, metres=0.01 * claim.metres)),
        ("in millimetres", "Multiply its positions by 0.001.", replace(claim, metres=0.001 * claim.metres)),
    )
    for words, advice, reading in candidates:
        fix = changes(claim, reading, name, 0)
        yield _ObjectReading(words, advice, fix, ObjectPath(name, reading.position(pos), reading.rotation(quat)))
    inverse = se3.quat_conjugate(claim.rotation(quat))
    advice, fix = "Write the inverse: its pose in the world.", (Change("invert poses", name),)
    path = ObjectPath(name, -se3.rotate(inverse, claim.position(pos)), inverse)
    yield _ObjectReading("inverted", advice, fix, path)


def _palms(context: CheckContext) -> Float[np.ndarray, "T 2 3"]:
    kinematics = context.model.forward(context.qpos)
    return np.stack([kinematics.site_position(f"{side}_palm") for side in SIDES], axis=1)


def _hold(palms: Float[np.ndarray, "T 2 3"], path: ObjectPath, fps: float) -> _Hold:
    speed = _speed(path.pos, fps)
    moving = speed > MOVING_SPEED if (speed > MOVING_SPEED).any() else speed >= 0
    local = se3.rotate_inverse(path.quat[:, None], palms - path.pos[:, None])
    distance = np.linalg.norm(local, axis=-1).min(axis=1)[1:-1]
    slide = np.linalg.norm(differences(local), axis=-1).min(axis=1) * fps
    return _Hold(float(np.median(distance[moving])), float(np.median(slide[moving])), float(np.median(speed[moving])))


def _speed(pos: Float[np.ndarray, "T 3"], fps: float) -> Float[np.ndarray, "steps"]:
    return np.linalg.norm(differences(pos), axis=1) * fps
