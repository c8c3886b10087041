"""Automatic cameras: the extents of a scene about the followed point, and the distance that shows all of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hoi_retarget.numerics import se3
from hoi_retarget.studio.scene.drawing import DrawnScene, Lines, Part, Solid

_CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])


@dataclass(frozen=True, eq=False)
class Extent:
    """Balls around one part of a scene in T frames, about the point that a camera follows."""

    points: Float[np.ndarray, "T N 3"]  # [m]
    radii: Float[np.ndarray, "N"]  # [m]

    def reach(self, axis: Float[np.ndarray, "3"], origin: Float[np.ndarray, "3"]) -> Float[np.ndarray, "T"]:
        """Return the part's reach from an origin along an axis in each frame [m]."""
        return ((self.points - origin) @ axis + self.radii).max(axis=1)


def extents(scene: DrawnScene, frames: Sequence[int], followed: Float[np.ndarray, "T 3"]) -> list[Extent]:
    """Return the extents of all shown shapes and solids in T frames, about the followed point of each [m]."""
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
    """Return a camera's axes as rows, right, up and backwards, from its direction as seen from its target [rad]."""
    back = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(back, right), back])


def distance_to_see(reaches: Float[np.ndarray, "K 3"], aspect: float, slope: float) -> float:
    """Return the distance from which a camera has everything in its picture [m].

    Parts reach to a side, up or down, and backwards from the camera's target [m]. The aspect is the picture's width
    over its height, the slope the tangent of half the field of view, from bottom to top.
    """
    sideways, upright, near = reaches.T
    return float(np.max(np.maximum(upright, sideways / aspect) / slope + near))


FIELD_OF_VIEW = 45.0  # From the bottom of a picture to its top [deg].
CLOSE_REACH = 0.22  # What is seen around a hand from near, above and below it [m].
_MARGIN = 1.05
_SAMPLED_FRAMES, _SAMPLED_HEIGHTS = 60, 12  # To find the distance.
_MAX_SIDE_DISTANCE = 1.3  # From a followed subject; points farther to the side may be out of the picture [m].


@dataclass(frozen=True, eq=False)
class Camera:
    """Camera of one picture."""

    point: Float[np.ndarray, "3"]  # Target [m].
    distance: float  # [m]
    azimuth: float  # Viewing direction, from the x axis towards the y axis [deg].
    elevation: float  # [deg]; negative looks down.


@dataclass(frozen=True)
class CameraSettings:
    """Direction, distance and motion of a camera over a film."""

    azimuth: float  # [deg]
    elevation: float = -12.0  # [deg]
    distance: float | None = None  # [m]; None for as near as possible.
    follow: bool = True  # Whether the camera moves along; otherwise it stays where it sees the whole motion.
    look: str | None = None  # Name of the subjects' `look_at_targets` to stay near to; None to see everything.


def cameras(scenes: Sequence[DrawnScene], view: CameraSettings, aspect: float) -> list[Callable[[int], Camera]]:
    """Return cameras of every frame for scenes beside each other, at one distance and with the floors at one height.

    The aspect is a picture's width over its height.
    """
    if view.look is not None:
        return [_close_camera(scene, view, view.look) for scene in scenes]
    right, up, back = camera_axes(np.radians(view.azimuth) + np.pi, -np.radians(view.elevation))
    slope = np.tan(np.radians(FIELD_OF_VIEW / 2)) / _MARGIN
    looks = [_points_to_see(scene, view.follow) for scene in scenes]
    shifts = [0.5 * ((points @ right).min() + (points @ right).max()) * right for points, _ in looks]

    def distance(height: float) -> float:
        needed = []
        for (points, radii), shift in zip(looks, shifts, strict=True):
            seen = points - shift - [0.0, 0.0, height]
            reaches = [np.abs(seen @ right) + radii, np.abs(seen @ up) + radii, seen @ back]
            needed.append(distance_to_see(np.column_stack(reaches), aspect, slope))
        return max(needed)

    heights = np.linspace(0.0, max(points[:, 2].max() for points, _ in looks), _SAMPLED_HEIGHTS)
    nearest, height = min((distance(height), height) for height in heights)
    chosen = nearest if view.distance is None else view.distance
    return [_camera_of(scene, view, height, shift, chosen) for scene, shift in zip(scenes, shifts, strict=True)]


def _close_camera(scene: DrawnScene, view: CameraSettings, look: str) -> Callable[[int], Camera]:
    """Return a camera near to the first look of that name, or to the middle of the scene where there is none."""
    subject, path = next(
        ((subject, subject.look_at_targets[look]) for subject in scene.subjects if look in subject.look_at_targets),
        (scene.subjects[0], scene.subjects[0].centre),
    )
    nearest = CLOSE_REACH / np.tan(np.radians(FIELD_OF_VIEW / 2))
    distance = float(nearest) if view.distance is None else view.distance
    return lambda frame: Camera(path[scene.frame_of(subject, frame)], distance, view.azimuth, view.elevation)


def _camera_of(
    scene: DrawnScene, view: CameraSettings, height: float, shift: Float[np.ndarray, "3"], distance: float
) -> Callable[[int], Camera]:
    def camera(frame: int) -> Camera:
        place = _followed(scene, frame, view.follow) + shift
        return Camera(np.array([place[0], place[1], height]), distance, view.azimuth, view.elevation)

    return camera


def _followed(scene: DrawnScene, frame: int, follow: bool) -> Float[np.ndarray, "3"]:
    """Return the point of the floor under the middle of the subjects, in a frame or over time [m]."""
    middle = scene.centre(frame) if follow else np.mean([item.centre.mean(axis=0) for item in scene.subjects], axis=0)
    return middle * [1.0, 1.0, 0.0]


def _points_to_see(scene: DrawnScene, follow: bool) -> tuple[Float[np.ndarray, "K 3"], Float[np.ndarray, "K"]]:
    """Return points that a camera should see over time, relative to the floor below its target, and their radii [m]."""
    frames = np.unique(np.linspace(0, scene.frames - 1, _SAMPLED_FRAMES).round().astype(int)).tolist()
    seen = extents(scene, frames, np.stack([_followed(scene, frame, follow) for frame in frames]))
    points = np.concatenate([extent.points.reshape(-1, 3) for extent in seen])
    radii = np.concatenate([np.tile(extent.radii, len(frames)) for extent in seen])
    near = np.linalg.norm(points[:, :2], axis=1) < (_MAX_SIDE_DISTANCE if follow else np.inf)
    return points[near], radii[near]


ELEVATION = 0.2  # Of the camera above the horizon [rad].
_LEFT_OUT = 2.5  # Share of the frames that may leave the picture, to each side [%].


@dataclass(frozen=True, eq=False)
class FittedCamera:
    """A direction from which to look, and the window in which the scene is seen from there."""

    azimuth: float  # Of the camera about its target, from the x axis towards the y axis [rad].
    elevation: float  # [rad]
    shift: Float[np.ndarray, "3"]  # From the followed centre to the middle of the scene, as seen from there [m].
    reaches: Float[np.ndarray, "K 3"]
    """Of each part: its reach to a side, up or down, and towards the camera from that middle [m]."""
    front: float = 0.0  # Where a camera stands that sees the robots from the front [rad].

    def distance(self, aspect: float, field_of_view: float) -> float:
        """Return the distance [m] for a picture of some width over height and a vertical field of view [rad]."""
        return distance_to_see(self.reaches, aspect, np.tan(0.5 * field_of_view))

    def camera(self, scene: DrawnScene, frame: int, aspect: float) -> Camera:
        """Return the camera of a frame in a picture of some width over height."""
        distance = 1.03 * self.distance(aspect, np.radians(FIELD_OF_VIEW))
        # A camera's azimuth is where it looks, here it is where it stands.
        azimuth, elevation = np.degrees(self.azimuth) + 180.0, -np.degrees(self.elevation)
        return Camera(scene.centre(frame) + self.shift, distance, azimuth, elevation)


def fit_camera(scene: DrawnScene, ahead: Float[np.ndarray, "2"]) -> FittedCamera:
    """Return a camera that stands across the direction of the scene's largest spread, on the side that robots face.

    Only shown layers count; `ahead` is the horizontal direction that the robots face, of any length.
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


def fit_each(subplots: DrawnScene, place: FittedCamera) -> FittedCamera:
    """Return a camera with the direction of another one that sees each subject alone, about its own centre."""
    seen = []
    for subject in subplots.subjects:
        alone = DrawnScene((subject,))
        frames = range(alone.frames)
        seen += extents(alone, frames, np.stack([alone.centre(frame) for frame in frames]))
    shift, reaches = fit_window(seen, camera_axes(place.azimuth, 0.0), _LEFT_OUT)
    return replace(place, shift=shift, reaches=reaches)


def fit_window(
    seen: Sequence[Extent], axes: Float[np.ndarray, "3 3"], left_out: float = 0.0
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "K 3"]]:
    """Return the middle of all extents, from the followed point, and the reaches of each from there [m].

    The axes are those of `camera_axes`. A share of the frames, `left_out`, may leave the picture to each side [%].
    """

    def reach(extent: Extent, axis: np.ndarray, origin: np.ndarray) -> float:
        return float(np.percentile(extent.reach(axis, origin), 100 - left_out))

    shift = np.zeros(3)
    for axis in axes[:2]:
        ways = (axis, -axis)
        highest, lowest = (max((reach(extent, way, np.zeros(3)) for extent in seen), default=0.0) for way in ways)
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
