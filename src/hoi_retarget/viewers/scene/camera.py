"""Cameras of films: all that matters is in the picture, and nothing shakes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.viewers.scene.drawing import Scene
from hoi_retarget.viewers.scene.extent import camera_axes, distance_to_see, extents

FIELD_OF_VIEW = 45.0
"""From the bottom of a picture to its top [deg]."""
CLOSE_REACH = 0.22
"""What is seen around a hand from near, above and below it [m]."""
_MARGIN = 1.05
_LOOKS, _HEIGHTS = 60, 12  # Frames and heights that are tried to find the distance.
_AT_HAND = 1.3  # What is farther to the side of whom the camera follows may be out of the picture [m].


@dataclass(frozen=True, eq=False)
class Camera:
    """Camera of one picture."""

    point: Float[np.ndarray, "3"]
    """Target [m]."""
    distance: float
    """[m]"""
    azimuth: float
    """Viewing direction, from the x axis towards the y axis [deg]."""
    elevation: float
    """[deg]; negative looks down."""


@dataclass(frozen=True)
class CameraSettings:
    """Direction, distance and motion of a camera over a film."""

    azimuth: float
    """[deg]"""
    elevation: float = -12.0
    """[deg]"""
    distance: float | None = None
    """[m]; None for as near as possible."""
    follow: bool = True
    """Whether the camera moves along; otherwise it stays where it sees the whole motion."""
    look: str | None = None
    """One of the subjects' `looks`, to stay near to; None to see everything."""


def cameras(scenes: Sequence[Scene], view: CameraSettings, aspect: float) -> list[Callable[[int], Camera]]:
    """Return, for each scene, the camera of every frame: at one distance, and with the floors at one height.

    Args:
        scenes: What pictures beside each other show.
        view: How to look at them.
        aspect: Width of a picture over its height.
    """
    if view.look is not None:
        return [_close_camera(scene, view, view.look) for scene in scenes]
    right, up, back = camera_axes(np.radians(view.azimuth) + np.pi, -np.radians(view.elevation))
    slope = np.tan(np.radians(FIELD_OF_VIEW / 2)) / _MARGIN
    looks = [_look(scene, view.follow) for scene in scenes]
    shifts = [0.5 * ((points @ right).min() + (points @ right).max()) * right for points, _ in looks]

    def distance(height: float) -> float:
        needed = []
        for (points, radii), shift in zip(looks, shifts, strict=True):
            seen = points - shift - [0.0, 0.0, height]
            reaches = [np.abs(seen @ right) + radii, np.abs(seen @ up) + radii, seen @ back]
            needed.append(distance_to_see(np.column_stack(reaches), aspect, slope))
        return max(needed)

    heights = np.linspace(0.0, max(points[:, 2].max() for points, _ in looks), _HEIGHTS)
    nearest, height = min((distance(height), height) for height in heights)
    chosen = nearest if view.distance is None else view.distance
    return [_camera_of(scene, view, height, shift, chosen) for scene, shift in zip(scenes, shifts, strict=True)]


def _close_camera(scene: Scene, view: CameraSettings, look: str) -> Callable[[int], Camera]:
    """Return a camera near to the first look of that name, or to the middle of the scene where there is none."""
    subject, path = next(
        ((subject, subject.looks[look]) for subject in scene.subjects if look in subject.looks),
        (scene.subjects[0], scene.subjects[0].centre),
    )
    nearest = CLOSE_REACH / np.tan(np.radians(FIELD_OF_VIEW / 2))
    distance = float(nearest) if view.distance is None else view.distance

    def camera(frame: int) -> Camera:
        return Camera(path[scene.frame_of(subject, frame)], distance, view.azimuth, view.elevation)

    return camera


def _camera_of(
    scene: Scene, view: CameraSettings, height: float, shift: Float[np.ndarray, "3"], distance: float
) -> Callable[[int], Camera]:
    def camera(frame: int) -> Camera:
        place = _followed(scene, frame, view.follow) + shift
        return Camera(np.array([place[0], place[1], height]), distance, view.azimuth, view.elevation)

    return camera


def _followed(scene: Scene, frame: int, follow: bool) -> Float[np.ndarray, "3"]:
    """Return the point of the floor under the middle of the subjects, in a frame or over time [m]."""
    middle = scene.centre(frame) if follow else np.mean([item.centre.mean(axis=0) for item in scene.subjects], axis=0)
    return middle * [1.0, 1.0, 0.0]


def _look(scene: Scene, follow: bool) -> tuple[Float[np.ndarray, "K 3"], Float[np.ndarray, "K"]]:
    """Return points that a camera should see over time, from the floor below what it follows, and their radii [m]."""
    frames = np.unique(np.linspace(0, scene.frames - 1, _LOOKS).round().astype(int)).tolist()
    seen = extents(scene, frames, np.stack([_followed(scene, frame, follow) for frame in frames]))
    points = np.concatenate([extent.points.reshape(-1, 3) for extent in seen])
    radii = np.concatenate([np.tile(extent.radii, len(frames)) for extent in seen])
    near = np.linalg.norm(points[:, :2], axis=1) < (_AT_HAND if follow else np.inf)
    return points[near], radii[near]
