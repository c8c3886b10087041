"""A body's surface as capsules around its bones, for people without a body model.

Radii are those of an adult 1.75 m tall and grow with the height. Fingers go on beyond their last
joint, and feet beyond toes and ankles, by what bones and rotations tell.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.human.person import Person
from hoi_retarget.human.skeleton import FINGER_PARTS, PARTS
from hoi_retarget.numerics import se3

_FINGERS = ("index", "middle", "pinky", "ring", "thumb")
_SIDES = ("left", "right")
_SPACING = 0.01  # [m] between points of a capsule's axis.
_HEIGHT = 1.75  # [m] of the person whose radii are given.
_FINGER, _THUMB, _PALM = 0.008, 0.010, 0.013  # [m]
# Of the last bone but one: how far a fingertip's middle lies beyond the last joint.
_TIP = 0.8
# In the rotation of its joint, whose rest pose looks along +z and stands along +y [m].
_HEEL, _BALL, _TOES = (0.0, -0.045, -0.035), (0.0, -0.02, 0.0), (0.0, -0.015, 0.05)


@dataclass(frozen=True)
class BodyCapsule:
    """A bone with flesh around it, that belongs to a joint as a mesh's segment does."""

    joint: str  # The joint that moves it.
    start: str
    end: str  # The joints between which its axis runs.
    radius: float  # [m] at 1.75 m of height.
    tip_of: str | None = None
    """The bone, named by where it begins, that goes on straight beyond `start` in place of `end`."""
    start_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    end_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """What is added to the ends in the rotation of their joints [m] at 1.75 m of height."""

    def axis(self, person: Person) -> Float[np.ndarray, "T n 3"]:
        """Return world points of the axis, at most a centimetre apart [m]."""
        size = person.height / _HEIGHT
        start = person.position(self.start)
        if self.tip_of is None:
            end = person.position(self.end) + _turned(person, self.end, self.end_offset, size)
        else:
            bone = se3.rotate_inverse(person.quat(self.tip_of), start - person.position(self.tip_of))
            end = start + _TIP * se3.rotate(person.quat(self.start), bone)
        start = start + _turned(person, self.start, self.start_offset, size)
        longest = float(np.linalg.norm(end - start, axis=1).max())
        along = np.linspace(0.0, 1.0, int(np.ceil(longest / _SPACING)) + 1)[:, None]
        return start[:, None] + along * (end - start)[:, None]


@dataclass(frozen=True, eq=False)
class Spheres:
    """Capsules as rows of spheres: their middles over time, and their radii."""

    middles: Float[np.ndarray, "T n 3"]  # In the world [m].
    radii: Float[np.ndarray, "n"]  # [m]

    @property
    def lowest(self) -> Float[np.ndarray, "T"]:
        """Height of the lowest point in each frame [m]."""
        return (self.middles[..., 2] - self.radii).min(axis=1)


def spheres(person: Person, capsules: Iterable[BodyCapsule]) -> Spheres:
    """Return a person's capsules as spheres a centimetre apart."""
    pairs = [(capsule, capsule.axis(person)) for capsule in capsules]
    size = person.height / _HEIGHT
    return Spheres(
        middles=np.concatenate([axis for _, axis in pairs], axis=1),
        radii=np.concatenate([np.full(axis.shape[1], size * capsule.radius) for capsule, axis in pairs]),
    )


def _turned(person: Person, joint: str, offset: tuple[float, float, float], size: float) -> Float[np.ndarray, "T 3"]:
    return se3.rotate(person.quat(joint), size * np.array([offset]))


def _hand(side: str) -> tuple[BodyCapsule, ...]:
    """Return the palm's bones, which the wrist moves, and three bones of each finger."""
    found = []
    for finger in _FINGERS:
        first, second, third = (f"{side}_{finger}{bone}" for bone in (1, 2, 3))
        radius = _THUMB if finger == "thumb" else _FINGER
        found += [
            BodyCapsule(f"{side}_wrist", f"{side}_wrist", first, _PALM),
            BodyCapsule(first, first, second, radius),
            BodyCapsule(second, second, third, radius),
            BodyCapsule(third, third, third, radius, tip_of=second),
        ]
    return tuple(found)


def _foot(side: str) -> tuple[BodyCapsule, ...]:
    ankle, toe = f"{side}_ankle", f"{side}_foot"
    return (
        BodyCapsule(ankle, ankle, toe, 0.035, start_offset=_HEEL, end_offset=_BALL),
        BodyCapsule(ankle, ankle, toe, 0.030, end_offset=_BALL),
        BodyCapsule(toe, toe, toe, 0.025, start_offset=_BALL, end_offset=_TOES),
    )


def _limbs(side: str) -> tuple[BodyCapsule, ...]:
    return (
        BodyCapsule(f"{side}_hip", f"{side}_hip", f"{side}_knee", 0.075),
        BodyCapsule(f"{side}_knee", f"{side}_knee", f"{side}_ankle", 0.05),
        BodyCapsule(f"{side}_collar", f"{side}_collar", f"{side}_shoulder", 0.06),
        BodyCapsule(f"{side}_shoulder", f"{side}_shoulder", f"{side}_elbow", 0.045),
        BodyCapsule(f"{side}_elbow", f"{side}_elbow", f"{side}_wrist", 0.035),
    )


PART_CAPSULES: dict[str, tuple[BodyCapsule, ...]] = {
    part: (_hand if part.endswith("hand") else _foot)(part.split("_")[0]) for part in PARTS
}
"""The capsules of each part that can touch."""
FINGER_CAPSULES: dict[str, tuple[BodyCapsule, ...]] = {
    name: tuple(capsule for capsule in _hand(name.split("_")[0]) if capsule.joint in part.label_joints)
    for name, part in FINGER_PARTS.items()
}
"""The capsules of each finger that touch."""

_PELVIS = BodyCapsule("pelvis", "left_hip", "right_hip", 0.10)
RESTING_CAPSULES: dict[str, tuple[BodyCapsule, ...]] = {
    "pelvis": (_PELVIS,),
    **{
        f"{side}_{part}": (capsule,)
        for side in _SIDES
        for part, capsule in zip(("thigh", "forearm"), (_limbs(side)[0], _limbs(side)[-1]), strict=True)
    },
}
"""The capsules of each part that can rest on an object."""

BODY_CAPSULES: tuple[BodyCapsule, ...] = (
    *(capsule for capsules in PART_CAPSULES.values() for capsule in capsules),
    *(capsule for side in _SIDES for capsule in _limbs(side)),
    _PELVIS,
    BodyCapsule("spine1", "pelvis", "spine2", 0.12),
    BodyCapsule("spine3", "spine2", "neck", 0.11),
    BodyCapsule("spine3", "left_shoulder", "right_shoulder", 0.07),
    BodyCapsule("neck", "neck", "head", 0.055),
    BodyCapsule("head", "head", "head", 0.09, end_offset=(0.0, 0.07, 0.02)),
)
"""The capsules of the whole body."""
