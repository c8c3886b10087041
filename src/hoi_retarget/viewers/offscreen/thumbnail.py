"""A small picture of a result, taken while it touches something."""

import numpy as np

from hoi_retarget.errors import HoiRetargetError
from hoi_retarget.motion.motion import Motion
from hoi_retarget.numerics.arrays import runs
from hoi_retarget.viewers.offscreen.renderer import offscreen_renderer
from hoi_retarget.viewers.offscreen.robot_picture import png
from hoi_retarget.viewers.offscreen.sketch import Eye, sketch
from hoi_retarget.viewers.scene.auto_camera import FittedCamera
from hoi_retarget.viewers.scene.camera import FIELD_OF_VIEW, Camera
from hoi_retarget.viewers.scene.drawing import Scene

WIDTH, HEIGHT = 720, 405  # [px]


def thumbnail(scene: Scene, frame: int, place: FittedCamera) -> tuple[str, bytes]:
    """Return the ending of a picture's file name and its content: a frame, rendered where the machine can."""
    centres = [subject.centre[scene.frame_of(subject, frame)] for subject in scene.subjects]
    point = np.mean(centres, axis=0) + place.shift
    distance = 1.03 * place.distance(WIDTH / HEIGHT, np.radians(FIELD_OF_VIEW))
    # A camera's azimuth is where it looks, a standpoint's where it stands.
    camera = Camera(point, distance, np.degrees(place.azimuth) + 180.0, -np.degrees(place.elevation))
    try:
        with offscreen_renderer(scene, WIDTH, HEIGHT) as drawn:
            return ".png", png(drawn.draw(frame, camera))
    except HoiRetargetError:
        eye = Eye.looking(point, place.azimuth, place.elevation, distance, np.radians(FIELD_OF_VIEW))
        return ".svg", sketch(scene, frame, eye).encode()


def representative_frame(motion: Motion) -> int:
    """Return the middle of the longest contact; that of the motion where nothing is touched."""
    contacts = [run for flags in motion.contact_flags.T for run in runs(flags)]
    first, stop = max(contacts, key=lambda run: run[1] - run[0], default=(0, motion.frames))
    return (first + stop) // 2
