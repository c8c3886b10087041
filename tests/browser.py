"""Pages in headless Chromium, as a person would use them; tests that need it skip, saying so, where it is missing."""

import io
import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import numpy as np
import pytest

PATIENCE_MS = 120_000  # Two browsers that draw without a graphics card can stall each other.
WINDOW = {"width": 1100, "height": 700}
Seen = TypeVar("Seen")
DRAWN = (220, 140)
"""Width and height of pictures of a scene as it was drawn."""
CONTROLS_PX, CURVES_PX = 330, 320  # What panels cover of the window, at the right and at the bottom.


def chromium_path() -> str:
    """Return where Chromium is, or skip the test."""
    pytest.importorskip("playwright", reason="playwright is not installed, so nothing is tested in a browser")
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if path := shutil.which(name):
            return path
    pytest.skip("Chromium is not installed, so nothing is tested in a browser (Debian: apt-get install chromium)")


@contextmanager
def chromium() -> Iterator:
    """Give a browser that draws WebGL without a graphics card and looks nothing up."""
    path = chromium_path()
    from playwright.sync_api import sync_playwright

    arguments = [
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--ignore-gpu-blocklist",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-quic",
        "--no-first-run",
    ]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        arguments.append("--no-sandbox")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=arguments)
        try:
            yield browser
        finally:
            browser.close()


_KEEP_DRAWN = """
window.drawn = [];
const animate = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = (callback) => animate((time) => {
  callback(time);
  if (!window.keepDrawn) return;
  const [scene] = [...document.querySelectorAll("canvas")].sort((a, b) => b.width - a.width);
  const copy = new OffscreenCanvas(WIDTH, HEIGHT).getContext("2d");
  copy.drawImage(scene, 0, 0, WIDTH, HEIGHT);
  const picture = Array.from(copy.getImageData(0, 0, WIDTH, HEIGHT).data.filter((_, index) => index % 4 < 3));
  const text = JSON.stringify(picture);
  if (text !== window.lastDrawn) window.drawn.push(picture);
  window.lastDrawn = text;
});
""".replace("WIDTH", str(DRAWN[0])).replace("HEIGHT", str(DRAWN[1]))


@contextmanager
def every_drawing(page) -> Iterator[list[np.ndarray]]:
    """Give all different pictures that the page's scene draws from now to the end of this block, in small.

    The page is one that was opened here; the block ends once something else has been drawn.
    """
    pictures: list[np.ndarray] = []

    def drawn() -> int:
        return page.evaluate("window.drawn.length")

    page.evaluate("window.drawn = []; window.lastDrawn = ''; window.keepDrawn = true")
    wait_until(lambda: drawn() > 0, "the scene is drawn")
    yield pictures
    wait_until(lambda: drawn() > 1, "the scene is drawn anew")
    still(drawn, seconds=3.0)
    kept = page.evaluate("window.keepDrawn = false, window.drawn")
    pictures.extend(np.array(picture).reshape(DRAWN[1], DRAWN[0], 3) for picture in kept)


def open_page(browser, address: str, **more):
    """Open a page of a Viser server in a tab of its own, and wait for its controls; `more` is of the tab."""
    page = browser.new_page(**{"viewport": WINDOW, **more})
    page.add_init_script(_KEEP_DRAWN)
    page.set_default_timeout(PATIENCE_MS)
    # Viser draws in fewer pixels where drawing is slow, and each pixel of the floor changes.
    page.goto(f"{address}?fixedDpr=1")
    page.get_by_text("Playback", exact=True).wait_for()
    # A warning that there is no graphics card would lie over the scene.
    page.add_style_tag(content=".mantine-Notification-root { display: none; }")
    return page


def scene_pixels(page) -> np.ndarray:
    """Return what the page shows of the scene, without the panels."""
    from PIL import Image

    width, height = WINDOW["width"] - CONTROLS_PX, WINDOW["height"] - CURVES_PX
    picture = page.screenshot(clip={"x": 0, "y": 0, "width": width, "height": height})
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=int)


def wait_until(holds: Callable[[], bool], what: str, seconds: float = PATIENCE_MS / 1000) -> None:
    """Wait for something to happen; fail, saying what, when it does not."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.05)


def still(look: Callable[[], Seen], seconds: float = 1.0) -> Seen:
    """Return what is seen once it has been the same for so long [s]."""
    seen, since = look(), time.monotonic()

    def same() -> bool:
        nonlocal seen, since
        if not np.array_equal(now := look(), seen):
            seen, since = now, time.monotonic()
        return time.monotonic() - since >= seconds

    wait_until(same, f"nothing changes for {seconds} s")
    return seen


def box_of(locator) -> dict[str, float]:
    """Return where an element lies [pixels]; one that is being drawn anew lies nowhere, and is waited for."""
    boxes: list[dict[str, float]] = []

    def lies() -> bool:
        boxes.extend(filter(None, [locator.bounding_box()]))
        return bool(boxes)

    wait_until(lies, "the element is drawn")
    return boxes[0]


def frame_box(page):
    """Return the number beside the frame slider."""
    return page.locator("input.mantine-NumberInput-input").first


def shown_frame(page) -> int:
    """Return the frame that the frame slider shows."""
    return int(frame_box(page).input_value())
