"""Pictures for papers: frames of a motion's contact moments, cut out for pages of any colour, with names and times.

Bodies and their soft shadows are drawn without floor and sky. Where two surfaces come near to each other, as a palm and
a box do, the farther one is darker, which makes touch visible.
"""

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter

from hoi_retarget.motion.motion import Motion
from hoi_retarget.studio.offscreen import stage
from hoi_retarget.studio.offscreen.renderer import filled_renderer
from hoi_retarget.studio.scene.camera import FIELD_OF_VIEW, Camera, CameraSettings, cameras
from hoi_retarget.studio.scene.drawing import DrawnScene

Cutout = Float[np.ndarray, "H W 4"]
"""Red, green, blue and opacity, from 0 to 1; colours are not multiplied by the opacity."""

_FINE = 3  # Pixels that are drawn for each one, in each direction: edges have ten levels of opacity.
_AWAY = -1000.0  # Where the floor and what only casts a shadow are put, beyond what a camera sees [m].
_MAX_DEPTH_M = 50.0  # Beyond all bodies.
_SHADOW, _SOFTNESS = 0.3, 0.012  # Opacity of a shadow on the floor, and how far its edge is spread [m].
_OCCLUSION_RANGE_M = 0.06  # Within it a surface darkens the one behind.
_DARKEST, _DIRECTIONS = 0.55, 12


@contextmanager
def cutout_renderer(scene: DrawnScene, width: int, height: int) -> Iterator[Callable[[int, Camera], Cutout]]:
    """Open a function that draws a frame of shown layers without floor and sky, in pixels; raises `DrawingError`."""
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
            shade = _mean((_depths(renderer) < _MAX_DEPTH_M).astype(float))
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
    there = depths < _MAX_DEPTH_M
    body = _mean(there.astype(float))
    middle = depths[_FINE // 2 :: _FINE, _FINE // 2 :: _FINE]
    light = 1.0 - _DARKEST * _occlusion(middle, pixel)
    own = _mean(colours * there[..., None]) * light[..., None]
    opacity = body + (1.0 - body) * _SHADOW * shade
    return np.dstack([own / np.maximum(opacity, 1e-6)[..., None], opacity])


def _occlusion(depths: Float[np.ndarray, "H W"], pixel: float) -> Float[np.ndarray, "H W"]:
    """Return the share of near surroundings in front of each pixel, from 0 to 1."""
    hidden = np.zeros(depths.shape)
    turns = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    for reach in (0.25, 0.5, 1.0):
        steps = np.round(reach * _OCCLUSION_RANGE_M / pixel * np.column_stack([np.sin(turns), np.cos(turns)])).astype(
            int
        )
        for down, right in steps:
            before = depths - np.roll(depths, (down, right), axis=(0, 1))
            hidden += np.clip(before / (0.5 * _OCCLUSION_RANGE_M), 0.0, 1.0) * np.clip(
                2.0 - before / _OCCLUSION_RANGE_M, 0.0, 1.0
            )
    return gaussian_filter(np.clip(2.0 * hidden / (3 * _DIRECTIONS) - 0.1, 0.0, 1.0), 0.8)


def _mean(fine: np.ndarray) -> np.ndarray:
    """Return the means of the fine pixels of each one."""
    height, width = len(fine) // _FINE, fine.shape[1] // _FINE
    return fine.reshape(height, _FINE, width, _FINE, *fine.shape[2:]).mean(axis=(1, 3))


_LIFTED = 0.02  # Above where it was touched first [m].


@dataclass(frozen=True)
class Moment:
    """A frame with its event."""

    frame: int
    title: str


def contact_moments(motion: Motion) -> tuple[Moment, ...]:
    """Return first touch, lift, peak, set-down and release of the object that is touched longest.

    What is never lifted has its farthest frame from where it was; where nothing is touched, there are no moments.
    """
    touched = motion.contact_flags & (motion.contact_object >= 0)
    if not touched.any():
        return ()
    chosen = int(np.bincount(motion.contact_object[touched]).argmax())
    frames = np.flatnonzero((touched & (motion.contact_object == chosen)).any(axis=1))
    first, last = int(frames[0]), int(frames[-1])
    path = motion.object_pos[first : last + 1, chosen]
    lifted = np.flatnonzero(path[:, 2] - path[0, 2] > _LIFTED)
    moments = [Moment(first, "first touch")]
    if len(lifted):
        moments += [
            Moment(first + int(lifted[0]), "lift"),
            Moment(first + int(path[:, 2].argmax()), "peak"),
            Moment(first + int(lifted[-1]), "set down"),
        ]
    else:
        moments.append(Moment(first + int(np.linalg.norm(path - path[0], axis=1).argmax()), "farthest"))
    moments.append(Moment(last, "release"))
    by_frame = {moment.frame: moment for moment in reversed(moments)}  # Of two in one frame, the first.
    return tuple(by_frame[frame] for frame in sorted(by_frame))


DPI = 300
_INK = (40, 42, 48, 255)
_FREE = 12  # Between what is drawn in neighbouring cells [px].
_TEXT = 34  # Height of letters: 8 points at 300 dpi [px].
_SEEN = 0.02  # Opacity that counts as something.
_FAINTEST = 0.35  # Of the first frame of those laid over each other.


def paper_picture(  # noqa: PLR0913 - options with defaults, and what is drawn
    filmed: Sequence[DrawnScene],
    view: CameraSettings,
    cell: tuple[int, int],
    *,
    times: Sequence[float],
    titles: Sequence[str],
    rows: Sequence[str],
    overlaid: bool = False,
    transparent: bool = False,
    drawn: Callable[[], None] = lambda: None,
) -> bytes:
    """Return a PNG file: a row for each scene, a column for each time; raises `DrawingError`.

    Args: `filmed`: what the rows show; `view`: how to look at it; `cell`: width and height in which a frame is drawn,
    before it is cut to what is seen [px]; `times`: of the columns [s]; `titles`: what stands below each column; `rows`:
    what stands before each row; nothing where all are empty; `overlaid`: lay all frames of a row over each other
    instead, the earlier ones fainter; `transparent`: leave the background out instead of painting it white; `drawn`:
    called after each frame.
    """
    placed = cameras(filmed, view, cell[0] / cell[1])
    lines: list[list[Cutout]] = []
    with ExitStack() as stack:
        for scene, camera in zip(filmed, placed, strict=True):
            draw = stack.enter_context(cutout_renderer(scene, *cell))
            line = []
            for time in times:
                frame = min(round(time * scene.fps), scene.frames - 1)
                line.append(draw(frame, camera(frame)))
                drawn()
            lines.append([_overlaid(line)] if overlaid else line)
    image = _sheet(lines, [] if overlaid else titles, rows)
    if not transparent:
        white = Image.new("RGBA", image.size, (255, 255, 255, 255))
        image = Image.alpha_composite(white, image).convert("RGB")
    content = io.BytesIO()
    image.save(content, "PNG", dpi=(DPI, DPI), optimize=True)
    return content.getvalue()


def _overlaid(line: Sequence[Cutout]) -> Cutout:
    """Return frames over each other in the order of time."""
    colours, opacity = np.zeros((*line[0].shape[:2], 3)), np.zeros(line[0].shape[:2])
    for share, picture in zip(np.linspace(_FAINTEST, 1.0, len(line)), line, strict=True):
        own = picture[..., 3] * share
        colours = picture[..., :3] * own[..., None] + colours * (1.0 - own[..., None])
        opacity = own + opacity * (1.0 - own)
    return np.dstack([colours / np.maximum(opacity, 1e-6)[..., None], opacity])


def _sheet(lines: Sequence[Sequence[Cutout]], titles: Sequence[str], rows: Sequence[str]) -> Image.Image:
    font = ImageFont.load_default(_TEXT)
    seen = np.array([[picture[..., 3] > _SEEN for picture in line] for line in lines])
    across = [_range(np.any(seen[:, column], axis=(0, 1))) for column in range(seen.shape[1])]
    down = [_range(np.any(seen[row], axis=(0, 2))) for row in range(seen.shape[0])]
    left = max(int(font.getlength(name)) for name in rows) + 2 * _FREE if any(rows) else 0
    widths = [stop - start for start, stop in across]
    titled = [
        max(width, int(font.getlength(title)))
        for width, title in zip(widths, titles or [""] * len(widths), strict=True)
    ]
    heights = [stop - start for start, stop in down]
    below = int(1.8 * _TEXT) if titles else 0
    size = (left + sum(titled) + _FREE * (len(titled) + 1), sum(heights) + _FREE * (len(heights) + 1) + below)
    sheet = Image.new("RGBA", size, (0, 0, 0, 0))
    pen, y = ImageDraw.Draw(sheet), _FREE
    for line, name, (top, bottom), height in zip(lines, rows, down, heights, strict=True):
        x = left + _FREE
        for picture, (start, stop), width in zip(line, across, titled, strict=True):
            pixels = np.round(255 * np.clip(picture[top:bottom, start:stop], 0.0, 1.0)).astype(np.uint8)
            sheet.paste(Image.fromarray(pixels, "RGBA"), (x + (width - (stop - start)) // 2, y))
            x += width + _FREE
        pen.text((_FREE, y + height // 2), name, _INK, font, anchor="lm")
        y += height + _FREE
    x = left + _FREE
    for title, width in zip(titles, titled if titles else [], strict=True):
        pen.text((x + width // 2, y), title, _INK, font, anchor="ma")
        x += width + _FREE
    return sheet


def _range(seen: ArrayLike) -> tuple[int, int]:
    places = np.flatnonzero(seen)
    return (int(places[0]), int(places[-1]) + 1) if len(places) else (0, 1)
