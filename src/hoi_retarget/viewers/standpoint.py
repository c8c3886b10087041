"""Where to stand to see a scene: so that all of it is in the picture, and people stand side by side."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.viewers.drawing import Lines, Scene, Solid, Subject

ELEVATION = 0.2
"""How far above the horizon the camera stands [rad]."""
_LEFT_OUT = 2.5  # Share of the frames that may leave the picture, to each side [%].


@dataclass(frozen=True, eq=False)
class Standpoint:
    """A direction from which to look, and the window in which the scene is seen from there."""

    azimuth: float
    """Of the camera about what it looks at, from the x axis towards the y axis [rad]."""
    elevation: float
    """[rad]"""
    shift: Float[np.ndarray, "3"]
    """From the centre that it follows to the middle of what is seen [m]."""
    half_width: float
    """[m]"""
    half_height: float
    """[m]"""

    def distance(self, aspect: float, field_of_view: float) -> float:
        """Return from how far [m] a picture of some width over height and a vertical field of view [rad] sees it."""
        return float(max(self.half_height, self.half_width / aspect) / np.tan(0.5 * field_of_view))


@dataclass(frozen=True, eq=False)
class _Extent:
    """Where one part is about the centre that the camera follows."""

    places: Float[np.ndarray, "T N 3"]
    """[m]"""
    reach: Float[np.ndarray, "N"]
    """How far it reaches around them [m]."""


def standpoint(scene: Scene, ahead: Float[np.ndarray, "2"]) -> Standpoint:
    """Return where to stand: across the direction in which things spread most, on the side that they face.

    Args:
        scene: What is looked at; only layers that are shown count.
        ahead: Horizontal direction that the robots face, of any length.
    """
    extents = [extent for subject in scene.subjects for extent in _extents(subject)]
    spread = np.eye(2)
    for extent in extents:
        flat = extent.places[..., :2].reshape(-1, 2)
        spread += flat.T @ flat
    widest = np.linalg.eigh(spread)[1][:, 1]
    back = np.array([-widest[1], widest[0]])
    if back @ ahead < 0:
        back = -back
    right = np.array([-back[1], back[0], 0.0])
    (left_edge, right_edge), (low, high) = (_window(extents, axis) for axis in (right, np.array([0.0, 0.0, 1.0])))
    shift = 0.5 * (left_edge + right_edge) * right + np.array([0.0, 0.0, 0.5 * (low + high)])
    azimuth = float(np.arctan2(back[1], back[0]))
    return Standpoint(azimuth, ELEVATION, shift, 0.5 * (right_edge - left_edge), 0.5 * (high - low))


def _extents(subject: Subject) -> Iterator[_Extent]:
    for layer in subject.layers:
        for part in layer.parts:
            if not layer.shown or isinstance(part, Lines):
                continue
            places = part.positions.reshape(subject.frames, -1, 3) - subject.centre[:, None]
            if isinstance(part, Solid):
                yield _Extent(places, np.linalg.norm(part.vertices, axis=1).max(keepdims=True))
            elif len(part.sizes):
                yield _Extent(places, np.linalg.norm(part.sizes, axis=1))


def _window(extents: list[_Extent], axis: Float[np.ndarray, "3"]) -> tuple[float, float]:
    """Return between what numbers along an axis things are in nearly all frames [m]."""
    lows = [np.percentile((item.places @ axis - item.reach).min(axis=1), _LEFT_OUT) for item in extents]
    highs = [np.percentile((item.places @ axis + item.reach).max(axis=1), 100 - _LEFT_OUT) for item in extents]
    return float(min(lows, default=-0.5)), float(max(highs, default=0.5))
