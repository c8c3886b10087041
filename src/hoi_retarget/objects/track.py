"""One object over time: its pose in the world and its geometry.

World frame: z up, floor at z = 0, metres, seconds. All arrays are read-only copies.
"""

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from hoi_retarget.errors import ClipError
from hoi_retarget.numerics import se3
from hoi_retarget.numerics.arrays import check_finite, check_shape, frozen, unit_quats

MOVING_SPEED = 0.15  # [m/s]; a faster object is moved by somebody, or falls.

# Frames times points held at once: 4 MB of doubles, which stays in the cache.
_BLOCK = 500_000


@dataclass(frozen=True, eq=False)
class ObjectGeometry:
    """Known points and triangles of an object's shape, in its frame at captured size."""

    points: Float[np.ndarray, "P 3"]
    """Points that contain the extreme ones in every direction (mesh or hull vertices) [m]."""
    mesh_path: Path | None = None  # The mesh file, for pictures and the surface; None where only points are known.
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

    @property
    def has_surface(self) -> bool:
        """Whether the surface is known, not only points of it."""
        return self.faces is not None or self.mesh_path is not None

    def lowest_along(self, directions: Float[np.ndarray, "F 3"]) -> Float[np.ndarray, "F"]:
        """Return the smallest scalar product of each direction, in the object's frame, with any point [m]."""
        step = max(1, _BLOCK // len(self.points))
        return np.concatenate(
            [
                (directions[first : first + step] @ self.points.T).min(axis=1)
                for first in range(0, len(directions), step)
            ]
        )


JointKind = Literal["fixed", "hinge", "slide"]


@dataclass(frozen=True)
class ObjectJoint:
    """How an object moves in the frame of another one, of which it is a part; raises `ClipError` for a bad axis."""

    parent: str  # Name of the other object; empty for the world, in which a joint is `fixed`.
    kind: JointKind
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Unit vector of a hinge's or a slide's axis in the parent's frame."""
    anchor: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """A point of a hinge's axis in the parent's frame at captured size [m]."""

    def __post_init__(self) -> None:
        if abs(float(np.linalg.norm(self.axis)) - 1.0) > 1e-6 or not np.isfinite(self.anchor).all():
            raise ClipError(f"joint on {self.parent!r}: axis {self.axis} is no unit vector, or its anchor is infinite.")
        if not self.parent and self.kind != "fixed":
            raise ClipError(f"joint: a {self.kind} needs a parent. Only what is fixed hangs on the world itself.")


@dataclass(frozen=True, eq=False)
class ObjectTrack:
    """One object's pose over time, its geometry, and its joint where it is a part of another object."""

    name: str
    positions: Float[np.ndarray, "T 3"]  # World position of the object's origin [m].
    quats: Float[np.ndarray, "T 4"]  # World rotation, wxyz.
    geometry: ObjectGeometry
    joint: ObjectJoint | None = None  # On another object of the clip; None where it is free.

    def __post_init__(self) -> None:
        object.__setattr__(self, "positions", frozen(self.positions))
        frames = len(self.positions)
        check_shape(f"object {self.name!r}", "positions", self.positions, (frames, 3))
        check_shape(f"object {self.name!r}", "quats", np.asarray(self.quats), (frames, 4))
        check_finite(f"object {self.name!r}", {"positions": self.positions})
        object.__setattr__(self, "quats", unit_quats(f"object {self.name!r}", "quats", self.quats))

    @property
    def lowest(self) -> Float[np.ndarray, "T"]:
        """Height of the object's lowest point in each frame [m]."""
        return self.positions[:, 2] + self.geometry.lowest_along(se3.quat_to_matrix(self.quats)[:, 2])

    @property
    def corners(self) -> Float[np.ndarray, "T 8 3"]:
        """World positions of the corners of the object's box, which lies along its own axes [m]."""
        points = self.geometry.points
        box = np.array(list(product(*zip(points.min(axis=0), points.max(axis=0), strict=True))))
        return self.positions[:, None] + se3.rotate(self.quats[:, None], box)

    def at(self, frame: int) -> "ObjectTrack":
        """Return one frame of it."""
        frames = slice(frame, frame + 1)
        return replace(self, positions=self.positions[frames], quats=self.quats[frames])

    def to_object(self, points_world: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "T 3"]:
        """Return world points, one a frame, in the object's frame [m] (paper Eq. 1)."""
        return se3.rotate_inverse(self.quats, points_world - self.positions)
