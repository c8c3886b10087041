"""Shapes, meshes and lines of clips and results over time, for every viewer: a browser, MuJoCo, a page to share.

A `DrawnScene` has one `Subject` per result (or per clip alone); a subject's `Layer`s can be shown one by
one; a layer is made of `Shapes`, `Solid`s and `Lines`. Everything is in world coordinates.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from hoi_retarget.numerics import se3

Colour = tuple[int, int, int]
Numbers = float | Sequence[Any] | np.ndarray  # One number, a row of numbers, or an array.


class Kind(Enum):
    """Unit shapes, about their origin: sizes multiply their half extents."""

    SPHERE = "sphere"  # Radius 1.
    CYLINDER = "cylinder"  # Radius 1, from z = -1 to z = 1.
    BOX = "box"  # From -1 to 1 along each axis.


@dataclass(frozen=True, eq=False)
class Shapes:
    """N copies of one unit shape, each of its own size and colour, over T frames."""

    kind: Kind
    sizes: Float[np.ndarray, "N 3"]  # Half extents along the shape's own axes [m].
    colours: UInt8[np.ndarray, "N 3"]
    positions: Float[np.ndarray, "T N 3"]  # [m]
    quats: Float[np.ndarray, "T N 4"]  # wxyz
    visible: Bool[np.ndarray, "T N"] | None = None  # Presence of each copy in each frame; None for all of them always.

    @classmethod
    def of(  # noqa: PLR0913, PLR0917 - the fields
        cls,
        kind: Kind,
        sizes: Numbers,
        colours: Numbers,
        positions: Float[np.ndarray, "T N 3"],
        quats: Numbers = se3.IDENTITY_QUAT,
        visible: Bool[np.ndarray, "T N"] | None = None,
    ) -> "Shapes":
        """Return shapes in single precision; one size, colour or rotation counts for all copies and frames.

        Args: `kind`: the unit shape; `sizes`: half extents [m]; `colours`: red, green, blue; `positions`: [m]; `quats`:
        wxyz; `visible`: presence of each copy in each frame.
        """
        frames, count = positions.shape[:2]
        return cls(
            kind,
            np.broadcast_to(sizes, (count, 3)).astype(np.float32),
            np.broadcast_to(colours, (count, 3)).astype(np.uint8),
            positions.astype(np.float32),
            np.broadcast_to(quats, (frames, count, 4)).astype(np.float32),
            visible,
        )

    @property
    def count(self) -> int:
        """Number of copies N."""
        return len(self.sizes)


@dataclass(frozen=True, eq=False)
class Solid:
    """A rigid mesh that moves over T frames."""

    vertices: Float[np.ndarray, "V 3"]  # [m]
    faces: Int[np.ndarray, "F 3"]
    colour: Colour
    positions: Float[np.ndarray, "T 3"]  # [m]
    quats: Float[np.ndarray, "T 4"]  # wxyz
    count = 1


@dataclass(frozen=True, eq=False)
class Lines:
    """N straight lines over T frames."""

    starts: Float[np.ndarray, "T N 3"]  # [m]
    ends: Float[np.ndarray, "T N 3"]
    colours: UInt8[np.ndarray, "T N 3"]
    visible: Bool[np.ndarray, "T N"]

    @property
    def count(self) -> int:
        """Number of lines N."""
        return self.starts.shape[1]


Part = Shapes | Solid | Lines


@dataclass(frozen=True, eq=False)
class Layer:
    """Parts that are shown or hidden together."""

    name: str  # Such as `robot`, `inverse kinematics`, `human`, `object`, `human's object`, `contacts`, `stance`.
    parts: tuple[Part, ...]
    opacity: float = 1.0
    shown: bool = True  # Whether it is shown at first.


@dataclass(frozen=True, eq=False)
class Subject:
    """One result, or one clip without a result, in its own place of the scene; T frames."""

    title: str
    fps: float
    layers: tuple[Layer, ...]
    centre: Float[np.ndarray, "T 3"]  # Path of the point that a following camera looks at [m].
    look_at_targets: Mapping[str, Float[np.ndarray, "T 3"]] = field(default_factory=dict)
    """Paths of what a camera can look at from near [m], such as `left hand`."""
    shift: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Of `make_subplots`: from there to its place beside the others on one floor [m]."""
    scale: float = 1.0  # Of `make_subplots`: about the origin, what lays it over the first robot.

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return len(self.centre)


@dataclass(frozen=True, eq=False)
class DrawnScene:
    """Subjects that play together, from the same first frame on."""

    subjects: tuple[Subject, ...]

    @property
    def fps(self) -> float:
        """Frames a second of the scene: the highest rate of its subjects [Hz]."""
        return max(subject.fps for subject in self.subjects)

    @property
    def frames(self) -> int:
        """Number of frames at that rate; subjects that end earlier stay as they end."""
        return max(round((subject.frames - 1) / subject.fps * self.fps) + 1 for subject in self.subjects)

    def with_layers(self, change: Callable[[Layer], Layer]) -> "DrawnScene":
        """Return the scene with every layer changed."""
        return DrawnScene(
            tuple(replace(subject, layers=tuple(map(change, subject.layers))) for subject in self.subjects)
        )

    def frame_of(self, subject: Subject, frame: int) -> int:
        """Return the subject's frame at a frame of the scene."""
        return min(round(frame * subject.fps / self.fps), subject.frames - 1)

    def centre(self, frame: int) -> Float[np.ndarray, "3"]:
        """Return the middle of the subjects' centres in a frame [m]."""
        return np.mean([subject.centre[self.frame_of(subject, frame)] for subject in self.subjects], axis=0)
