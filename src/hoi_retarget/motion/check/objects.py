"""Findings about objects: what moves is held, and what is held keeps its place in the hand."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.motion.check.finding import Check, Finding
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


@dataclass(frozen=True, eq=False)
class ObjectPath:
    """One object's pose as it was found to be: z up, metres, wxyz."""

    name: str
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


def check_object(item: ObjectPoses, around: Surroundings) -> Check[ObjectPath | None]:
    """Return the object's path as the format demands, None where it has none."""
    reading, fps = around.reading, around.fps
    claim = f"the pose of {item.name} as the format demands"
    raw_pos, raw_quat = around.convention.split(item.pose)
    off = off_unit(raw_quat)
    if off > UNIT_TOLERANCE:
        says = f"the lengths of its quaternions differ from 1 by up to {off:.2g}"
        if min(off_unit(item.pose[:, 3:]), off_unit(item.pose[:, :4])) < UNIT_TOLERANCE:
            says += "; position and rotation are exchanged"
        yield Finding("contradiction", "object", claim, says, "Write a unit quaternion there.", "objects")
        return None
    quat, pos = reading.rotation(raw_quat), reading.position(raw_pos)
    path = ObjectPath(item.name, pos, quat)
    speed = np.linalg.norm(differences(pos), axis=1) * fps
    if (speed > MOVING_SPEED).sum() < _ENOUGH:
        yield Finding("unknown", "object", claim, f"{item.name} hardly moves: cannot be told")
        return path
    kinematics = around.model.forward(around.qpos)
    palms = np.stack([kinematics.site_position(f"{side}_palm") for side in SIDES], axis=1)
    claimed = _hold(palms, pos, quat, fps)
    other_order = se3.quat_to_xyzw(raw_quat) if reading.quat_order == "wxyz" else se3.quat_from_xyzw(raw_quat)
    inverse = se3.quat_conjugate(quat)
    ways = {
        "its pose is inverted": (-se3.rotate(inverse, pos), inverse),
        "its quaternions are in the other component order": (pos, reading.rotation(other_order)),
        "its quaternions are inverted": (pos, inverse),
    }
    holds = {words: _hold(palms, *poses, fps) for words, poses in ways.items()}
    words = min(holds, key=lambda key: holds[key].slide + holds[key].distance)
    best = holds[words]
    far = claimed.distance > _FAR and best.distance < 0.7 * claimed.distance
    loose = claimed.slide > _LOOSE and best.slide < _PART * claimed.slide and best.distance < claimed.distance + 0.1
    if far or loose:
        says = f"{words}: {best}; as claimed {claimed}"
        yield Finding("contradiction", "object", claim, says, "Write its pose in the world.", "objects")
        return path
    if claimed.distance > _FAR:
        says = f"moves at {claimed.speed:.2f} m/s while no palm is near: {claimed}"
        yield Finding("note", "object", claim, says, "Do object and robot share one world and one scale?")
        return path
    yield Finding("ok", "object", claim, f"{claimed}; if {words} {best}")
    return path


def _hold(palms: Float[np.ndarray, "T 2 3"], pos: np.ndarray, quat: np.ndarray, fps: float) -> _Hold:
    speed = np.linalg.norm(differences(pos), axis=1) * fps
    moving = speed > MOVING_SPEED if (speed > MOVING_SPEED).any() else speed >= 0
    local = se3.rotate_inverse(quat[:, None], palms - pos[:, None])
    distance = np.linalg.norm(local, axis=-1).min(axis=1)[1:-1]
    slide = np.linalg.norm(differences(local), axis=-1).min(axis=1) * fps
    return _Hold(float(np.median(distance[moving])), float(np.median(slide[moving])), float(np.median(speed[moving])))
