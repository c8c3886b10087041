"""Small pictures of a result: one while it touches something, and a short film."""

import numpy as np
from PIL import Image

from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.viewers.offscreen import stage
from hoi_retarget.viewers.offscreen.film import webp
from hoi_retarget.viewers.offscreen.renderer import Picture, offscreen_renderer
from hoi_retarget.viewers.offscreen.robot_picture import png
from hoi_retarget.viewers.scene.auto_camera import FittedCamera
from hoi_retarget.viewers.scene.drawing import Scene

STILL, MOVING = ".png", ".webp"
"""Endings of their files."""
WIDTH, HEIGHT = 720, 405  # [px]
_MOVING_WIDTH, _MOVING_HEIGHT = 320, 180  # [px]
_FRAMES, _RATE, _QUALITY = 24, 8.0, 50  # Of the film: of motions of any length, a second, of 100.


def thumbnails(scene: Scene, frame: int, fitted: FittedCamera) -> dict[str, bytes]:
    """Return a frame and the motion as a PNG and an animated WebP file, by their endings; raises as `picture_of`."""
    return {STILL: png(picture_of(scene, frame, fitted)), MOVING: webp(_film(scene, fitted), _RATE, _QUALITY)}


def picture_of(scene: Scene, frame: int, fitted: FittedCamera) -> Picture:
    """Return a frame, small.

    Raises:
        DrawingError: This machine has no way to draw without a screen.
    """
    with offscreen_renderer(scene, WIDTH, HEIGHT) as draw:
        return draw(frame, fitted.camera(scene, frame, WIDTH / HEIGHT))


def _film(scene: Scene, fitted: FittedCamera) -> list[Picture]:
    """Return frames of all of the motion, drawn twice as large and halved, which smooths them."""
    size = (_MOVING_WIDTH, _MOVING_HEIGHT)
    frames = np.linspace(0, scene.frames - 1, min(_FRAMES, scene.frames)).round().astype(int).tolist()
    with offscreen_renderer(scene, 2 * size[0], 2 * size[1], stage.QUICK) as draw:
        drawn = [draw(frame, fitted.camera(scene, frame, size[0] / size[1])) for frame in frames]
    return [np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.BOX)) for picture in drawn]


def representative_frame(motion: Motion) -> int:
    """Return the middle of the longest contact; that of the motion where nothing is touched."""
    contacts = [run for flags in motion.contact_flags.T for run in runs(flags)]
    first, stop = max(contacts, key=lambda run: run[1] - run[0], default=(0, motion.frames))
    return (first + stop) // 2
