"""The contact editor in a browser: a point that is dragged takes the hand along, and nothing is lost on the way."""

import os
import re
import subprocess
import sys
import threading

import numpy as np
import pytest

from browser import box_of, chromium, open_page, scene_pixels, still, wait_until
from hoi_retarget.cli import main
from hoi_retarget.clip.edits import ContactEdits, FixAll, Pin, Retime, load
from hoi_retarget.clip.edits.edits_file import EditsFiles
from hoi_retarget.motion.result_file import load as load_motion
from hoi_retarget.motion.result_file import save
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.readers.open import open_clip
from hoi_retarget.retargeting.config import Config
from trajectories import MODELS

pytest.importorskip("viser", reason="viser is not installed")

from hoi_retarget.studio.browser.browser_server import address, open_server, serve_sessions
from hoi_retarget.studio.browser.edit_session import EditSession, solved
from hoi_retarget.studio.browser.editor import Editor, SaveTargets
from hoi_retarget.studio.browser.editor_panel import PANEL_WIDTH_PX

pytestmark = [pytest.mark.browser, pytest.mark.slow]

MODEL = MODELS["unitree_g1"]
HANDLE = 0.17  # Where along an axis the handle's arrow is taken [m].


@pytest.fixture(scope="module")
def start():
    clip = open_clip("builtin:carry_box")
    return clip, solved(clip, MODEL, Config(), ContactEdits.of(clip))


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started


class Session:
    """A server whose editors the test can look into."""

    def __init__(self, start, folder):
        self.clip, edited = start
        self.folder = folder
        self.editors: list[Editor] = []
        self.saved = []
        self.clients = []
        self.server = open_server("test")
        serve_sessions(self.server, lambda client: self._receive(client, edited))

    @property
    def editor(self) -> Editor:
        """Of the page that was opened last."""
        wait_until(lambda: bool(self.editors), "there is an editor")
        return self.editors[-1]

    def _receive(self, client, edited):
        editing = EditSession(self.clip, MODEL, Config(), edited)
        places = SaveTargets(EditsFiles(self.folder / "edits.toml"), self._save_result)
        self.clients.append(client)
        self.editors.append(Editor(client, editing, MODEL, places, self.saved.append))
        return self.editors[-1]

    def _save_result(self, edited):
        path = self.folder / "editor.npz"
        save(edited.motions[0], path)
        return (path,)


@pytest.fixture
def session(start, tmp_path):
    session = Session(start, tmp_path)
    yield session
    session.server.stop()
    names = {"player", "editor"}
    wait_until(lambda: not names & {thread.name for thread in threading.enumerate()}, "all work has ended")


def told(page) -> str:
    return page.locator(".told").inner_text()


def choose(page, words: str) -> None:
    page.get_by_role("button", name=words).first.click()
    page.locator("button", has_text=words).first.wait_for()


def pixel(page, client, point: np.ndarray) -> np.ndarray:
    """Return where a point of the world is in the window."""
    box = box_of(page.locator("canvas").first)
    ahead = client.camera.look_at - client.camera.position
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    away = point - client.camera.position
    focal = 0.5 * box["height"] / np.tan(0.5 * client.camera.fov)
    x, y = away @ right / (away @ ahead), away @ np.cross(ahead, right) / (away @ ahead)
    return np.array([box["x"] + 0.5 * box["width"] + focal * x, box["y"] + 0.5 * box["height"] + focal * y])


def drag(page, begin: np.ndarray, end: np.ndarray, steps: int) -> None:
    """Take a handle, which is coloured where it can be taken, and pull it."""
    x, y = map(int, begin)

    def there() -> np.ndarray:
        return scene_pixels(page)[y - 4 : y + 5, x - 4 : x + 5]

    page.mouse.move(x + 60, y)
    before = still(there)

    def taken() -> bool:
        page.mouse.move(*begin)
        coloured = np.abs(there() - before).max() > 40
        if not coloured:
            page.mouse.move(*(begin + 1))  # Only a pointer that moves is looked for.
        return coloured

    wait_until(taken, "the handle can be taken")
    page.mouse.down()
    for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
        page.mouse.move(*(begin + share * (end - begin)))
        page.wait_for_timeout(200)
    page.mouse.up()


def drag_upwards(page, session: Session, distance: float) -> None:
    """Take the chosen point's handle by the arrow that points up, and pull it."""
    editor, client = session.editor, session.clients[-1]
    motion, segment, frame = editor.edited.motions[0], editor.chosen, editor.frame
    turn, world = motion.object_quat[frame, 0], np.array(client.scene.get_handle_by_name("/world").position)
    point = motion.object_scale[0] * segment.points.mean(axis=0)
    axis = np.array([0.0, 0.0, 1.0])

    def place(along: float) -> np.ndarray:
        inside = point + along * axis
        return pixel(page, client, world + motion.object_pos[frame, 0] + se3.rotate(turn, inside))

    drag(page, place(HANDLE), place(HANDLE + distance), steps=5)


def palm_in_object(motion, frame: int) -> np.ndarray:
    palm = MODEL.forward(motion.qpos[frame : frame + 1]).site_position("left_palm")[0]
    return se3.rotate_inverse(motion.object_quat[frame, 0], palm - motion.object_pos[frame, 0])


def test_a_dragged_point_takes_the_hand_along_and_the_command_line_makes_the_same_of_it(browser, session):
    page = open_page(browser, address(session.server))
    page.get_by_text("2 contacts").wait_for()
    choose(page, "left hand")
    editor = session.editor
    wait_until(lambda: editor.chosen is not None, "the contact is chosen")
    still(lambda: scene_pixels(page))
    before, frame = editor.edited, editor.frame
    drag_upwards(page, session, 0.10)
    wait_until(lambda: len(editor.edited.edits.edits) == 1, "the drag became an edit")
    scale = before.motions[0].object_scale[0]
    asked = scale * (editor.edited.segments[0].points - before.segments[0].points).mean(axis=0)
    assert np.linalg.norm(asked - [0.0, 0.0, 0.10]) < 0.005
    moved = palm_in_object(editor.edited.motions[0], frame) - palm_in_object(before.motions[0], frame)
    assert moved[2] > 0.09
    # The palm is where it was put along the box's side, and as far off it as a palm is thick.
    point = scale * editor.edited.segments[0].points.mean(axis=0)
    assert np.abs(palm_in_object(editor.edited.motions[0], frame) - point)[[0, 2]].max() < 0.005
    (edit,) = editor.edited.edits.edits
    assert edit.offset == tuple(round(number, 4) for number in edit.offset), "tenths of a millimetre"
    wait_until(lambda: re.search(r"jerk [\d.]+ -> [\d.]+ m/s³", told(page)), "what changed is said")

    before_saving = editor.edited
    page.get_by_text("Save edits", exact=True).click()
    wait_until(lambda: "Saved 1 edit" in told(page), "the edits are saved")
    page.get_by_text("Save result", exact=True).click()
    wait_until(lambda: "editor.npz" in told(page), "the result is saved")
    edits = session.folder / "edits.toml"
    assert len(load(edits).edits) == 1
    assert session.saved == [before_saving]
    assert main(["run", "builtin:carry_box", "--edits", str(edits), "--out", str(session.folder / "out")]) == 0
    ours, theirs = load_motion(session.folder / "editor.npz"), load_motion(session.folder / "out" / "carry_box.npz")
    for name in ("qpos", "object_pos", "contact_flags", "contact_points", "stance_flags"):
        assert getattr(ours, name).tobytes() == getattr(theirs, name).tobytes(), name
    page.close()


def test_a_contact_in_thin_air_is_told(browser, session):
    page = open_page(browser, address(session.server))
    page.get_by_text("2 contacts").wait_for()
    choose(page, "right hand")
    editor = session.editor
    wait_until(lambda: editor.chosen is not None, "the contact is chosen")
    still(lambda: scene_pixels(page))
    drag_upwards(page, session, 0.26)
    wait_until(lambda: len(editor.edited.edits.edits) == 1, "the drag became an edit")
    surface = surface_of(editor.edited.clip.objects[0].geometry)
    off = 1e3 * surface.distances(editor.edited.segments[1].points).mean()
    assert off > 50
    wait_until(lambda: f"{off:.0f} mm off the surface. It touches nothing there" in told(page), "the editor says so")
    assert re.search(
        r"Hold: right_hand on 'box', frames \d+ to \d+: [\d.]+ cm and \d+ degrees from the person's", told(page)
    )
    page.get_by_role("button", name=f"point {off:.0f} mm off").wait_for()
    page.get_by_text("To surface", exact=True).click()
    wait_until(lambda: "The point is 0 mm off the surface." in told(page), "it was put back")
    page.close()


def test_buttons_edit_undo_and_redo(browser, session):
    page = open_page(browser, address(session.server))
    page.get_by_text("2 contacts").wait_for()
    editor = session.editor

    def edits() -> int:
        return len(editor.edited.edits.edits)

    page.get_by_text("Delete", exact=True).click()
    page.get_by_text("No contact is chosen").wait_for()
    choose(page, "right hand")
    wait_until(lambda: editor.chosen is not None, "the contact is chosen")
    page.get_by_text("Split here", exact=True).click()
    wait_until(lambda: len(editor.edited.segments) == 3, "there are two contacts of the right hand")
    page.get_by_role("button", name="right hand").nth(1).wait_for()
    page.get_by_text("One point", exact=True).click()
    wait_until(lambda: edits() == 2, "it is fixed")
    page.get_by_text("Undo", exact=True).click()
    wait_until(lambda: edits() == 1, "it is not any more")
    page.get_by_text("Redo", exact=True).click()
    wait_until(lambda: edits() == 2, "it is again")
    page.get_by_text("One point each", exact=True).click()
    wait_until(lambda: edits() == 3, "all are")
    page.get_by_text("Next hold", exact=True).click()
    wait_until(lambda: edits() == 4, "another hold is chosen")
    assert editor.chosen.hold == 1
    wait_until(lambda: re.search(r"hold \d+ of \d+, score", told(page)), "its rank and score are told")
    page.get_by_text("Solve whole clip", exact=True).click()
    wait_until(lambda: editor.edited.complete, "all frames are solved")
    page.get_by_text("Delete", exact=True).click()
    wait_until(lambda: len(editor.edited.segments) == 2, "one is gone")
    page.get_by_role("combobox", name="Edits").click()
    page.get_by_role("option", name="1: split").click()
    wait_until(lambda: edits() == 1, "all but the first edit are taken back at once")
    page.close()


def test_what_cannot_be_done_is_told_and_the_editor_goes_on_with_the_same_contact(browser, session):
    page = open_page(browser, address(session.server))
    page.get_by_text("2 contacts").wait_for()
    choose(page, "left hand")
    editor = session.editor
    wait_until(lambda: editor.chosen is not None, "the contact is chosen")
    middle = editor.frame
    page.mouse.click(700, 200)
    page.keyboard.press("Home")
    wait_until(lambda: editor.frame == 0, "a frame before the contact is shown")
    page.get_by_text("End here", exact=True).click()
    page.get_by_text("no frame is left").wait_for()
    choose(page, "left hand")
    wait_until(lambda: editor.frame == middle, "a frame of the contact is shown")
    page.get_by_text("Start here", exact=True).click()
    wait_until(lambda: editor.chosen is not None and editor.chosen.start == middle, "it begins there, and is chosen")
    page.close()


def test_two_editors_are_apart_and_a_closed_one_stops_its_work(browser, session):
    def workers() -> int:
        return sum(thread.name == "editor" for thread in threading.enumerate())

    wait_until(lambda: workers() == 0, "editors of other tests have ended")
    one, two = open_page(browser, address(session.server)), open_page(browser, address(session.server))
    wait_until(lambda: len(session.editors) == 2 and workers() == 2, "each has an editor")
    one.get_by_text("2 contacts").wait_for()
    one.get_by_text("One point each", exact=True).click()
    wait_until(lambda: sum(len(editor.edited.edits.edits) for editor in session.editors) == 1, "one of them edits")
    one.close()
    wait_until(lambda: workers() == 1, "its work ends")
    two.get_by_text("One point each", exact=True).click()
    wait_until(lambda: all(len(editor.edited.edits.edits) == 1 for editor in session.editors), "the other goes on")
    two.close()
    wait_until(lambda: workers() == 0, "its work ends too")


def test_a_part_is_pinned_by_dragging_its_handle(browser, session):
    page = open_page(browser, address(session.server))
    page.get_by_text("2 contacts").wait_for()
    editor, client = session.editor, session.clients[-1]
    page.get_by_role("combobox", name="Pin", exact=True).click()
    page.get_by_role("option", name="pelvis").click()
    wait_until(lambda: client.scene.get_handle_by_name("/world/pin") is not None, "the pelvis has a handle")
    still(lambda: scene_pixels(page))
    before = editor.edited

    def place(along: float) -> np.ndarray:
        pelvis = MODEL.forward(before.motions[0].qpos[:1]).site_position("pelvis")[0]
        world = np.array(client.scene.get_handle_by_name("/world").position)
        turn = MODEL.forward(before.motions[0].qpos[:1]).site_rotation("pelvis")[0]
        return pixel(page, client, world + pelvis + along * turn[:, 2])

    drag(page, place(0.2), place(0.12), steps=4)
    wait_until(lambda: len(editor.edited.edits.edits) == 1, "the drag became a pin")
    (edit,) = editor.edited.edits.edits
    assert isinstance(edit, Pin) and (edit.part, edit.frame, edit.turn) == ("pelvis", 0, None)
    moved = [MODEL.forward(item.motions[0].qpos[:1]).site_position("pelvis")[0] for item in (before, editor.edited)]
    assert moved[1][2] - moved[0][2] == pytest.approx(-0.08, abs=0.02)
    wait_until(lambda: "off its pin" in told(page), "it is said how well it is met")
    page.get_by_role("combobox", name="Pins").click()
    page.get_by_role("option", name=re.compile(r"pelvis 0 \(\d+ mm off\)")).wait_for()
    page.keyboard.press("Escape")
    page.get_by_text("Unpin here", exact=True).click()
    wait_until(lambda: len(editor.edited.edits.edits) == 2 and not editor.edited.clip.pins, "it is let go")
    page.get_by_text("Undo", exact=True).click()
    wait_until(lambda: len(editor.edited.clip.pins) == 1, "it is taken back as any edit")
    page.close()


def test_a_pinned_hand_is_turned_by_a_ring_of_its_handle(browser, session):
    page = open_page(browser, address(session.server))
    page.get_by_text("2 contacts").wait_for()
    editor, client = session.editor, session.clients[-1]
    page.get_by_text("Frame", exact=True).locator("xpath=ancestor::div[.//input][1]").locator(
        ".mantine-NumberInput-input"
    ).fill("40")
    wait_until(lambda: editor.frame == 40, "another frame is shown")
    page.get_by_role("combobox", name="Pin", exact=True).click()
    page.get_by_role("option", name="left hand").click()
    page.get_by_role("checkbox", name="Turn too").check()
    wait_until(lambda: client.scene.get_handle_by_name("/world/pin") is not None, "the hand has a handle")
    still(lambda: scene_pixels(page))

    def hand() -> tuple[np.ndarray, np.ndarray]:
        now = MODEL.forward(editor.edited.motions[0].qpos[40:41])
        return now.site_position("left_palm")[0], now.site_rotation("left_palm")[0]

    (place, rotation), ring = hand(), 0.65 * 0.25  # [m], of the handle's size.
    world = np.array(client.scene.get_handle_by_name("/world").position)
    assert client.scene.get_handle_by_name("/world/pin").position == pytest.approx(place, abs=1e-6)
    towards = rotation.T @ (client.camera.position - client.camera.look_at)
    axis = int(np.argmax(np.abs(towards)))  # Which is turned about: the ring that is seen best.

    def on_ring(degrees: float) -> np.ndarray:
        way = np.roll([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0], axis + 1)
        return pixel(page, client, world + place + rotation @ (ring * way))

    drag(page, on_ring(40), on_ring(65), steps=4)
    wait_until(lambda: len(editor.edited.edits.edits) == 1, "the drag became a pin")
    (edit,) = editor.edited.edits.edits
    assert isinstance(edit, Pin) and (edit.part, edit.frame) == ("left_hand", 40) and edit.turn is not None
    moved, turned = hand()
    expected = rotation @ se3.quat_to_matrix(se3.exp(np.radians(25.0) * np.eye(3)[axis]))
    assert np.linalg.norm(moved - place) < 0.01
    (off,) = se3.matrix_angle_between(turned[None], expected[None])
    assert np.degrees(off) < 1.0, "the hand is turned as far as the ring"
    wait_until(lambda: "off its pin" in told(page), "it is said how well it is met")
    page.close()


def test_on_a_phone_a_part_is_pinned_in_the_frame_that_is_shown(browser, session):
    phone = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
    page = open_page(browser, address(session.server), **phone)
    page.get_by_role("button", name="left hand").first.tap()
    editor, client = session.editor, session.clients[-1]
    wait_until(lambda: editor.frame > 0, "the contact's middle is shown")
    sheet = box_of(page.locator(".mantine-ScrollArea-root", has_text="Playback").first)
    assert sheet["x"] == 0 and sheet["width"] == 390 and sheet["height"] <= 0.5 * 844 + 1
    page.get_by_role("combobox", name="Pin", exact=True).tap()
    page.get_by_role("option", name="right hand").tap()
    wait_until(lambda: client.scene.get_handle_by_name("/world/pin") is not None, "the hand has a handle")
    palm = MODEL.forward(editor.edited.motions[0].qpos).site_position("right_palm")[editor.frame]
    handle = client.scene.get_handle_by_name("/world/pin")
    wait_until(lambda: np.allclose(handle.position, palm), "the handle is at the hand")
    page.close()


ENDS = "div:has(> .hoi-strip) ~ div:has(~ div > .hoi-curves) .mantine-Slider-thumb"


def test_an_end_of_a_bar_is_dragged_by_mouse_and_by_finger(browser, session):
    page = open_page(browser, address(session.server))
    page.get_by_text("2 contacts").wait_for()
    editor, bars = session.editor, page.locator(".hoi-strip i")
    page.locator(ENDS).nth(3).wait_for()
    start, stop = editor.edited.segments[0].start, editor.edited.segments[0].stop
    bar = box_of(bars.first)
    frame_px = bar["width"] / (stop - 1 - start)

    def middle(number: int) -> tuple[float, float]:
        box = box_of(page.locator(ENDS).nth(number))
        return box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]

    for number, end in enumerate((bar["x"], bar["x"] + bar["width"])):
        wait_until(lambda number=number, end=end: abs(middle(number)[0] - end) <= 6, "its ends can be taken")
    x, y = middle(0)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 10 * frame_px, y, steps=4)
    wait_until(lambda: editor.frame > start, "the frame is shown while it is dragged")
    wait_until(lambda: box_of(bars.first)["x"] > bar["x"] + 4, "the bar follows")
    page.mouse.up()
    wait_until(lambda: abs(editor.edited.segments[0].start - start - 10) <= 6, "the drag became an edit")
    (edit,) = editor.edited.edits.edits  # The thumb is beside the end.
    assert edit == Retime("left_hand", start, editor.edited.segments[0].start, stop)
    assert editor.chosen is editor.edited.segments[0]

    touch = page.context.new_cdp_session(page)
    x, y = middle(3)
    last = editor.edited.segments[1].stop
    for kind, away in (("touchStart", 0), ("touchMove", 10), ("touchMove", 20), ("touchEnd", None)):
        points = [] if away is None else [{"x": x - away * frame_px, "y": y}]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    wait_until(lambda: abs(last - 20 - editor.edited.segments[1].stop) <= 6, "a finger drags too")
    assert len(editor.edited.edits.edits) == 2
    page.get_by_text("Undo", exact=True).click()
    wait_until(lambda: editor.edited.segments[1].stop == last, "it is taken back as any edit")
    page.close()


def test_the_curves_leave_the_panels_free_and_lie_under_their_bars(browser, session):
    page = open_page(browser, address(session.server))
    page.get_by_text("2 contacts").wait_for()
    page.locator(".hoi-strip .row > div").first.wait_for()

    def boxes() -> list[tuple[float, float]]:
        names = (".hoi-curves", ".hoi-curves .plot", ".mantine-Slider-root >> nth=1", ".hoi-strip .row > div")
        found = [page.get_by_text("Playback", exact=True), *(page.locator(name).first for name in names)]
        return [(box["x"], box["width"]) for box in map(box_of, found)]

    panel, curves, plot, cursor, bars = still(boxes)
    assert curves[0] > PANEL_WIDTH_PX and sum(curves) < panel[0]
    for other in (cursor, bars):
        assert other == pytest.approx(plot, abs=1.0)
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


def test_work_that_was_not_saved_survives_a_killed_server_and_a_closed_page(browser, tmp_path):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    kept, saved = tmp_path / "carry_box.edits.toml.unsaved", tmp_path / "carry_box.edits.toml"
    process, where = serve_in(tmp_path, environment)
    try:
        page = open_page(browser, where)
        page.get_by_text("2 contacts").wait_for()
        page.get_by_text("One point each", exact=True).click()
        wait_until(kept.exists, "what is not saved is kept")
        process.kill()
        process.communicate()  # Which closes its output.
        page.close()
        process, where = serve_in(tmp_path, environment)
        for _ in range(2):  # A page that is closed loses nothing, either.
            page = open_page(browser, where)
            page.get_by_text("1 edit of last time not saved").wait_for()
            page.get_by_text("Take up unsaved edits", exact=True).click()
            page.get_by_text("Taken up again").wait_for()
            if _ == 0:
                page.close()
        assert load(kept).edits == (FixAll(),)
        page.get_by_text("Name", exact=True).locator("xpath=ancestor::div[.//input][1]//input").fill("fixed")
        page.get_by_text("Save as", exact=True).click()
        wait_until(lambda: "carry_box.fixed.edits.toml" in told(page), "a version is saved")
        assert not kept.exists() and not saved.exists(), "and nothing is unsaved any more"
        page.get_by_text("All to surface", exact=True).click()
        wait_until(kept.exists, "a later edit is not saved")
        page.get_by_role("combobox", name="Load").click()
        page.get_by_role("option", name="fixed").click()
        wait_until(lambda: "Loaded fixed. What was not saved is version unsaved now." in told(page), "it is loaded")
        assert {path.name for path in tmp_path.iterdir()} == {
            "carry_box.fixed.edits.toml", "carry_box.unsaved.edits.toml"
        }  # fmt: skip
        page.get_by_text("Save edits", exact=True).click()
        wait_until(saved.exists, "the edits are saved")
        assert load(saved).edits == (FixAll(),)
        page.close()
    finally:
        process.kill()
        process.communicate()  # Which closes its output.


def test_before_and_after_are_shown_together_when_asked_for(browser, session):
    page = open_page(browser, address(session.server))
    page.get_by_text("2 contacts").wait_for()
    editor = session.editor
    page.get_by_text("One point each", exact=True).click()
    wait_until(lambda: len(editor.edited.edits.edits) == 1, "an edit is made")
    assert page.locator(".curves .titles").count() == 0
    page.get_by_role("checkbox", name="Before").check()
    page.locator(".curves .titles", has_text="carry_box, before").wait_for()
    layer = session.clients[-1].scene.get_handle_by_name("/world/0/before")
    assert layer.visible
    page.get_by_role("checkbox", name="Before").uncheck()
    wait_until(lambda: not layer.visible, "the ghost goes")
    wait_until(lambda: page.locator(".curves .titles").count() == 0, "and its curves do")
    page.close()
