"""Takes the picture of a report on variants of the built-in clips: `python docs/make_report_picture.py`.

Needs the extra `dev` and Chromium (Debian: `apt-get install chromium`). Takes a few minutes.
"""

import io
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from browser import chromium
from hoi_retarget.cli import main

PICTURE = Path(__file__).parent / "images" / "report.png"
WINDOW = {"width": 1280, "height": 1300}
COLOURS = 256
SPECIFICATION = """
clips = [
    "builtin:carry_box", "builtin:push_table", "builtin:drag_suitcase", "builtin:move_chair", "builtin:carry_table",
]
robots = ["unitree_g1", "unitree_h2"]
size_multipliers = [0.8, 1.0, 1.3]
speeds = [1.0, 2.0]
"""


def draw() -> None:
    """Write `images/report.png`."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "set.toml").write_text(SPECIFICATION)
        main(["batch", str(folder / "set.toml"), "--out", str(folder / "results")])
        main(["report", str(folder / "results"), "--out", str(folder / "report")])
        with chromium() as browser:
            page = browser.new_page(viewport=WINDOW)
            page.goto((folder / "report" / "report.html").as_uri())
            picture = Image.open(io.BytesIO(page.screenshot()))
    picture.convert("RGB").quantize(COLOURS).save(PICTURE, optimize=True)


if __name__ == "__main__":
    draw()
