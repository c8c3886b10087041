"""Pages in headless Chromium, as a person would use them; tests that need it skip, saying so, where it is missing."""

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import numpy as np
import pytest

PATIENCE_MS = 120_000  # Two browsers that draw without a graphics card can stall each other.
Seen = TypeVar("Seen")


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
