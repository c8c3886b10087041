"""Frames of a `Scene` without floor and sky: bodies and their soft shadows on nothing, for pages of any colour.

Where two surfaces come near to each other, as a palm and a box do, the farther one is darker: touch is seen.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter

from hoi_retarget.viewers.offscreen import stage
from hoi_retarget.viewers.offscreen.renderer import filled_renderer
from hoi_retarget.viewers.scene.camera import FIELD_OF_VIEW, Camera
from hoi_retarget.viewers.scene.drawing import Scene

Cutout = Float[np.ndarray, "H W 4"]
"""Red, green, blue and opacity, from 0 to 1; colours are not multiplied by the opacity."""

_FINE = 3  # Pixels that are drawn for each one, in each direction: edges have ten levels of opacity.
_AWAY = -1000.0  # Where the floor and what only casts a shadow are put, beyond what a camera sees [m].
_FAR = 50.0  # Nothing that is drawn is so far away [m].
_SHADOW, _SOFTNESS = 0.3, 0.012  # Opacity of a shadow on the floor, and how far its edge is spread [m].
_NEAR = 0.06  # What is nearer than this darkens what is behind it [m].
_DARKEST, _DIRECTIONS = 0.55, 12


@contextmanager
def cutout_renderer(scene: Scene, width: int, height: int) -> Iterator[Callable[[int, Camera], Cutout]]:
    """Open a function that draws a frame of a scene's shown layers without floor and sky, in a size [px].

    Raises:
        DrawingError: This machine has no way to draw without a screen.
    """
    with filled_renderer(scene, _FINE * width, _FINE * height, stage.UNSMOOTHED) as (renderer, fill):

        def draw(frame: int, camera: Camera) -> Cutout:
            sun = fill(frame, camera)
            drawn = renderer.scene
            _put_away(drawn, range(drawn.ngeom), only=mujoco.mjtGeom.mjGEOM_PLANE)
            colours = renderer.render() / 255.0
            depths = _depths(renderer)
            bodies = drawn.ngeom
            stage.cast_shadows(drawn, sun)
            _put_away(drawn, range(bodies))
            shade = _mean((_depths(renderer) < _FAR).astype(float))
            pixel = 2 * camera.distance * np.tan(np.radians(FIELD_OF_VIEW / 2)) / height
            return _composed(colours, depths, gaussian_filter(shade, _SOFTNESS / pixel), pixel)

        yield draw


def _put_away(drawn: mujoco.MjvScene, indices: range, only: mujoco.mjtGeom | None = None) -> None:
    for index in indices:
        if only is None or drawn.geoms[index].type == only:
            drawn.geoms[index].pos[2] = _AWAY


def _depths(renderer: mujoco.Renderer) -> Float[np.ndarray, "H W"]:
    for index in range(renderer.scene.ngeom):
        renderer.scene.geoms[index].segid = index  # Without one, a shape has no depth.
    renderer.enable_depth_rendering()
    depths = renderer.render().copy()
    renderer.disable_depth_rendering()
    return depths


def _composed(colours: np.ndarray, depths: np.ndarray, shade: np.ndarray, pixel: float) -> Cutout:
    """Return bodies, darker where something is near before them, over their shadows."""
    there = depths < _FAR
    body = _mean(there.astype(float))
    middle = depths[_FINE // 2 :: _FINE, _FINE // 2 :: _FINE]
    light = 1.0 - _DARKEST * _occlusion(middle, pixel)
    own = _mean(colours * there[..., None]) * light[..., None]
    opacity = body + (1.0 - body) * _SHADOW * shade
    return np.dstack([own / np.maximum(opacity, 1e-6)[..., None], opacity])


def _occlusion(depths: Float[np.ndarray, "H W"], pixel: float) -> Float[np.ndarray, "H W"]:
    """Return how much of what is around each pixel is before it, and near: from 0 to 1."""
    hidden = np.zeros(depths.shape)
    turns = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    for reach in (0.25, 0.5, 1.0):
        steps = np.round(reach * _NEAR / pixel * np.column_stack([np.sin(turns), np.cos(turns)])).astype(int)
        for down, right in steps:
            before = depths - np.roll(depths, (down, right), axis=(0, 1))
            hidden += np.clip(before / (0.5 * _NEAR), 0.0, 1.0) * np.clip(2.0 - before / _NEAR, 0.0, 1.0)
    return gaussian_filter(np.clip(2.0 * hidden / (3 * _DIRECTIONS) - 0.1, 0.0, 1.0), 0.8)


def _mean(fine: np.ndarray) -> np.ndarray:
    """Return the means of the fine pixels of each one."""
    height, width = len(fine) // _FINE, fine.shape[1] // _FINE
    return fine.reshape(height, _FINE, width, _FINE, *fine.shape[2:]).mean(axis=(1, 3))
