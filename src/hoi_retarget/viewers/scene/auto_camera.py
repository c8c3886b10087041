"""Automatic cameras: the whole scene in the picture, and people side by side."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.viewers.scene.camera import FIELD_OF_VIEW, Camera
from hoi_retarget.viewers.scene.drawing import Scene
from hoi_retarget.viewers.scene.extent import Extent, camera_axes, distance_to_see, extents

ELEVATION = 0.2
"""Of the camera above the horizon [rad]."""
_LEFT_OUT = 2.5  # Share of the frames that may leave the picture, to each side [%].


@dataclass(frozen=True, eq=False)
class FittedCamera:
    """A direction from which to look, and the window in which the scene is seen from there."""

    azimuth: float
    """Of the camera about its target, from the x axis towards the y axis [rad]."""
    elevation: float
    """[rad]"""
    shift: Float[np.ndarray, "3"]
    """From the followed centre to the middle of the scene, as seen from there [m]."""
    reaches: Float[np.ndarray, "K 3"]
    """Of each part: its reach to a side, up or down, and towards the camera from that middle [m]."""
    front: float = 0.0
    """Where a camera stands that sees the robots from the front [rad]."""

    def distance(self, aspect: float, field_of_view: float) -> float:
        """Return from how far [m] a picture of some width over height and a vertical field of view [rad] sees it."""
        return distance_to_see(self.reaches, aspect, np.tan(0.5 * field_of_view))

    def camera(self, scene: Scene, frame: int, aspect: float) -> Camera:
        """Return the camera of a frame in a picture of some width over height."""
        distance = 1.03 * self.distance(aspect, np.radians(FIELD_OF_VIEW))
        # A camera's azimuth is where it looks, here it is where it stands.
        azimuth, elevation = np.degrees(self.azimuth) + 180.0, -np.degrees(self.elevation)
        return Camera(scene.centre(frame) + self.shift, distance, azimuth, elevation)


def fit_camera(scene: Scene, ahead: Float[np.ndarray, "2"]) -> FittedCamera:
    """Return a camera that stands across the direction in which things spread most, on the side that they face.

    Args:
        scene: What is looked at; only layers that are shown count.
        ahead: Horizontal direction that the robots face, of any length.
    """
    frames = range(scene.frames)
    seen = extents(scene, frames, np.stack([scene.centre(frame) for frame in frames]))
    spread = np.eye(2)
    for extent in seen:
        flat = extent.points[..., :2].reshape(-1, 2)
        spread += flat.T @ flat
    widest = np.linalg.eigh(spread)[1][:, 1]
    back = np.array([-widest[1], widest[0]])
    if back @ ahead < 0:
        back = -back
    azimuth = float(np.arctan2(back[1], back[0]))
    front = float(np.arctan2(ahead[1], ahead[0]))
    return FittedCamera(azimuth, ELEVATION, *fit_window(seen, camera_axes(azimuth, 0.0), _LEFT_OUT), front)


def fit_each(panes: Scene, place: FittedCamera) -> FittedCamera:
    """Return a camera with the direction of another one that sees each subject alone, about its own centre."""
    seen = []
    for subject in panes.subjects:
        alone = Scene((subject,))
        frames = range(alone.frames)
        seen += extents(alone, frames, np.stack([alone.centre(frame) for frame in frames]))
    shift, reaches = fit_window(seen, camera_axes(place.azimuth, 0.0), _LEFT_OUT)
    return replace(place, shift=shift, reaches=reaches)


def fit_window(
    seen: Sequence[Extent], axes: Float[np.ndarray, "3 3"], left_out: float = 0.0
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "K 3"]]:
    """Return the middle of all extents, from the followed point, and the reaches of each from there [m].

    Args:
        seen: The things.
        axes: Of `camera_axes`.
        left_out: Share of the frames that may leave the picture, to each side [%].
    """

    def reach(extent: Extent, axis: np.ndarray, origin: np.ndarray) -> float:
        return float(np.percentile(extent.reach(axis, origin), 100 - left_out))

    shift = np.zeros(3)
    for axis in axes[:2]:
        highest, lowest = (
            max((reach(extent, way, np.zeros(3)) for extent in seen), default=0.0) for way in (axis, -axis)
        )
        shift += 0.5 * (highest - lowest) * axis
    right, up, back = axes
    reaches = [
        (
            max(reach(extent, right, shift), reach(extent, -right, shift)),
            max(reach(extent, up, shift), reach(extent, -up, shift)),
            reach(extent, back, shift),
        )
        for extent in seen
    ]
    return shift, np.array(reaches or [[0.5] * 3])
