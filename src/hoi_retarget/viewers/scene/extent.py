"""The room that a scene takes up about the point that a camera follows, and the distance that shows it all."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.viewers.scene.drawing import Lines, Part, Scene, Solid

_CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])


@dataclass(frozen=True, eq=False)
class Extent:
    """Balls around one part of a scene in T frames, about the point that a camera follows."""

    points: Float[np.ndarray, "T N 3"]
    """[m]"""
    radii: Float[np.ndarray, "N"]
    """[m]"""

    def reach(self, axis: Float[np.ndarray, "3"], origin: Float[np.ndarray, "3"]) -> Float[np.ndarray, "T"]:
        """Return how far the part reaches from an origin along an axis in each frame [m]."""
        return ((self.points - origin) @ axis + self.radii).max(axis=1)


def extents(scene: Scene, frames: Sequence[int], followed: Float[np.ndarray, "T 3"]) -> list[Extent]:
    """Return the extents of all shown shapes and solids.

    Args:
        scene: What is looked at.
        frames: T frames of the scene.
        followed: The point that the camera follows in each of them [m].
    """
    found = []
    for subject in scene.subjects:
        own = [scene.frame_of(subject, frame) for frame in frames]
        for part in (part for layer in subject.layers if layer.shown for part in layer.parts):
            points, radii = _balls(part, own)
            if len(radii):
                found.append(Extent(points - followed[:, None], radii))
    return found


def _balls(part: Part, frames: list[int]) -> tuple[Float[np.ndarray, "T N 3"], Float[np.ndarray, "N"]]:
    if isinstance(part, Lines):
        return np.zeros((len(frames), 0, 3)), np.zeros(0)
    positions, quats = part.positions[frames].astype(float), part.quats[frames].astype(float)
    if isinstance(part, Solid):
        low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
        corners = se3.rotate(quats[:, None], low + _CORNERS * (high - low))
        return positions[:, None] + corners, np.zeros(len(_CORNERS))
    # Where a long shape ends, there is another one: its thickness is what is left.
    return positions, np.median(part.sizes, axis=1)


def camera_axes(azimuth: float, elevation: float) -> Float[np.ndarray, "3 3"]:
    """Return a camera's axes as rows, right, up and backwards, from where it stands about what it looks at [rad]."""
    back = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(back, right), back])


def distance_to_see(reaches: Float[np.ndarray, "K 3"], aspect: float, slope: float) -> float:
    """Return from how far [m] a camera has everything in its picture.

    Args:
        reaches: How far each thing reaches to a side, up or down, and backwards from what the camera looks at [m].
        aspect: Width of the picture over its height.
        slope: Tangent of half the field of view, from bottom to top.
    """
    sideways, upright, near = reaches.T
    return float(np.max(np.maximum(upright, sideways / aspect) / slope + near))
