"""Takes the pictures of viewer, shared page and editor from built-in clips: `python docs/make_screenshots.py`.

Needs the extra `dev` and Chromium (Debian: `apt-get install chromium`).
"""

import io
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from make_images import results_of

from browser import chromium
from hoi_retarget.cli.open_results import gallery_entry_of
from hoi_retarget.cli.scores import known_figures
from hoi_retarget.clip.edits import ContactEdits
from hoi_retarget.clip.edits.edits_file import EditsFiles
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.robots import load_robot
from hoi_retarget.studio.editor.edit_session import EditSession, solved
from hoi_retarget.studio.editor.editor import Editor, SaveTargets
from hoi_retarget.studio.scene.scene import SceneItem
from hoi_retarget.studio.share.clip_page import make_clip_page
from hoi_retarget.studio.share.page_server import OnePageServer

IMAGES = Path(__file__).parent / "images"
WINDOW = {"width": 1440, "height": 900}
COLOURS = 256  # Of a picture's palette: enough for these pages, in a third of the bytes.


def main() -> None:
    """Write `images/viewer.png`, `images/shared_page.png` and `images/editor_after.png`."""
    clip, model = open_clip("builtin:carry_box"), load_robot("unitree_g1")
    start = solved(clip, model, Config(), ContactEdits.of(clip))
    with chromium() as browser, TemporaryDirectory() as folder:
        _page(browser, "viewer", "carry_box", [SceneItem("G1", start.motions[0], model, clip)])
        table = results_of("carry_table", "unitree_h2,unitree_g1")
        names = [replace(item, title=title) for item, title in zip(table, ("H2", "G1"), strict=True)]
        _page(browser, "shared_page", "carry_table", names)

        places = SaveTargets(EditsFiles(Path(folder) / "carry_box.edits.toml"), lambda _: ())
        editor = Editor(EditSession(clip, model, Config(), start), model, places)
        server = OnePageServer(editor.page, editor.answer)
        page = browser.new_page(viewport=WINDOW)
        page.goto(server.address)
        page.locator("#contacts button", has_text="right hand").click()
        page.get_by_label("Point z").fill("0.12")
        page.locator("#told", has_text="move, right_hand").wait_for(timeout=60_000)
        _picture(page, "editor_after")
        page.close()
        server.stop()


def _page(browser, picture: str, title: str, shown: list[SceneItem]) -> None:
    results = []
    for item in shown:
        assert item.motion is not None and item.model is not None
        results.append((gallery_entry_of(item.motion, item.model, known_figures(item.motion, Path(title))), item))
    text = make_clip_page(title, results).text
    server = OnePageServer(lambda: text)
    page = browser.new_page(viewport=WINDOW)
    page.goto(f"{server.address}#t=4.27")
    _picture(page, picture)
    page.close()
    server.stop()


def _picture(page, name: str) -> None:
    page.wait_for_timeout(4000)
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(IMAGES / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
