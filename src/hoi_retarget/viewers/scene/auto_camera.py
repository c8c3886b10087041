"""Where to stand to see a scene: so that all of it is in the picture, and people stand side by side."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.viewers.scene.drawing import Lines, Scene, Solid, Subject

ELEVATION = 0.2
"""How far above the horizon the camera stands [rad]."""
_CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
_LEFT_OUT = 2.5  # Share of the frames that may leave the picture, to each side [%].


@dataclass(frozen=True, eq=False)
class FittedCamera:
    """A direction from which to look, and the window in which the scene is seen from there."""

    azimuth: float
    """Of the camera about what it looks at, from the x axis towards the y axis [rad]."""
    elevation: float
    """[rad]"""
    shift: Float[np.ndarray, "3"]
    """From the centre that it follows to the middle of what is seen [m]."""
    reaches: Float[np.ndarray, "K 3"]
    """Of each thing: how far it reaches to a side, up or down, and towards the camera from that middle [m]."""

    def distance(self, aspect: float, field_of_view: float) -> float:
        """Return from how far [m] a picture of some width over height and a vertical field of view [rad] sees it."""
        sideways, upright, near = self.reaches.T
        return float(np.max(np.maximum(upright, sideways / aspect) / np.tan(0.5 * field_of_view) + near))


@dataclass(frozen=True, eq=False)
class _Extent:
    """Where one part is about the centre that the camera follows."""

    places: Float[np.ndarray, "T N 3"]
    """[m]"""
    reach: Float[np.ndarray, "N"]
    """How far it reaches around them [m]."""


def fit_camera(scene: Scene, ahead: Float[np.ndarray, "2"]) -> FittedCamera:
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
    up, towards = np.array([0.0, 0.0, 1.0]), np.array([*back, 0.0])
    shift = sum((_middle(extents, axis) * axis for axis in (right, up)), np.zeros(3))
    reaches = [[_reach(extent, shift, axis) for axis in (right, -right, up, -up, towards)] for extent in extents]
    left_right, up_down, near = np.split(np.array(reaches or [[0.5] * 5]), [2, 4], axis=1)
    azimuth = float(np.arctan2(back[1], back[0]))
    return FittedCamera(
        azimuth, ELEVATION, shift, np.column_stack([left_right.max(axis=1), up_down.max(axis=1), near[:, 0]])
    )


def _extents(subject: Subject) -> Iterator[_Extent]:
    for layer in subject.layers:
        for part in layer.parts:
            if not layer.shown or isinstance(part, Lines):
                continue
            if isinstance(part, Solid):
                low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
                corners = low + _CORNERS * (high - low)
                places = part.positions[:, None] + se3.rotate(part.quats[:, None], corners)
                yield _Extent(places - subject.centre[:, None], np.zeros(len(corners)))
            elif len(part.sizes):
                # Where a long shape ends, there is another one: what is left is how thick it is.
                yield _Extent(part.positions - subject.centre[:, None], np.median(part.sizes, axis=1))


def _middle(extents: list[_Extent], axis: Float[np.ndarray, "3"]) -> float:
    """Return the middle of everything along an axis [m]."""
    highest = max((_reach(extent, np.zeros(3), axis) for extent in extents), default=0.0)
    lowest = -max((_reach(extent, np.zeros(3), -axis) for extent in extents), default=0.0)
    return 0.5 * (highest + lowest)


def _reach(extent: _Extent, origin: Float[np.ndarray, "3"], axis: Float[np.ndarray, "3"]) -> float:
    """Return how far a thing reaches along an axis in nearly all frames [m]."""
    furthest = ((extent.places - origin) @ axis + extent.reach).max(axis=1)
    return float(np.percentile(furthest, 100 - _LEFT_OUT))
