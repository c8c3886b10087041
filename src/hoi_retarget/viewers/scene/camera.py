"""Where pictures are taken from: so that all that matters is in them, and nothing shakes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.viewers.scene.drawing import Lines, Part, Scene, Shapes

FIELD_OF_VIEW = 45.0
"""From the bottom of a picture to its top [deg]."""
_MARGIN = 1.05
_LOOKS, _HEIGHTS = 60, 12  # Frames and heights that are tried to find the distance.
_AT_HAND = 1.3  # What is farther to the side of whom the camera follows may be out of the picture [m].


@dataclass(frozen=True, eq=False)
class Camera:
    """Where one picture is taken from."""

    point: Float[np.ndarray, "3"]
    """What it looks at [m]."""
    distance: float
    """[m]"""
    azimuth: float
    """Which way it looks, from the x axis towards the y axis [deg]."""
    elevation: float
    """[deg]; negative looks down."""


@dataclass(frozen=True)
class CameraSettings:
    """How a camera looks at a scene over time."""

    azimuth: float
    """[deg]"""
    elevation: float = -12.0
    """[deg]"""
    distance: float | None = None
    """[m]; None for as near as possible."""
    follow: bool = True
    """Whether the camera moves along; otherwise it stays where it sees the whole motion."""


def cameras(scenes: Sequence[Scene], view: CameraSettings, aspect: float) -> list[Callable[[int], Camera]]:
    """Return, for each scene, the camera of every frame: at one distance, and with the floors at one height.

    Args:
        scenes: What pictures beside each other show.
        view: How to look at them.
        aspect: Width of a picture over its height.
    """
    looks = [_look(scene, view.follow) for scene in scenes]
    shifts = [_to_the_middle(look, view) for look in looks]
    reached = [
        (
            max(_distance(look, shift, height, view, aspect) for look, shift in zip(looks, shifts, strict=True)),
            height,
        )
        for height in np.linspace(0.0, max(look.points[:, 2].max() for look in looks), _HEIGHTS)
    ]
    distance, height = min(reached)
    if view.distance is not None:
        distance = view.distance
    return [_camera_of(scene, view, height, shift, distance) for scene, shift in zip(scenes, shifts, strict=True)]


def _camera_of(
    scene: Scene, view: CameraSettings, height: float, shift: Float[np.ndarray, "3"], distance: float
) -> Callable[[int], Camera]:
    def camera(frame: int) -> Camera:
        place = _place(scene, frame if view.follow else None) + shift
        return Camera(np.array([place[0], place[1], height]), distance, view.azimuth, view.elevation)

    return camera


def _place(scene: Scene, frame: int | None) -> Float[np.ndarray, "3"]:
    """Return the middle of the subjects in a frame, or over time [m]."""
    centres = [
        subject.centre.mean(axis=0) if frame is None else subject.centre[scene.frame_of(subject, frame)]
        for subject in scene.subjects
    ]
    return np.mean(centres, axis=0)


@dataclass(frozen=True, eq=False)
class _Look:
    """What a camera should see over time: K points, seen from below where it looks, and what is around them [m]."""

    points: Float[np.ndarray, "K 3"]
    reaches: Float[np.ndarray, "K"]


def _look(scene: Scene, follow: bool) -> _Look:
    points, reaches = [], []
    for frame in np.unique(np.linspace(0, scene.frames - 1, _LOOKS).round().astype(int)).tolist():
        below = _place(scene, frame if follow else None) * [1.0, 1.0, 0.0]
        for subject in scene.subjects:
            for layer in subject.layers:
                for part in layer.parts if layer.shown else ():
                    places, reach = _points(part, scene.frame_of(subject, frame))
                    near = np.linalg.norm((places - below)[:, :2], axis=1) < (_AT_HAND if follow else np.inf)
                    points.append((places - below)[near])
                    reaches.append(reach[near])
    return _Look(np.concatenate(points), np.concatenate(reaches))


def _points(part: Part, frame: int) -> tuple[Float[np.ndarray, "K 3"], Float[np.ndarray, "K"]]:
    if isinstance(part, Lines):
        return np.zeros((0, 3)), np.zeros(0)
    if isinstance(part, Shapes):
        # A long shape is as far to see as its ends, which its neighbours mark: its width is what is left.
        return part.positions[frame].astype(float), np.median(part.sizes, axis=1)
    low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    points = part.positions[frame] + se3.rotate(part.quats[frame].astype(float), low + corners * (high - low))
    return points, np.zeros(len(points))


def _axes(view: CameraSettings) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where the camera's right, up and ahead point."""
    turn, tilt = np.radians(view.azimuth), np.radians(view.elevation)
    right = np.array([np.sin(turn), -np.cos(turn), 0.0])
    ahead = np.array([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)])
    return right, np.cross(right, ahead), ahead


def _to_the_middle(look: _Look, view: CameraSettings) -> Float[np.ndarray, "3"]:
    """Return how far to the side the camera looks, so that what it sees is in the middle of the picture [m]."""
    right, _, _ = _axes(view)
    across = look.points @ right
    return 0.5 * (across.min() + across.max()) * right


def _distance(look: _Look, shift: Float[np.ndarray, "3"], height: float, view: CameraSettings, aspect: float) -> float:
    """Return the distance from which everything is in the picture [m]."""
    right, up, ahead = _axes(view)
    slope = np.tan(np.radians(FIELD_OF_VIEW / 2)) / _MARGIN
    points = look.points - shift - [0.0, 0.0, height]
    widths = np.abs(points @ right) + look.reaches, np.abs(points @ up) + look.reaches
    needed = [width / most - points @ ahead for width, most in zip(widths, (slope * aspect, slope), strict=True)]
    return float(np.max(needed))
