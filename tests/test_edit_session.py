"""What an editor does, without a browser: changes are solved, taken back, done again, and saved as they are."""

import numpy as np
import pytest

from hoi_retarget.clip.edits import (
    ChooseHold,
    ContactEdits,
    Fix,
    FixAll,
    Move,
    Retime,
    Segment,
    TurnHand,
    apply,
    load,
    save,
    segments_of,
)
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget
from hoi_retarget.studio.editor.edit_session import EditSession, EditState, solved
from hoi_retarget.studio.editor.editor_state import SurfaceGaps
from synthetic import make
from trajectories import MODELS

MODEL, CONFIG = MODELS["unitree_g1"], Config(contact="landmark")
LIFT = Move("left_hand", 60, (0.0, 0.0, 0.05))


@pytest.fixture(scope="module")
def recorded():
    return make("carry_box", fps=20.0, seconds=6.0)


@pytest.fixture(scope="module")
def start(recorded) -> EditState:
    return solved(recorded, MODEL, CONFIG, ContactEdits.of(recorded))


@pytest.fixture
def editing(recorded, start) -> EditSession:
    return EditSession(recorded, MODEL, CONFIG, start)


def test_what_is_tried_is_not_done_until_it_is_taken(editing, start):
    previewed = editing.preview(LIFT)
    assert editing.now is start
    assert editing.previous is None
    editing.commit(previewed)
    assert editing.now is previewed
    assert editing.previous is start
    assert not previewed.complete


def test_undo_and_redo_go_back_and_forth(editing, start):
    editing.commit(editing.preview(LIFT))
    editing.commit(editing.preview(Fix("right_hand", 60)))
    last = editing.now
    editing.undo()
    editing.undo()
    assert editing.now is start
    with pytest.raises(ArgumentError, match="take back"):
        editing.undo()
    editing.redo()
    editing.redo()
    assert editing.now is last
    with pytest.raises(ArgumentError, match="again"):
        editing.redo()


def test_a_new_edit_forgets_what_was_taken_back(editing):
    editing.commit(editing.preview(LIFT))
    editing.undo()
    editing.commit(editing.preview(FixAll()))
    with pytest.raises(ArgumentError, match="again"):
        editing.redo()


def test_edits_that_were_read_can_be_taken_back_too(recorded, start):
    edits = ContactEdits.of(recorded).adding(LIFT)
    editing = EditSession(recorded, MODEL, CONFIG, solved(recorded, MODEL, CONFIG, edits))
    editing.undo()
    assert editing.now.edits.edits == ()
    np.testing.assert_allclose(editing.now.motions[0].qpos, start.motions[0].qpos, atol=5e-3)


def test_the_whole_solved_is_what_the_pipeline_makes_to_the_bit(editing, recorded, tmp_path):
    editing.commit(editing.preview(LIFT))
    editing.commit(editing.preview(FixAll()))
    editing.solve_all()
    assert editing.now.complete
    save(editing.now.edits, tmp_path / "edits.toml")
    motion = retarget(apply(recorded, load(tmp_path / "edits.toml")), MODEL, CONFIG)
    for name in ("qpos", "contact_points", "contact_flags"):
        assert getattr(editing.now.motions[0], name).tobytes() == getattr(motion, name).tobytes()


def test_an_edit_that_cannot_be_done_changes_nothing(editing, start):
    with pytest.raises(ClipError, match="left_hand"):
        editing.preview(Move("left_hand", 0, (0.0, 0.0, 0.1)))
    assert editing.now is start


def test_a_contact_retimed_again_right_away_was_retimed_once(editing, recorded, start):
    for span in ((70, 80), (75, 78), (50, 90)):
        first = editing.now.segments[0].start
        editing.commit(editing.preview(Retime("left_hand", first, *span)))
    first = segments_of(recorded)[0].start
    assert editing.now.edits.edits == (Retime("left_hand", first, 50, 90),)
    editing.commit(editing.preview(Retime("right_hand", 60, 50, 90)))
    assert len(editing.now.edits.edits) == 2, "another contact's is another edit"
    points = segments_of(recorded)[0].points
    assert {*map(tuple, editing.now.segments[0].points)} <= {*map(tuple, points)}, "no point was lost on the way"
    editing.undo()
    assert editing.now.edits.edits == (Retime("left_hand", first, 50, 90),)
    editing.undo()
    assert editing.now is start, "one step back for each edit, however often it was made again"
    for edits in (1, 2):
        editing.redo()
        assert len(editing.now.edits.edits) == edits


def test_a_hold_that_is_stepped_through_and_a_hand_that_is_turned_are_one_edit_each(editing, start):
    for rank in (2, 3):
        editing.commit(editing.preview(ChooseHold("left_hand", 60, rank)))
    for angle in (10.0, 20.0):
        editing.commit(editing.preview(TurnHand("left_hand", 60, (0.0, 0.0, angle))))
    assert editing.now.edits.edits == (ChooseHold("left_hand", 60, 3), TurnHand("left_hand", 60, (0.0, 0.0, 20.0)))
    left = next(segment for segment in editing.now.segments if segment.part == "left_hand")
    assert (left.hold, left.turn) == (2, (0.0, 0.0, 20.0))
    editing.undo()
    editing.undo()
    assert editing.now is start


@pytest.mark.slow
def test_during_a_drag_hands_are_where_they_will_be_and_the_rest_of_the_clip_stays(recorded):
    start = solved(recorded, MODEL, Config(), ContactEdits.of(recorded))
    editing = EditSession(recorded, MODEL, Config(), start)
    edit = Move("left_hand", 60, (0.0, 0.0, 0.03))
    quick, whole = (editing.preview(edit, quickly=quickly).motions[0] for quickly in (True, False))
    palms = [MODEL.forward(motion.qpos).site_position("left_palm") for motion in (start.motions[0], quick, whole)]
    at = next(segment for segment in start.segments if segment.part == "left_hand")
    middle = slice(at.start + 10, at.stop - 10)
    assert np.linalg.norm(palms[1] - palms[2], axis=1)[middle].max() < 0.01
    assert np.linalg.norm(palms[0] - palms[2], axis=1)[middle].min() > 0.01
    far = [frame for frame in range(recorded.frames) if not at.start - 30 < frame < at.stop + 30]
    np.testing.assert_array_equal(quick.qpos[far], start.motions[0].qpos[far])


@pytest.mark.slow
def test_each_persons_robot_follows_its_own_contacts():
    recorded = make("carry_table", fps=15.0)
    editing = EditSession(recorded, MODEL, CONFIG, solved(recorded, MODEL, CONFIG, ContactEdits.of(recorded)))
    segment = next(item for item in editing.now.segments if item.person == 1)
    previewed = editing.preview(Move(segment.part, segment.start, (0.0, 0.03, 0.0), person=1))
    one, two = (
        np.abs(after.qpos - before.qpos).max()
        for after, before in zip(previewed.motions, editing.now.motions, strict=True)
    )
    assert one == 0.0
    assert two > 1e-3


def test_recorded_contacts_are_never_in_thin_air_and_those_far_off_are(recorded):
    gaps = SurfaceGaps(recorded)
    assert not any(gap.in_thin_air for gap in gaps.of(segments_of(recorded)))
    top = float(recorded.objects[0].geometry.points[:, 2].max())
    for height, in_air in ((0.0, False), (0.045, False), (0.055, True), (0.3, True)):
        place = (0.0, 0.0, top + height)
        (gap,) = gaps.of([Segment(0, "left_hand", 0, 0, 2, np.tile(place, (2, 1)))])
        assert gap.distance == pytest.approx(height, abs=1e-9)
        assert gap.in_thin_air is in_air
        assert f"{1e3 * height:.0f} mm off the surface" in gap.text


def test_a_recording_whose_hands_lie_far_off_is_believed(recorded):
    """Scans have thick and thin places, and some objects are known by their hulls alone."""
    far = apply(recorded, ContactEdits.of(recorded).adding(Move("left_hand", 60, (0.0, 0.3, 0.0))))
    gaps = SurfaceGaps(far)
    assert not any(gap.in_thin_air for gap in gaps.of(segments_of(far)))
    assert [gap.in_thin_air for gap in SurfaceGaps(recorded).of(segments_of(far))] == [True, False]
