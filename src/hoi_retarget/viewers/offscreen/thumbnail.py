"""A small picture of a result, taken while it touches something."""

from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.viewers.offscreen.renderer import Picture, offscreen_renderer
from hoi_retarget.viewers.offscreen.robot_picture import png
from hoi_retarget.viewers.scene.auto_camera import FittedCamera
from hoi_retarget.viewers.scene.drawing import Scene

WIDTH, HEIGHT = 720, 405  # [px]


def thumbnail(scene: Scene, frame: int, fitted: FittedCamera) -> bytes:
    """Return a frame as a PNG file; raises as `picture_of`."""
    return png(picture_of(scene, frame, fitted))


def picture_of(scene: Scene, frame: int, fitted: FittedCamera) -> Picture:
    """Return a frame, small.

    Raises:
        DrawingError: This machine has no way to draw without a screen.
    """
    with offscreen_renderer(scene, WIDTH, HEIGHT) as draw:
        return draw(frame, fitted.camera(scene, frame, WIDTH / HEIGHT))


def representative_frame(motion: Motion) -> int:
    """Return the middle of the longest contact; that of the motion where nothing is touched."""
    contacts = [run for flags in motion.contact_flags.T for run in runs(flags)]
    first, stop = max(contacts, key=lambda run: run[1] - run[0], default=(0, motion.frames))
    return (first + stop) // 2
