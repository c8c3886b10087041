"""What the editor answers its page, without a browser: edits, previews, files, and requests that mean nothing."""

import json
import re

import numpy as np
import pytest

from hoi_retarget.clip.edits import ContactEdits, FixAll, Move, Pin, Retime, TurnHand, load
from hoi_retarget.clip.edits.edits_file import EditsFiles
from hoi_retarget.errors import WriteError
from hoi_retarget.numerics import se3
from hoi_retarget.objects.mesh import surface_of
from hoi_retarget.retargeting.config import Config
from hoi_retarget.studio.editor.edit_session import EditSession, EditState, solved
from hoi_retarget.studio.editor.editor import Editor, SaveTargets
from synthetic import make
from trajectories import MODELS

MODEL, CONFIG = MODELS["unitree_g1"], Config(contact="landmark")


@pytest.fixture(scope="module")
def recorded():
    return make("carry_box", fps=20.0, seconds=6.0)


@pytest.fixture(scope="module")
def start(recorded) -> EditState:
    return solved(recorded, MODEL, CONFIG, ContactEdits.of(recorded))


class Page:
    """Sends requests as the page does, and keeps what it was told last."""

    def __init__(self, recorded, start, folder):
        targets = SaveTargets(EditsFiles(folder / "edits.toml"), lambda _: (folder / "result.npz",))
        self.editor = Editor(EditSession(recorded, MODEL, CONFIG, start), MODEL, targets)
        text = re.search(r'id="work" type="application/json">(.*?)</script>', self.editor.page())
        assert text is not None
        work = json.loads(text[1])
        self.fixed, self.now, self.pinned = work["fixed"], work["state"], None

    @property
    def edits(self):
        return self.editor.session.now.edits.edits

    def ask(self, action: str, **values):
        shown = {"action": action, "revision": self.now["revision"], "chosen": self.now["chosen"]}
        answer = json.loads(json.dumps(self.editor.answer({**shown, "pinned": self.pinned, **values}), allow_nan=False))
        if not answer.get("wrong") and "revision" in answer:
            self.now = answer
        return answer


@pytest.fixture
def page(recorded, start, tmp_path) -> Page:
    return Page(recorded, start, tmp_path)


def above(segment, height: float) -> list[float]:
    return (segment.points.mean(axis=0) + np.array([0.0, 0.0, height])).tolist()


def test_the_page_is_told_of_every_contact_and_what_can_be_changed(page, start):
    assert [item["part"] for item in page.now["segments"]] == ["left_hand", "right_hand"]
    for told, segment in zip(page.now["segments"], start.segments, strict=True):
        assert (told["start"], told["stop"]) == (segment.start, segment.stop)
        np.testing.assert_allclose(told["point"], segment.points.mean(axis=0), atol=1e-5)
    assert {item["name"] for item in page.fixed["pinned"]} >= {"left hand", "pelvis"}
    motion, (placed,) = start.motions[0], page.fixed["objects"]
    np.testing.assert_allclose(placed["positions"], motion.object_pos[:, 0], atol=1e-5)
    np.testing.assert_allclose(placed["quats"], motion.object_quat[:, 0], atol=1e-5)


def test_a_moved_contact_is_previewed_and_then_an_edit_of_tenths_of_millimetres(page, start):
    place = above(start.segments[0], 0.03126)
    preview = page.ask("preview_move", chosen=0, point=place)
    assert not page.edits and "mm off the surface" in preview["message"]
    assert len(preview["scene"]) < len(page.ask("show")["scene"])
    done = page.ask("move", chosen=0, point=place)
    assert page.edits == (Move("left_hand", start.segments[0].start, (0.0, 0.0, 0.0313)),)
    assert done["message"].startswith("move, left_hand") and "->" in done["message"]
    assert done["chosen"] == 0 and done["unsaved"]


def test_a_contact_that_is_kept_on_the_surface_is_there_and_a_far_one_is_told(page, start, recorded):
    place = above(start.segments[1], 0.3)
    assert page.ask("preview_move", chosen=1, point=place)["air"] == [False, True]
    page.ask("move", chosen=1, point=place, on_surface=True)
    surface = surface_of(recorded.objects[0].geometry)
    assert surface.distances(page.editor.session.now.segments[1].points).mean() < 2e-3
    assert not page.now["segments"][1]["air"]


def test_a_turned_handle_turns_a_hand_and_a_slip_of_it_does_not(page, start):
    place = start.segments[0].points.mean(axis=0).tolist()
    page.ask("move", chosen=0, point=place, turn=[0.0, 0.3, 0.0])
    page.ask("move", chosen=0, point=place, turn=[0.0, 12.34, 0.0])
    assert page.edits[1] == TurnHand("left_hand", start.segments[0].start, (0.0, 12.3, 0.0))


def test_a_pin_is_where_the_handle_was_let_go_and_turned_as_it(page):
    page.pinned = [0, "left_hand"]
    handle = page.ask("show")["handle"]
    place, quat = np.array(handle["positions"][40]), np.array(handle["quats"][40])
    asked, turned = place + np.array([0.0, 0.0, 0.02]), se3.quat_multiply(quat, se3.exp(np.array([0.0, 0.0, 0.2])))
    told = page.ask("pin", part=[0, "left_hand"], frame=40, point=asked.tolist(), quat=turned.tolist())
    (pin,) = page.edits
    assert isinstance(pin, Pin) and pin.turn is not None
    assert "off its pin" in told["message"] and told["pins"][0]["frame"] == 40
    np.testing.assert_allclose(told["handle"]["positions"][40], asked, atol=2e-4)
    hand = MODEL.forward(page.editor.session.now.motions[0].qpos[40:41]).site_rotation("left_palm")[0]
    assert np.degrees(se3.matrix_angle_between(hand[None], se3.quat_to_matrix(turned)[None]))[0] < 5
    page.ask("edit", edit={"operation": "unpin", "part": "left_hand", "frame": 40})
    assert not page.now["pins"]
    page.ask("undo")
    assert len(page.now["pins"]) == 1, "as any edit"


def test_edits_are_taken_back_and_done_again_and_the_retimed_contact_stays_chosen(page, start):
    first = start.segments[1]
    span = {"frame": first.start, "start": first.stop - 6, "stop": first.stop}
    page.ask("edit", chosen=1, edit={"operation": "retime", "part": "right_hand", **span})
    assert page.now["chosen"] == 1 and page.now["segments"][1]["start"] == first.stop - 6
    assert isinstance(page.edits[0], Retime)
    page.ask("edit", edit={"operation": "fix_all"})
    assert page.edits[1] == FixAll()
    page.ask("undo")
    assert len(page.edits) == 1
    page.ask("redo")
    page.ask("back", count=0)
    assert page.edits == () and page.now["edits"] == []
    assert page.ask("undo")["wrong"]


def test_a_new_contact_is_where_the_part_is_nearest_and_is_chosen(page, recorded):
    page.ask("edit", chosen=0, edit={"operation": "delete", "part": "left_hand", "frame": 60})
    page.ask("add", part=[0, "left_hand"], object=0, frame=50)
    (new,) = [item for item in page.now["segments"] if item["part"] == "left_hand"]
    assert (new["start"], new["stop"]) == (50, 60) and page.now["chosen"] == page.now["segments"].index(new)
    surface = surface_of(recorded.objects[0].geometry)
    assert surface.distances(np.array([new["point"]]))[0] < 1e-3


def test_files_keep_what_was_done_and_versions_are_by_name(page, recorded, start, tmp_path):
    page.ask("edit", edit={"operation": "fix_all"})
    unsaved = tmp_path / "edits.toml.unsaved"
    assert load(unsaved).edits == (FixAll(),)
    again = Page(recorded, start, tmp_path)
    assert again.now["recoverable"] and "1 edit of last time not saved" in again.now["message"]
    again.ask("recover")
    assert again.edits == (FixAll(),) and not again.now["recoverable"]
    assert "fixed" in again.ask("save_as", name="fixed")["message"] and again.now["versions"] == ["fixed"]
    assert not unsaved.exists() and not again.now["unsaved"]
    assert "there is a version fixed" in page.ask("save_as", name="fixed")["message"]
    assert "no name for a version" in page.ask("save_as", name="../x")["message"]
    again.ask("edit", edit={"operation": "snap_all"})
    assert "version unsaved now" in again.ask("load", name="fixed")["message"]
    assert again.edits == (FixAll(),)
    again.ask("save")
    assert load(tmp_path / "edits.toml").edits == (FixAll(),)
    assert "result.npz" in again.ask("save_result")["message"]
    assert again.editor.session.now.complete


def test_unsaved_edits_that_are_damaged_are_told_and_the_page_opens(recorded, start, tmp_path):
    (tmp_path / "edits.toml.unsaved").write_text("not toml [")
    page = Page(recorded, start, tmp_path)
    assert "cannot be read" in page.now["message"] and "TOML" in page.now["message"]
    assert page.ask("recover")["wrong"] and page.ask("edit", edit={"operation": "fix_all"})["unsaved"]


def test_an_edit_that_cannot_be_kept_is_told_and_is_done(page, monkeypatch):
    def full(self, edits):
        raise WriteError("the disk is full.")

    monkeypatch.setattr(EditsFiles, "keep", full)
    answer = page.ask("edit", edit={"operation": "fix_all"})
    assert answer["wrong"] and answer["message"] == "the disk is full." and answer["edits"]
    monkeypatch.undo()
    page.now = answer
    assert not page.ask("edit", edit={"operation": "snap_all"}).get("wrong"), "the page goes on"


def test_a_window_that_shows_earlier_work_is_told_and_changes_nothing(page):
    page.ask("edit", edit={"operation": "fix_all"})
    late = page.editor.answer({"action": "edit", "revision": 0, "edit": {"operation": "snap_all"}})
    assert "Another window" in late["message"] and late["revision"] == page.now["revision"]
    assert page.edits == (FixAll(),)


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"action": "format"}, "no action 'format'"),
        ({"action": "edit", "edit": {"operation": "explode"}}, "no operation 'explode'"),
        ({"action": "edit", "edit": {"operation": "fix", "part": "tail", "frame": 1}}, "part is 'tail'"),
        ({"action": "move", "point": [0, 0]}, "point"),
        ({"action": "move", "point": [0, 0, 0]}, "no contact is chosen"),
        ({"action": "pin", "part": [7, "pelvis"]}, "no person 7"),
        ({"action": "pin", "part": [0, "tail"]}, "part is 'tail'"),
        ({"action": "add", "part": [0, "tail"]}, "part is 'tail'"),
        ({"action": "add", "part": [0, "left_hand"], "object": 5}, "no object 5"),
        ({"action": "add", "part": [0, "left_hand"], "frame": 500}, "frame"),
        ({"action": "pin", "part": [0, "pelvis"], "frame": -1}, "frame"),
        ({"action": "load", "name": "absent"}, "no such file"),
        ([], "request"),
        ({"action": "show", "colour": 1}, "colour"),
    ],
)
def test_what_means_nothing_is_told_and_changes_nothing(page, request_, words):
    values = {"revision": 0, **request_} if isinstance(request_, dict) else request_
    answer = page.editor.answer(values)
    assert answer["wrong"] and words in answer["message"] and page.edits == ()
