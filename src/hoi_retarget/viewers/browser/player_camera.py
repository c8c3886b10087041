"""The camera of one browser's player: it sees everything that will be there, or stays near a hand.

The camera stays the user's; to follow something, the world is moved under it.
"""

import numpy as np
import viser
from jaxtyping import Float

from hoi_retarget.viewers.scene.auto_camera import fit_window
from hoi_retarget.viewers.scene.camera import CLOSE_REACH
from hoi_retarget.viewers.scene.drawing import Scene, Subject
from hoi_retarget.viewers.scene.extent import camera_axes, distance_to_see, extents

BODY = "body"
"""What is looked at where it is no hand."""
_AZIMUTH, _ELEVATION = np.radians(-55.5), np.radians(13.9)
_MARGIN = 1.08  # Around what is looked at.
_SAMPLES = 12  # Frames that the camera is placed by.


class PlayerCamera:
    """What a browser's camera looks at, in the part of its window that panels leave free."""

    def __init__(self, camera: viser.CameraHandle, beside_px: int, below_px: int) -> None:
        """Begin; panels cover so much of the window at its sides and at the bottom."""
        self._camera, self._beside_px, self._below_px = camera, beside_px, below_px
        self._name = BODY
        self._anchor = np.zeros(3)

    def see_all(self, scene: Scene) -> None:
        """Look at everything that will be there, so that it fills what is free."""
        frames = np.linspace(0, scene.frames - 1, _SAMPLES).astype(int).tolist()
        start = scene.centre(0)
        axes = camera_axes(_AZIMUTH, _ELEVATION)
        shift, reaches = fit_window(
            extents(scene, frames, np.stack([start + _way(scene, frame) for frame in frames])), axes
        )
        window = self._camera
        width, height = max(100, window.image_width - self._beside_px), max(100, window.image_height - self._below_px)
        slope = (
            np.tan(0.5 * window.fov) * height / window.image_height
        )  # Of the whole window what is free has its share.
        distance = distance_to_see(_MARGIN * reaches, width / height, slope)
        look_at = start + shift - self._lift(distance) * axes[1]
        self._camera.position = look_at + distance * axes[2]
        self._camera.look_at = look_at

    def look_at(self, scene: Scene, name: str) -> None:
        """Go near to one of `looks_of` a scene from where the camera is, or see all of it again."""
        self._name = name
        if name == BODY:
            self.see_all(scene)
            return
        window = self._camera
        back = window.position - window.look_at
        axes = camera_axes(np.arctan2(back[1], back[0]), np.arctan2(back[2], np.hypot(back[0], back[1])))
        place, distance = np.array(window.look_at), self._distance(np.array([[CLOSE_REACH, CLOSE_REACH, 0.0]]))
        window.position = place + distance * axes[2]
        window.look_at = place  # Which moved along with the position.
        self._anchor = place + self._lift(distance) * axes[1]

    def world_position(self, scene: Scene, frame: int, *, follow: bool) -> Float[np.ndarray, "3"]:
        """Return where the world is while this frame is shown."""
        if self._name != BODY:
            subject, path = looks_of(scene)[self._name]
            return self._anchor - path[scene.frame_of(subject, frame)]
        return -_way(scene, frame) if follow else np.zeros(3)

    def _distance(self, reaches: Float[np.ndarray, "K 3"]) -> float:
        """Return from how far the part of the window that is free shows everything [m]."""
        window = self._camera
        width, height = max(100, window.image_width - self._beside_px), max(100, window.image_height - self._below_px)
        return distance_to_see(reaches, width / height, np.tan(0.5 * window.fov) * height / window.image_height)

    def _lift(self, distance: float) -> float:
        """Return how far the middle of what is free lies over the middle of the window, at a distance [m]."""
        return self._below_px / self._camera.image_height * np.tan(0.5 * self._camera.fov) * distance


def looks_of(scene: Scene) -> dict[str, tuple[Subject, Float[np.ndarray, "T 3"]]]:
    """Return what can be looked at from near: whose it is, and its path [m] in that subject's frames."""
    several = sum(bool(subject.looks) for subject in scene.subjects) > 1
    return {
        f"{name}, {subject.title}" if several else name: (subject, path)
        for subject in scene.subjects
        for name, path in subject.looks.items()
    }


def _way(scene: Scene, frame: int) -> Float[np.ndarray, "3"]:
    """Return how far the subjects have come since the first frame, on average [m]: over the floor."""
    return (scene.centre(frame) - scene.centre(0)) * [1.0, 1.0, 0.0]
