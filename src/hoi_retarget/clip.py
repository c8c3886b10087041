"""The human side of a clip: people, objects, contacts; no robot anywhere.

World frame: z up, floor at z = 0, metres, seconds. All arrays are read-only copies.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from hoi_retarget import se3
from hoi_retarget.arrays import check_finite, check_shape, describe_frames, frozen, runs
from hoi_retarget.bodies import BodyShape
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.skeleton import HEIGHT_OVER_CHAIN, JOINT_INDEX, JOINTS, PARTS

MINIMUM_FRAMES = 4  # The jerk penalty is a third difference.
# Frames times points held at once: 4 MB of doubles, which stays in the cache.
_BLOCK = 500_000


@dataclass(frozen=True, eq=False)
class Person:
    """One human: world poses of the 52 joints of `skeleton.JOINTS`."""

    name: str
    joint_positions: Float[np.ndarray, "T 52 3"]
    """World positions [m]."""
    joint_quats: Float[np.ndarray, "T 52 4"]
    """World rotations, wxyz, identity in the T-pose that stands along +y and looks along +z."""
    fingers_recorded: bool = True
    """Whether the finger joints are the person's own; otherwise they are straight and made up."""
    shape: BodyShape | None = None
    """The person's skin, where the source tells it and its body model is at hand."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint_positions", frozen(self.joint_positions))
        frames = len(self.joint_positions)
        check_shape(f"person {self.name!r}", "joint_positions", self.joint_positions, (frames, len(JOINTS), 3))
        check_shape(f"person {self.name!r}", "joint_quats", np.asarray(self.joint_quats), (frames, len(JOINTS), 4))
        check_finite(f"person {self.name!r}", {"joint_positions": self.joint_positions})
        object.__setattr__(self, "joint_quats", _unit_quats(f"person {self.name!r}", "joint_quats", self.joint_quats))

    def position(self, joint: str) -> Float[np.ndarray, "T 3"]:
        """Return the world position of a joint [m]."""
        return self.joint_positions[:, JOINT_INDEX[joint]]

    def quat(self, joint: str) -> Float[np.ndarray, "T 4"]:
        """Return the world rotation of a joint."""
        return self.joint_quats[:, JOINT_INDEX[joint]]

    def part_position(self, part: str) -> Float[np.ndarray, "T 3"]:
        """Return the world position of a part's contact point [m]."""
        return np.mean([self.position(joint) for joint in PARTS[part].point_joints], axis=0)

    def part_quat(self, part: str) -> Float[np.ndarray, "T 4"]:
        """Return the world rotation of a part."""
        return self.quat(PARTS[part].rotation_joint)

    @property
    def height(self) -> float:
        """Standing height [m], estimated from the skeleton's legs, their mean, and its trunk."""
        legs = [self._length(f"{side}_hip", f"{side}_knee", f"{side}_ankle") for side in ("left", "right")]
        trunk = self._length("pelvis", "spine1", "spine2", "spine3", "neck", "head")
        return HEIGHT_OVER_CHAIN * (float(np.mean(legs)) + trunk)

    def _length(self, *chain: str) -> float:
        """Return the length of a chain of joints [m], its mean over time."""
        bones = [np.linalg.norm(self.position(b) - self.position(a), axis=-1) for a, b in pairwise(chain)]
        return float(np.mean(np.sum(bones, axis=0)))


@dataclass(frozen=True, eq=False)
class ObjectGeometry:
    """What is known of an object's shape, in the object's frame at captured size."""

    points: Float[np.ndarray, "P 3"]
    """Points that contain the extreme ones in every direction (mesh or hull vertices) [m]."""
    mesh_path: Path | None = None
    """The mesh file, for pictures and the surface; None where only points are known."""
    faces: Int[np.ndarray, "F 3"] | None = None
    """Triangles over `points`, where these are a whole mesh; None where they are not."""
    file: Path | None = None
    """The file that points and triangles are from, as the pose's frame has them; None where they came with the clip."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points))
        check_shape("object geometry", "points", self.points, (len(self.points), 3))
        if len(self.points) == 0:
            raise ClipError("object geometry: there are no points; a mesh or sample points are needed.")
        check_finite("object geometry", {"points": self.points})
        if self.faces is not None:
            object.__setattr__(self, "faces", frozen(self.faces, int))
            check_shape("object geometry", "faces", self.faces, (len(self.faces), 3))
            if ((self.faces < 0) | (self.faces >= len(self.points))).any():
                raise ClipError(f"object geometry: faces name points beyond the {len(self.points)} that there are.")

    def lowest_along(self, directions: Float[np.ndarray, "F 3"]) -> Float[np.ndarray, "F"]:
        """Return the smallest scalar product of each direction, in the object's frame, with any point [m]."""
        step = max(1, _BLOCK // len(self.points))
        return np.concatenate(
            [
                (directions[first : first + step] @ self.points.T).min(axis=1)
                for first in range(0, len(directions), step)
            ]
        )


@dataclass(frozen=True, eq=False)
class ObjectTrack:
    """One object's pose over time and its geometry."""

    name: str
    positions: Float[np.ndarray, "T 3"]
    """World position of the object's origin [m]."""
    quats: Float[np.ndarray, "T 4"]
    """World rotation, wxyz."""
    geometry: ObjectGeometry

    def __post_init__(self) -> None:
        object.__setattr__(self, "positions", frozen(self.positions))
        frames = len(self.positions)
        check_shape(f"object {self.name!r}", "positions", self.positions, (frames, 3))
        check_shape(f"object {self.name!r}", "quats", np.asarray(self.quats), (frames, 4))
        check_finite(f"object {self.name!r}", {"positions": self.positions})
        object.__setattr__(self, "quats", _unit_quats(f"object {self.name!r}", "quats", self.quats))

    @property
    def lowest(self) -> Float[np.ndarray, "T"]:
        """Height of the object's lowest point in each frame [m]."""
        return self.positions[:, 2] + self.geometry.lowest_along(se3.quat_to_matrix(self.quats)[:, 2])

    def to_object(self, points_world: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "T 3"]:
        """Return world points, one a frame, in the object's frame [m] (paper Eq. 1)."""
        return se3.rotate_inverse(self.quats, points_world - self.positions)


@dataclass(frozen=True, eq=False)
class ContactTrack:
    """When and where one part of one person touches one object."""

    person: int
    object: int
    part: str
    active: Bool[np.ndarray, "T"]
    points_object: Float[np.ndarray, "T 3"]
    """Contact point in the object's frame at captured size [m]; NaN where inactive."""

    def __post_init__(self) -> None:
        owner = f"contact of {self.part!r}"
        if self.part not in PARTS:
            raise ClipError(f"{owner}: no such part. Parts: {', '.join(PARTS)}.")
        object.__setattr__(self, "active", frozen(self.active, bool))
        points = np.where(self.active[:, None], np.asarray(self.points_object, dtype=float), np.nan)
        object.__setattr__(self, "points_object", frozen(points))
        check_shape(owner, "points_object", self.points_object, (len(self.active), 3))
        missing = self.active & ~np.isfinite(self.points_object).all(axis=1)
        if missing.any():
            raise ClipError(f"{owner}: active without a point in {describe_frames(np.flatnonzero(missing))}.")

    @property
    def segments(self) -> tuple[tuple[int, int], ...]:
        """Contiguous runs of active frames as (first, one past the last)."""
        return runs(self.active)


@dataclass(frozen=True)
class Augmentation:
    """What was done to a whole recording to get another clip of it; nothing by default."""

    mirrored: bool = False
    """Left for right."""
    speed: float = 1.0
    """How many times as fast as recorded."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.speed) and self.speed > 0):
            raise ArgumentError(f"The speed is {self.speed}; it must be a positive number.")


@dataclass(frozen=True)
class Source:
    """Where a clip comes from."""

    path: str = ""
    sha256: str = ""
    format: str = ""
    licence: str = ""
    notes: tuple[str, ...] = field(default=())
    """What the reader found and decided, one sentence each."""
    contact_edits: str = ""
    """Text of the contact edits that were applied to the contacts as recorded; empty where none were."""
    augmentation: Augmentation = Augmentation()
    """What was done after that."""
    doubts: tuple[str, ...] = ()
    """What looks wrong but does not stop anybody, one sentence each."""
    files: tuple[str, ...] = ()
    """Other files that the clip was read from: companions and meshes; not the body models."""


@dataclass(frozen=True, eq=False)
class Clip:
    """A recorded human-object interaction.

    Raises `ClipError` when arrays disagree in length, numbers are not finite, rotations are zero,
    or there are fewer than four frames.
    """

    name: str
    fps: float
    people: tuple[Person, ...]
    objects: tuple[ObjectTrack, ...]
    contacts: tuple[ContactTrack, ...]
    source: Source = Source()
    first_source_frame: int = 0
    """How many leading frames of the source were dropped."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise ClipError(f"clip {self.name!r}: the rate is {self.fps} frames a second; it must be positive.")
        if not self.people:
            raise ClipError(f"clip {self.name!r}: there is no person in it.")
        lengths = {f"person {person.name!r}": len(person.joint_positions) for person in self.people}
        lengths |= {f"object {track.name!r}": len(track.positions) for track in self.objects}
        lengths |= {f"contact of {track.part!r}": len(track.active) for track in self.contacts}
        if len(set(lengths.values())) > 1:
            listing = ", ".join(f"{owner}: {length}" for owner, length in lengths.items())
            raise ClipError(f"clip {self.name!r}: tracks differ in their number of frames ({listing}).")
        if self.frames < MINIMUM_FRAMES:
            raise ClipError(f"clip {self.name!r}: {self.frames} usable frame(s); at least {MINIMUM_FRAMES} are needed.")
        for track in self.contacts:
            if not (0 <= track.person < len(self.people) and 0 <= track.object < len(self.objects)):
                raise ClipError(f"clip {self.name!r}: a contact of {track.part!r} names an absent person or object.")

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.people[0].joint_positions)


def _unit_quats(owner: str, name: str, quats: np.ndarray) -> np.ndarray:
    quats = np.asarray(quats, dtype=float)
    check_finite(owner, {name: quats})
    norms = np.linalg.norm(quats, axis=-1)
    # Sources store single precision: anything within 1 % of unit length is rounding, the rest is damage.
    bad = (np.abs(norms - 1.0) > 0.01).any(axis=tuple(range(1, norms.ndim)))
    if bad.any():
        raise ClipError(f"{owner}: {name} are not unit quaternions in {describe_frames(np.flatnonzero(bad))}.")
    return frozen(quats / norms[..., None])
