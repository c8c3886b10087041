"""How quickly the editor and its player answer, in headless Chromium that draws without a graphics card.

    python benchmarks/pages.py [--clip builtin:carry_box] [--objects DIR]

Says: opening; pictures a second while playing; a preview during a drag; from a typed number to its figures on the
page; the whole clip solved again.
"""

import argparse
import resource
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from browser import chromium, wait_until
from hoi_retarget.clip.edits import ContactEdits
from hoi_retarget.clip.edits.edits_file import EditsFiles
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.robots import load_robot
from hoi_retarget.studio.editor.edit_session import EditSession, solved
from hoi_retarget.studio.editor.editor import Editor, SaveTargets
from hoi_retarget.studio.share.page_server import OnePageServer

CHANGES = 15
SAMPLED_SECONDS = 5.0
COUNT_FRAMES = """async (seconds) => {
    const clock = document.getElementById("clock"), end = performance.now() + 1000 * seconds;
    let last = clock.textContent, changes = 0;
    while (performance.now() < end) {
        await new Promise(requestAnimationFrame);
        if (clock.textContent !== last) { changes += 1; last = clock.textContent; }
    }
    return changes / seconds;
}"""


def main() -> None:
    arguments = _arguments()
    clip = open_clip(arguments.clip, ReadOptions(objects=arguments.objects))
    model = load_robot("unitree_g1")
    start = solved(clip, model, Config(), ContactEdits.of(clip))
    print(f"{arguments.clip}: {clip.frames} frames at {clip.fps:g}/s")
    with chromium() as browser, TemporaryDirectory() as folder:
        targets = SaveTargets(EditsFiles(Path(folder) / "edits.toml"), lambda _: ())
        editor = Editor(EditSession(clip, model, Config(), start), model, targets)
        server = OnePageServer(editor.page, editor.answer)
        try:
            measure(browser, editor, server.address)
        finally:
            server.stop()


def measure(browser, editor: Editor, address: str) -> None:
    begin = time.perf_counter()
    page = browser.new_page(viewport={"width": 1300, "height": 850})
    page.goto(address)
    told = page.locator("#told")
    page.get_by_text("Choose a row").wait_for()
    print(f"open: {time.perf_counter() - begin:.2f} s; {len(editor.page()) / 1e6:.2f} MB; {_memory_mb():.0f} MB")
    page.locator("#play").click()
    time.sleep(1.0)
    print(f"playing: {page.evaluate(COUNT_FRAMES, SAMPLED_SECONDS):.1f} pictures/s")
    page.locator("#contacts button").first.click()
    _say("drag", editor, [_preview(editor, number) for number in range(CHANGES)])
    seconds, busy = [], []
    for number in range(CHANGES):
        field, before = page.get_by_label("Point z"), told.inner_text()
        field.fill(f"{float(field.input_value()) + (0.02 if number % 2 == 0 else -0.02):.4f}")
        begin, cpu = time.perf_counter(), time.process_time()
        wait_until(lambda before=before: told.inner_text() not in (before, "Solving ..."), "the change is told")
        seconds.append(time.perf_counter() - begin)
        busy.append(time.process_time() - cpu)
        page.locator("body:not(.busy)").wait_for()
    print(
        f"one contact moved, {CHANGES} times: median {np.median(seconds):.2f} s from the typed number until the page "
        f"says so (0.6 s of it to type on), server {np.median(busy):.2f} s of CPU"
    )
    page.locator("#editor summary", has_text="All contacts").click()
    begin = time.perf_counter()
    page.get_by_role("button", name="Solve whole clip").click()
    page.get_by_text("The whole clip is solved.").wait_for(timeout=120_000)
    print(f"whole clip: {time.perf_counter() - begin:.2f} s until the page says so")
    page.close()


def _preview(editor: Editor, number: int) -> float:
    """Return the CPU time of a preview during a drag [s]."""
    segment, begin = editor.session.now.segments[0], time.process_time()
    point = segment.points.mean(axis=0) + np.array([0.0, 0.0, 0.002 * number])
    asked = {"action": "preview_move", "revision": 0, "chosen": 0, "point": point.tolist()}
    answer = editor.answer(asked)
    assert "scene" in answer, answer
    return time.process_time() - begin


def _say(what: str, editor: Editor, seconds: list[float]) -> None:
    print(f"{what}: median {1e3 * np.median(seconds):.0f} ms of CPU a preview, {editor.session.recorded.frames} frames")


def _memory_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clip", default="builtin:carry_box")
    parser.add_argument("--objects", type=Path, default=None)
    return parser.parse_args()


if __name__ == "__main__":
    main()
