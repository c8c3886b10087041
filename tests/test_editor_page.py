"""The contact editor in a browser: what is dragged, typed and pressed becomes edits, on a desk and on a phone."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest

from browser import PATIENCE_MS, box_of, chromium, still, wait_until
from hoi_retarget.cli import main
from hoi_retarget.clip.edits import ContactEdits, FixAll, Pin, Retime, load
from hoi_retarget.clip.edits.edits_file import EditsFiles
from hoi_retarget.motion.result_file import load as load_motion
from hoi_retarget.motion.result_file import save
from hoi_retarget.numerics import se3
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config
from hoi_retarget.studio.editor.edit_session import EditSession, solved
from hoi_retarget.studio.editor.editor import Editor, SaveTargets
from hoi_retarget.studio.share.page_server import OnePageServer
from trajectories import MODELS

pytestmark = [pytest.mark.browser, pytest.mark.slow]

MODEL = MODELS["unitree_g1"]
DESK = {"viewport": {"width": 1300, "height": 850}}
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}


@pytest.fixture(scope="module")
def start():
    clip = open_clip("builtin:carry_box")
    return clip, solved(clip, MODEL, Config(), ContactEdits.of(clip))


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started


class Work:
    """A served editor that the test can look into."""

    def __init__(self, start, folder):
        clip, edited = start
        self.folder = folder
        targets = SaveTargets(EditsFiles(folder / "edits.toml"), self._save_result)
        self.editor = Editor(EditSession(clip, MODEL, Config(), edited), MODEL, targets)
        self.server = OnePageServer(self.editor.page, self.editor.answer)

    @property
    def now(self):
        return self.editor.session.now

    @property
    def edits(self):
        return self.now.edits.edits

    def _save_result(self, edited):
        path = self.folder / "editor.npz"
        save(edited.motions[0], path)
        return (path,)


@pytest.fixture
def work(start, tmp_path):
    work = Work(start, tmp_path)
    yield work
    work.server.stop()


def opened(browser, address: str, **more):
    page = browser.new_page(**{**DESK, **more})
    page.set_default_timeout(PATIENCE_MS)
    page.goto(address)
    page.get_by_text("contacts. Choose a row").or_(page.get_by_text("of last time not saved")).wait_for()
    return page


def told(page) -> str:
    return page.locator("#told").inner_text()


def choose(page, words: str) -> None:
    page.locator("#contacts button", has_text=words).first.click()
    page.locator("#contacts button[aria-pressed=true]", has_text=words).wait_for()
    still(lambda: grip(page, "middle"))


def grip(page, name: str) -> tuple[float, float]:
    """Return where a grip of the handle is taken: an arrow by its tip."""
    place = """(grip) => {
        const box = grip.ownerSVGElement.getBoundingClientRect();
        const get = (name) => Number(grip.getAttribute(name));
        if (grip.tagName === "line") return [box.left + get("x2"), box.top + get("y2")];
        return [box.left + get("cx"), box.top + get("cy")];
    }"""
    return tuple(page.locator(f'[data-grip="{name}"]').evaluate(place))


def drag(page, name: str, way: tuple[float, float], steps: int = 4) -> None:
    x, y = grip(page, name)
    page.mouse.move(x, y)
    page.mouse.down()
    for step in range(1, steps + 1):
        page.mouse.move(x + way[0] * step / steps, y + way[1] * step / steps)
        page.wait_for_timeout(100)
    page.mouse.up()


def palm_in_object(motion, frame: int) -> np.ndarray:
    palm = MODEL.forward(motion.qpos[frame : frame + 1]).site_position("left_palm")[0]
    return se3.rotate_inverse(motion.object_quat[frame, 0], palm - motion.object_pos[frame, 0])


def shown_frame(page) -> int:
    found = re.search(r"frame (\d+)", page.locator("#clock").inner_text())
    assert found is not None
    return int(found[1])


def test_a_dragged_point_takes_the_hand_along_and_the_command_line_makes_the_same_of_it(browser, work):
    page = opened(browser, work.server.address)
    choose(page, "left hand")
    before, frame = work.now, shown_frame(page)
    drag(page, "arrow-z", (0, -50))
    wait_until(lambda: len(work.edits) == 1, "the drag became an edit")
    wait_until(lambda: re.search(r"jerk [\d.]+ -> [\d.]+ m/s³", told(page)), "what changed is said")
    (edit,) = work.edits
    assert edit.offset[2] > 0.05 and np.abs(edit.offset[:2]).max() < 1e-3, "along the arrow alone"
    scale = before.motions[0].object_scale[0]
    moved = palm_in_object(work.now.motions[0], frame) - palm_in_object(before.motions[0], frame)
    assert moved[2] == pytest.approx(scale * edit.offset[2], abs=0.015)

    saved = work.now
    page.keyboard.press("Control+s")
    wait_until(lambda: "Saved 1 edit" in told(page), "the edits are saved")
    page.get_by_role("button", name="Save result").click()
    wait_until(lambda: "editor.npz" in told(page), "the result is saved")
    assert work.editor.saved is saved
    edits = work.folder / "edits.toml"
    assert main(["run", "builtin:carry_box", "--edits", str(edits), "--out", str(work.folder / "out")]) == 0
    ours, theirs = load_motion(work.folder / "editor.npz"), load_motion(work.folder / "out" / "carry_box.npz")
    for name in ("qpos", "object_pos", "contact_flags", "contact_points", "stance_flags"):
        assert getattr(ours, name).tobytes() == getattr(theirs, name).tobytes(), name
    page.close()


def test_the_camera_stands_still_under_a_drag_and_the_hand_follows_before_it_ends(browser, work):
    page = opened(browser, work.server.address)
    choose(page, "right hand")
    x, y = grip(page, "middle")
    seen = work.now
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 20, y - 40, steps=3)
    wait_until(lambda: "mm off the surface" in told(page), "the preview is told")
    at = still(lambda: grip(page, "middle"))
    assert at == pytest.approx((x + 20, y - 40), abs=2.0), "the handle is under the pointer"
    assert work.now is seen, "nothing is done yet"
    page.mouse.up()
    wait_until(lambda: len(work.edits) == 1, "one drag is one edit")
    page.close()


def test_buttons_and_numbers_edit_undo_and_redo(browser, work):
    page = opened(browser, work.server.address)
    assert page.get_by_role("button", name="Delete").is_disabled(), "while no contact is chosen"
    choose(page, "right hand")
    page.get_by_role("button", name="Split here").click()
    wait_until(lambda: len(work.now.segments) == 3, "there are two contacts of the right hand")
    page.get_by_role("button", name="One point", exact=True).click()
    wait_until(lambda: len(work.edits) == 2, "it is fixed")
    page.keyboard.press("Control+z")
    wait_until(lambda: len(work.edits) == 1, "it is not any more")
    page.keyboard.press("Control+y")
    wait_until(lambda: len(work.edits) == 2, "it is again")
    page.get_by_role("button", name="Next hold").click()
    wait_until(lambda: re.search(r"hold \d+ of \d+, score", told(page)), "its rank and score are told")
    point = page.get_by_label("Point z")
    point.fill(str(round(float(point.input_value()) + 0.02, 4)))
    wait_until(lambda: len(work.edits) == 4, "a typed number moves it")
    assert work.edits[3].offset == pytest.approx((0.0, 0.0, 0.02), abs=1e-4)
    page.locator("#edits").select_option("1")
    wait_until(lambda: len(work.edits) == 1, "all but the first edit are taken back at once")
    point.blur()
    page.keyboard.press("Home")
    page.get_by_role("button", name="End here").click()
    page.get_by_text("no frame is left").wait_for()
    assert "wrong" in (page.locator("#told").get_attribute("class") or "")
    page.close()


def test_a_part_is_pinned_and_turned_by_its_handle(browser, work):
    page = opened(browser, work.server.address)
    page.locator("#editor summary", has_text="Pins").click()
    page.locator("#pin").select_option(label="left hand")
    page.locator('[data-grip="arrow-z"]').wait_for(state="attached")
    still(lambda: grip(page, "arrow-z"))
    drag(page, "arrow-z", (0, 20))
    wait_until(lambda: len(work.edits) == 1, "the drag became a pin")
    (pin,) = work.edits
    assert isinstance(pin, Pin) and (pin.part, pin.frame, pin.turn) == ("left_hand", 0, None)
    wait_until(lambda: "off its pin" in told(page), "it is said how well it is met")
    page.locator("#turn-too").check()

    def hand() -> np.ndarray:
        return MODEL.forward(work.now.motions[0].qpos[:1]).site_rotation("left_palm")

    before = hand()
    ring = page.locator('[data-grip="ring-z"]')
    corners = ring.evaluate("""(ring) => {
        const box = ring.ownerSVGElement.getBoundingClientRect();
        return ring.getAttribute("points").split(" ").map((pair) => {
            const [x, y] = pair.split(",").map(Number);
            return [x + box.left, y + box.top];
        });
    }""")
    (x, y), (to_x, to_y) = corners[32], corners[34]
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(to_x, to_y, steps=3)
    page.mouse.up()
    wait_until(lambda: work.edits[0].turn is not None, "the ring turned the pin")
    assert len(work.edits) == 1
    assert np.degrees(se3.matrix_angle_between(hand(), before)[0]) == pytest.approx(15, abs=2)
    page.get_by_role("button", name="Unpin here").click()
    wait_until(lambda: not work.now.clip.pins, "it is let go")
    page.close()


def test_an_end_of_a_bar_is_dragged_by_mouse_and_by_finger_and_is_one_edit(browser, work):
    page = opened(browser, work.server.address, has_touch=True)
    bars = page.locator("#charts i[data-contact]")
    start, stop = work.now.segments[0].start, work.now.segments[0].stop
    bar = box_of(bars.first)
    frame_px = bar["width"] / (stop - 1 - start)
    y = bar["y"] + 0.5 * bar["height"]
    page.mouse.move(bar["x"] + 1, y)
    page.mouse.down()
    page.mouse.move(bar["x"] + 10 * frame_px, y, steps=4)
    wait_until(lambda: box_of(bars.first)["x"] > bar["x"] + 4, "the bar follows")
    assert not work.edits
    page.mouse.up()
    wait_until(lambda: len(work.edits) == 1, "the drag became an edit")
    assert work.edits[0] == Retime("left_hand", start, work.now.segments[0].start, stop)
    assert abs(work.now.segments[0].start - start - 10) <= 1
    wait_until(lambda: page.locator("body.busy").count() == 0, "it is shown")

    touch, last = page.context.new_cdp_session(page), work.now.segments[1].stop
    box = box_of(bars.nth(1))
    x, y = box["x"] + box["width"] - 1, box["y"] + 0.5 * box["height"]
    for kind, away in (("touchStart", 0), ("touchMove", 10), ("touchMove", 20), ("touchEnd", None)):
        points = [] if away is None else [{"x": x - away * frame_px, "y": y}]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    wait_until(lambda: abs(last - 20 - work.now.segments[1].stop) <= 1, "a finger drags too")
    assert len(work.edits) == 2
    page.get_by_role("button", name="Undo").click()
    wait_until(lambda: work.now.segments[1].stop == last, "it is taken back as any edit")
    page.close()


def test_an_end_stops_at_the_next_contact_and_at_its_own_other_end(browser, work):
    page = opened(browser, work.server.address)
    choose(page, "left hand")
    page.get_by_role("button", name="Split here").click()
    wait_until(lambda: len(work.now.segments) == 3 and not page.locator("body.busy").count(), "there are two")
    first, second = work.now.segments[:2]
    bar = box_of(page.locator("#charts i[data-contact]").first)
    y, frame_px = bar["y"] + 0.5 * bar["height"], bar["width"] / (first.stop - 1 - first.start)

    def drag_end(begin: float, to: float) -> str:
        page.mouse.move(begin, y)
        page.mouse.down()
        page.mouse.move(to, y, steps=4)
        said = still(lambda: told(page))
        page.mouse.up()
        return said

    end = bar["x"] + bar["width"]
    assert f"{first.start} to {second.start - 1}" in drag_end(end - 2, end + 30 * frame_px)
    assert len(work.edits) == 1, "it already ended there"
    said = drag_end(bar["x"] + 1, end + 30 * frame_px)
    assert f"{first.stop - 1} to {first.stop - 1}" in said, "one frame is left"
    wait_until(lambda: work.now.segments[0].start == first.stop - 1, "and becomes the contact")
    page.close()


def test_on_a_phone_a_contact_is_chosen_and_dragged_with_the_scene_in_view(browser, work):
    page = opened(browser, work.server.address, **PHONE)
    row = page.locator("#contacts button", has_text="left hand").first
    row.scroll_into_view_if_needed()
    row.tap()
    page.locator("#contacts button[aria-pressed=true]").wait_for()
    stage = box_of(page.locator(".stage"))
    assert stage["y"] >= 0 and stage["height"] >= 0.35 * 844, "the scene stays"
    page.locator("#values").scroll_into_view_if_needed()
    page.mouse.wheel(0, 600)
    wait_until(lambda: page.evaluate("window.scrollY") > 300, "the panel is scrolled")
    assert box_of(page.locator(".stage"))["y"] == pytest.approx(0, abs=1), "under the scene"
    stage = box_of(page.locator(".stage"))
    assert page.evaluate("document.documentElement.scrollWidth") <= 391, "and nothing is beside the window"
    x, y = still(lambda: grip(page, "middle"))
    assert stage["y"] < y < stage["y"] + stage["height"]
    touch = page.context.new_cdp_session(page)
    for kind, up in (("touchStart", 0), ("touchMove", 20), ("touchMove", 40), ("touchEnd", None)):
        points = [] if up is None else [{"x": x, "y": y - up}]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        page.wait_for_timeout(100)
    wait_until(lambda: len(work.edits) == 1, "the drag became an edit")
    page.close()


def test_before_and_after_are_shown_together_when_asked_for(browser, work):
    page = opened(browser, work.server.address)
    page.locator("#editor summary", has_text="All contacts").click()
    page.get_by_role("button", name="One point each").click()
    wait_until(lambda: len(work.edits) == 1, "an edit is made")
    assert page.locator(".curves .titles").count() == 0
    page.locator("#compared").check()
    page.locator(".curves .titles", has_text="carry_box, before").wait_for()
    page.locator("#show summary").click()
    assert page.locator("#layers").get_by_label("before").is_checked()
    page.keyboard.press("b")
    wait_until(lambda: page.locator(".curves .titles").count() == 0, "its curves go")
    assert not page.locator("#layers").get_by_label("before").is_checked()
    page.close()


def test_a_page_that_is_reloaded_goes_on_where_it_was(browser, work):
    page = opened(browser, work.server.address)
    page.locator("#editor summary", has_text="All contacts").click()
    page.get_by_role("button", name="One point each").click()
    wait_until(lambda: page.locator("#edits option").count() == 2, "the edit is listed")
    page.reload()
    page.locator("#edits option", has_text="1: fix").wait_for(state="attached")
    assert page.locator("#saved").inner_text() == "not saved yet"
    page.close()


def serve_in(folder, environment) -> tuple[subprocess.Popen, str]:
    """Start `edit` as a user would, and return its process and address."""
    words = [sys.executable, "-u", "-m", "hoi_retarget", "edit", "builtin:carry_box", "--contact", "landmark"]
    process = subprocess.Popen(words, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        if found := re.search(r"http://\S+", line):
            return process, found[0]
    raise AssertionError("the server said no address")


def test_work_that_was_not_saved_survives_a_killed_server(browser, tmp_path):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    kept, saved = tmp_path / "carry_box.edits.toml.unsaved", tmp_path / "carry_box.edits.toml"
    process, where = serve_in(tmp_path, environment)
    try:
        page = opened(browser, where)
        page.locator("#editor summary", has_text="All contacts").click()
        page.get_by_role("button", name="One point each").click()
        wait_until(kept.exists, "what is not saved is kept")
        process.kill()
        process.communicate()
        page.get_by_role("button", name="Undo").click()
        page.get_by_text("The server does not answer").wait_for()
        page.close()
        process, where = serve_in(tmp_path, environment)
        page = opened(browser, where)
        page.locator("#editor summary", has_text="Versions").click()
        page.get_by_role("button", name="Take up unsaved edits").click()
        page.get_by_text("Taken up again").wait_for()
        assert load(kept).edits == (FixAll(),)
        page.get_by_role("button", name="Save edits").click()
        wait_until(saved.exists, "the edits are saved")
        assert load(saved).edits == (FixAll(),) and not kept.exists()
        page.close()
    finally:
        process.kill()
        process.communicate()  # Which closes its output.


def test_a_copy_without_a_server_shows_contacts_and_says_what_it_is(browser, work, tmp_path):
    (tmp_path / "copy.html").write_text(work.editor.page(copy="A copy; run the editor."))
    page = opened(browser, (tmp_path / "copy.html").as_uri())
    choose(page, "left hand")
    before = page.locator("#contacts").inner_text()
    page.locator("#delete").click()
    wait_until(lambda: told(page) == "A copy; run the editor.", "the copy answers for itself")
    assert page.locator("#contacts").inner_text() == before and not work.edits
    page.close()
