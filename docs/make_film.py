"""Draws README's film, four built-in clips beside the robots that do the same: `python docs/make_film.py`.

Robots are drawn as their makers' meshes have them, once `hoi-retarget robots meshes unitree_g1` and `unitree_h2` have
fetched those. Needs EGL (Debian: `apt-get install libegl1 libgl1-mesa-dri`) or a display; on a machine without a
display run it with `MUJOCO_GL=egl`.
"""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np
from make_images import IMAGES, results_of
from PIL import Image, ImageDraw, ImageFont

from hoi_retarget.studio.offscreen import film
from hoi_retarget.studio.offscreen.renderer import Picture, offscreen_renderer
from hoi_retarget.studio.scene.camera import Camera, CameraSettings, cameras
from hoi_retarget.studio.scene.drawing import DrawnScene

RATE, SECONDS, QUALITY = 10.0, 5.6, 50
PANEL, INSET, GAP = (238, 300), 104, 4  # [px]
INK, PAPER, FRAME = (40, 44, 52), (255, 255, 255), (120, 126, 136)


@dataclass(frozen=True)
class Tile:
    """A clip, and the robots that do the same."""

    scene: str
    robots: str
    caption: str
    start: float
    """Just before hands reach for the object [s]."""
    nearer: float
    """Distance of the camera, relative to one that sees what is far from people, too."""
    hand: str | None = None
    """The hand that an inset shows."""


TILES = (
    Tile("carry_box", "unitree_g1", "Unitree G1", 2.1, 0.9, "right hand"),
    Tile("move_chair", "unitree_g1", "Unitree G1", 0.9, 0.97),
    Tile("carry_table", "unitree_h2,unitree_g1", "Unitree H2 and G1", 0.9, 0.98),
    Tile("drag_suitcase", "unitree_g1", "Unitree G1", 0.6, 1.0),
)


def main() -> None:
    """Write `images/film.webp`."""
    with ExitStack() as stack:
        draws = [panels(tile, stack) for tile in TILES]
        pictures = [grid([draw(time) for draw in draws]) for time in np.arange(round(RATE * SECONDS)) / RATE]
    (IMAGES / "film.webp").write_bytes(film.webp(pictures, RATE, quality=QUALITY))


def panels(tile: Tile, stack: ExitStack) -> Callable[[float], Picture]:
    """Return a function that draws a tile at a time of the film [s]."""
    shown = results_of(tile.scene, tile.robots)
    filmed = film.panels(shown)
    good = film.good_azimuth(shown)
    views = cameras(filmed, CameraSettings(good), PANEL[0] / PANEL[1])
    draws = [stack.enter_context(offscreen_renderer(scene, *PANEL)) for scene in filmed]
    inset = close_up(filmed[1], good, tile.hand, stack) if tile.hand else None

    def draw(time: float) -> Picture:
        frames = [min(round((tile.start + time) * scene.fps), scene.frames - 1) for scene in filmed]
        pictures = [
            titled(draw_panel(frame, nearer(view(frame), tile.nearer)), caption)
            for draw_panel, view, frame, caption in zip(draws, views, frames, ("recorded", tile.caption), strict=True)
        ]
        if inset is not None:
            pictures[1][GAP : GAP + INSET, -GAP - INSET : -GAP] = inset(frames[1])
        return np.concatenate(pictures, axis=1)

    return draw


def nearer(camera: Camera, share: float) -> Camera:
    """Return a camera at a share of its distance to what it sees."""
    return replace(camera, distance=share * camera.distance)


def titled(picture: Picture, caption: str) -> Picture:
    """Return a panel with its caption."""
    image = Image.fromarray(picture)
    ImageDraw.Draw(image).text((8, PANEL[1] - 8), caption, INK, ImageFont.load_default(15), anchor="ls")
    return np.array(image)


def close_up(scene: DrawnScene, azimuth: float, hand: str, stack: ExitStack) -> Callable[[int], Picture]:
    """Return a function that draws a hand from near in a frame, with a frame of two pixels around it."""
    camera = cameras([scene], CameraSettings(azimuth, look=hand), 1.0)[0]
    draw_scene = stack.enter_context(offscreen_renderer(scene, INSET, INSET))

    def draw(frame: int) -> Picture:
        picture = draw_scene(frame, camera(frame)).copy()
        for edge in (np.s_[:2], np.s_[-2:], np.s_[:, :2], np.s_[:, -2:]):
            picture[edge] = FRAME
        return picture

    return draw


def grid(tiles: list[Picture]) -> Picture:
    """Return four tiles, two in a row, with gaps between."""
    height, width = tiles[0].shape[:2]
    whole = np.full((2 * height + GAP, 2 * width + GAP, 3), PAPER, dtype=np.uint8)
    for index, tile in enumerate(tiles):
        top, left = (index // 2) * (height + GAP), (index % 2) * (width + GAP)
        whole[top : top + height, left : left + width] = tile
    return whole


if __name__ == "__main__":
    main()
