"""Pictures for papers: cut-out frames, as near as they fit, with names of rows, moments and times."""

import io
from collections.abc import Callable, Sequence
from contextlib import ExitStack

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image, ImageDraw, ImageFont

from hoi_retarget.viewers.offscreen.cutout import Cutout, cutout_renderer
from hoi_retarget.viewers.scene.camera import CameraSettings, cameras
from hoi_retarget.viewers.scene.drawing import Scene

DPI = 300
_INK = (40, 42, 48, 255)
_FREE = 12  # Between what is drawn in neighbouring cells [px].
_TEXT = 34  # Height of letters: 8 points at 300 dpi [px].
_SEEN = 0.02  # Opacity that counts as something.
_FAINTEST = 0.35  # Of the first frame of those laid over each other.


def paper_picture(  # noqa: PLR0913 - options with defaults, and what is drawn
    filmed: Sequence[Scene],
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
    """Return a PNG file: a row for each scene, a column for each time.

    Args:
        filmed: What the rows show.
        view: How to look at it.
        cell: Width and height in which a frame is drawn, before it is cut to what is seen [px].
        times: Of the columns [s].
        titles: What stands below each column.
        rows: What stands before each row; nothing where all are empty.
        overlaid: Lay all frames of a row over each other instead, the earlier ones fainter.
        transparent: Leave the background out instead of painting it white.
        drawn: Called after each frame.

    Raises:
        DrawingError: This machine has no way to draw without a screen.
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
