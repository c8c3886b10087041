"""Draws the pictures of the documentation from built-in clips: `python docs/make_images.py`.

Needs EGL (Debian: `apt-get install libegl1 libgl1-mesa-dri`) or a display; on a machine without a
display run it with `MUJOCO_GL=egl`.
"""

from pathlib import Path

import numpy as np

from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.multi_person import retarget_people
from hoi_retarget.robots import load_robot, team
from hoi_retarget.synthetic import make
from hoi_retarget.viewers.offscreen import film
from hoi_retarget.viewers.offscreen.robot_picture import png
from hoi_retarget.viewers.scene.camera import CameraSettings
from hoi_retarget.viewers.scene.scene import Shown

IMAGES = Path(__file__).parent / "images"


def main() -> None:
    """Write `images/overview.png`, a person and one robot, and `images/contact_sheet.png`, two and two robots."""
    IMAGES.mkdir(exist_ok=True)
    for name, scene, robots, columns, width in (
        ("overview", "carry_box", "unitree_g1", 6, 290),
        ("contact_sheet", "carry_table", "unitree_h2,unitree_g1", 4, 400),
    ):
        shown = results_of(scene, robots)
        filmed = film.panels(shown)
        with film.opened(filmed, CameraSettings(film.good_azimuth(shown)), width, 680) as draw:
            pictures = [draw(time) for time in film.sheet_times(filmed, columns)]
        (IMAGES / f"{name}.png").write_bytes(png(np.concatenate(pictures, axis=1)))


def results_of(scene: str, robots: str) -> list[Shown]:
    """Retarget a built-in clip, one robot for each of its people."""
    clip, models = make(scene), [load_robot(spec.name) for spec in team(robots)]
    motions = retarget_people(clip, models, Config(), {})
    pairs = zip(motions, models, strict=True)
    return [Shown(scene, motion, model, clip, person) for person, (motion, model) in enumerate(pairs)]


if __name__ == "__main__":
    main()
