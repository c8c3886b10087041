"""Draws a picture of the documentation from a built-in clip: `python docs/make_images.py`.

Robots are drawn as their makers' meshes have them, once `hoi-retarget robots meshes unitree_g1` and `unitree_h2` have
fetched those. Needs EGL (Debian: `apt-get install libegl1 libgl1-mesa-dri`) or a display; on a machine without a
display run it with `MUJOCO_GL=egl`.
"""

from pathlib import Path

import numpy as np

from hoi_retarget.readers.builtin_clips import builtin_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget_people
from hoi_retarget.robots import load_robot, team
from hoi_retarget.studio.offscreen import film
from hoi_retarget.studio.offscreen.robot_portraits import png
from hoi_retarget.studio.scene.camera import CameraSettings
from hoi_retarget.studio.scene.scene import SceneItem

IMAGES = Path(__file__).parent / "images"
PANEL, MOMENTS = (400, 680), 4  # [px]


def main() -> None:
    """Write `images/contact_sheet.png`: two people, and two robots."""
    IMAGES.mkdir(exist_ok=True)
    shown = results_of("carry_table", "unitree_h2,unitree_g1")
    filmed = film.panels(shown)
    with film.panel_renderer(filmed, CameraSettings(film.good_azimuth(shown)), *PANEL) as draw:
        pictures = [draw(time) for time in film.sheet_times(filmed, MOMENTS)]
    (IMAGES / "contact_sheet.png").write_bytes(png(np.concatenate(pictures, axis=1)))


def results_of(scene: str, robots: str) -> list[SceneItem]:
    """Retarget a built-in clip, one robot for each of its people."""
    clip, models = builtin_clip(scene), [load_robot(spec.name) for spec in team(robots)]
    motions = retarget_people(clip, models, Config())
    pairs = zip(motions, models, strict=True)
    return [SceneItem(scene, motion, model, clip, person) for person, (motion, model) in enumerate(pairs)]


if __name__ == "__main__":
    main()
