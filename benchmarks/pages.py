"""How quickly the editor and its player answer, in headless Chromium that draws without a graphics card.

    python benchmarks/pages.py [--clip builtin:carry_box] [--objects DIR] [--minutes 1]

Says: opening to the first drawn frame; frames shown a second while playing; memory of the server while it
plays; from a committed change of a contact to its figures on the page, with the shares of solving and
drawing; the whole clip solved again.
"""

import argparse
import re
import resource
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from browser import chromium, open_page, scene_pixels, wait_until
from hoi_retarget.clip.edits import ContactEdits, Move
from hoi_retarget.clip.edits.edits_file import EditsFiles
from hoi_retarget.clip.read_options import ReadOptions
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.robots import load_robot
from hoi_retarget.studio.browser.browser_server import address, open_server, page_content, serve_sessions
from hoi_retarget.studio.browser.edit_session import EditSession, solved
from hoi_retarget.studio.browser.editor import Editor, SaveTargets
from hoi_retarget.studio.browser.player import Player
from hoi_retarget.studio.scene.scene import SceneItem

CHANGES = 25
SAMPLED_SECONDS = 5.0
# Counts, in the browser, how often the number beside the frame slider changes.
COUNT_FRAMES = """async (seconds) => {
    const box = document.querySelector("input.mantine-NumberInput-input");
    const end = performance.now() + 1000 * seconds;
    let last = box.value, changes = 0, drawn = 0;
    while (performance.now() < end) {
        await new Promise(requestAnimationFrame);
        drawn += 1;
        if (box.value !== last) { changes += 1; last = box.value; }
    }
    return [changes / seconds, drawn / seconds];
}"""


def main() -> None:
    arguments = _arguments()
    clip = open_clip(arguments.clip, ReadOptions(objects=arguments.objects))
    model = load_robot("unitree_g1")
    start = solved(clip, model, Config(), ContactEdits.of(clip))
    print(f"{arguments.clip}: {clip.frames} frames at {clip.fps:g}/s")
    with chromium() as browser:
        player(browser, clip, model, start, arguments.minutes)
        with TemporaryDirectory() as folder:
            editor(browser, clip, model, start, folder)


def player(browser, clip, model, start, minutes: float) -> None:
    server = open_server("hoi-retarget")
    content = page_content([SceneItem(clip.name, start.motions[0], model, clip)])
    sent = []

    def receive(client) -> Player:
        player = Player(client, content)
        player.attach(lambda _: sent.append(time.perf_counter()))
        return player

    serve_sessions(server, receive)
    for attempt in range(3):
        begin = time.perf_counter()
        page = open_page(browser, address(server))
        wait_until(lambda page=page: scene_pixels(page).std() > 10, "the first frame is drawn")
        print(f"open to first frame, attempt {attempt + 1}: {time.perf_counter() - begin:.2f} s")
        if attempt < 2:
            page.close()
    page.get_by_role("button", name="Play").click()
    time.sleep(1.0)
    began, first = time.perf_counter(), _memory_mb()
    while True:
        begin, busy, count = time.perf_counter(), time.process_time(), len(sent)
        shown, drawn = page.evaluate(COUNT_FRAMES, SAMPLED_SECONDS)
        passed = time.perf_counter() - begin
        rate, share = (len(sent) - count) / passed, (time.process_time() - busy) / passed
        steps = np.diff(sent[count:])
        print(
            f"playing: {rate:.1f} of {clip.fps:g} frames/s sent, {1e3 * np.percentile(steps, 95):.0f} ms apart at p95, "
            f"{100 * share:.0f} % of a core; page shows {shown:.1f}/s, redraws {drawn:.1f}/s; {_memory_mb():.0f} MB"
        )
        if time.perf_counter() - began > 60 * minutes:
            break
        time.sleep(max(0.0, min(30.0, 60 * minutes) - SAMPLED_SECONDS))
    print(f"memory of the server: {first:.0f} MB at first, {_memory_mb():.0f} MB after {minutes:g} minutes")
    page.close()
    server.stop()


def editor(browser, clip, model, start, folder: str) -> None:
    server, editors = open_server("contacts"), []

    def receive(client) -> Editor:
        places = SaveTargets(EditsFiles(Path(folder) / "edits.toml"), lambda _: ())
        editors.append(Editor(client, EditSession(clip, model, Config(), start), model, places, lambda _: None))
        return editors[-1]

    serve_sessions(server, receive)
    page = open_page(browser, address(server))
    told = page.locator(".told")
    told.wait_for()
    editors[0].choose(0)
    wait_until(lambda: editors[0].chosen is not None, "a contact is chosen")
    seconds, shares = [], []
    for number in range(CHANGES):
        offset = (0.0, 0.0, 0.02 if number % 2 == 0 else -0.02)
        before, begin = told.inner_text(), time.perf_counter()
        editors[0].change(lambda chosen, offset=offset: Move(chosen.part, chosen.start, offset, person=chosen.person))
        wait_until(lambda before=before: told.inner_text() != before, "the change is told")
        seconds.append(time.perf_counter() - begin)
        shares.append([float(number) for number in re.findall(r"(\d+) ms", told.inner_text())])
        time.sleep(0.3)
    solving, drawing = np.median(shares, axis=0)
    print(
        f"one contact moved, {CHANGES} times: median {1e3 * np.median(seconds):.0f} ms until the page says so "
        f"(largest {1e3 * max(seconds):.0f}); solving {solving:.0f} ms, drawing {drawing:.0f} ms"
    )
    begin = time.perf_counter()
    page.get_by_role("button", name="Solve whole clip").click()
    wait_until(lambda: "whole clip" in told.inner_text(), "the whole clip is solved")
    print(f"whole clip: {1e3 * (time.perf_counter() - begin):.0f} ms until the page says so")
    page.close()
    server.stop()


def _memory_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clip", default="builtin:carry_box")
    parser.add_argument("--objects", type=Path, default=None)
    parser.add_argument("--minutes", type=float, default=0.2)
    return parser.parse_args()


if __name__ == "__main__":
    main()
