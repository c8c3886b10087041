"""Contact edits: the laws of their operations, and what is refused."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hoi_retarget.clip.clip import Clip, ContactTrack
from hoi_retarget.clip.edits import (
    Add,
    ChooseHold,
    ContactEdits,
    Delete,
    Edit,
    Fix,
    FixAll,
    Merge,
    Move,
    Retime,
    Segment,
    Snap,
    SnapAll,
    Split,
    TurnHand,
    apply,
    from_text,
    segments_of,
)
from hoi_retarget.errors import ArgumentError, ClipError
from hoi_retarget.human.skeleton import HANDS, PARTS
from hoi_retarget.objects.mesh import surface_of
from synthetic import make

FAST = settings(max_examples=12, deadline=None, derandomize=True, database=None)
seeds = st.integers(0, 10_000)


@functools.cache
def built_in(scene: str) -> Clip:
    return make(scene, seconds=2.0)


@functools.lru_cache(maxsize=4)
def clip_with(seed: int) -> Clip:
    """Two people and a table, touched in random stretches at random points; no two contacts of a part overlap."""
    clip, rng = built_in("carry_table"), np.random.default_rng(seed)
    tracks = []
    for person in range(len(clip.people)):
        for part in PARTS:
            edges = np.sort(rng.choice(clip.frames, size=6, replace=False))
            active = np.zeros(clip.frames, dtype=bool)
            for start, stop in edges.reshape(3, 2):
                active[start:stop] = True
            tracks.append(ContactTrack(person, 0, part, active, 0.3 * rng.normal(size=(clip.frames, 3))))
    return replace(clip, contacts=tuple(tracks))


def edited(clip: Clip, *edits: Edit) -> tuple[Segment, ...]:
    return segments_of(apply(clip, functools.reduce(ContactEdits.adding, edits, ContactEdits.of(clip))))


def told(segments: tuple[Segment, ...]) -> list[tuple]:
    return [(s.person, s.part, s.object, s.start, s.stop, s.points.tobytes(), s.hold, s.turn) for s in segments]


def chosen(clip: Clip, seed: int) -> Segment:
    segments = segments_of(clip)
    return segments[seed % len(segments)]


def name(segment: Segment) -> dict:
    """Return how edits name a segment: by its middle frame."""
    return {"part": segment.part, "frame": (segment.start + segment.stop - 1) // 2, "person": segment.person}


def some_edit(clip: Clip, number: int) -> Edit:
    """Return an edit that some segment of the clip can take."""
    rng = np.random.default_rng(number)
    segment = chosen(clip, number)
    where, (x, y, z) = name(segment), rng.normal(size=3).tolist()
    kinds: list[Edit] = [Move(**where, offset=(x, y, z)), Delete(**where), Fix(**where), Fix(**where, point=(x, y, z))]
    kinds += [Snap(**where), FixAll(), SnapAll(), Retime(**where, start=segment.start, stop=segment.start + 1)]
    if segment.part in HANDS:
        kinds += [ChooseHold(**where, rank=1 + number % 3), TurnHand(**where, turn=(10.0 * x, 10.0 * y, 10.0 * z))]
    if segment.frames > 1:
        kinds.append(Split(**where, at=segment.start + 1))
    return kinds[rng.integers(len(kinds))]


# Laws


def test_segments_are_the_runs_of_the_tracks():
    clip = clip_with(0)
    found = segments_of(clip)
    assert len(found) == sum(len(track.segments) for track in clip.contacts)
    for track in clip.contacts:
        own = [s for s in found if (s.person, s.part) == (track.person, track.part)]
        assert tuple((s.start, s.stop) for s in own) == track.segments
        assert all(np.array_equal(s.points, track.contact_points[s.start : s.stop]) for s in own)


def test_no_edits_give_the_same_clip():
    clip = clip_with(1)
    assert apply(clip, ContactEdits.of(clip)) is clip


@FAST
@given(seed=seeds, number=seeds)
def test_applying_is_deterministic_and_leaves_the_clip_alone(seed, number):
    clip = clip_with(seed)
    before = told(segments_of(clip))
    edits = ContactEdits.of(clip).adding(some_edit(clip, number))
    first, second = apply(clip, edits), apply(clip, edits)
    assert told(segments_of(first)) == told(segments_of(second))
    assert told(segments_of(clip)) == before
    assert first.people is clip.people and first.objects is clip.objects


@FAST
@given(seed=seeds, number=seeds)
def test_taking_back_is_never_having_done_it(seed, number):
    clip = clip_with(seed)
    edits = ContactEdits.of(clip)
    after = edits.adding(some_edit(clip, number))
    assert after != edits
    assert after.without_last() == edits
    assert apply(clip, after.without_last()) is clip


@FAST
@given(seed=seeds, number=seeds)
def test_other_parts_stay_as_they_are(seed, number):
    clip = clip_with(seed)
    edit = some_edit(clip, number)
    assume(not isinstance(edit, FixAll | SnapAll))
    before, after = (
        [item for item in told(found) if item[:2] != (edit.person, edit.part)]
        for found in (segments_of(clip), edited(clip, edit))
    )
    assert after == before


@FAST
@given(seed=seeds, number=seeds)
def test_a_part_touches_one_thing_at_a_time_and_each_segment_has_a_track(seed, number):
    clip = clip_with(seed)
    result = apply(clip, ContactEdits.of(clip).adding(some_edit(clip, number)))
    assert len(result.contacts) == len(segments_of(result))
    for person in range(2):
        for part in PARTS:
            own = [track.active for track in result.contacts if (track.person, track.part) == (person, part)]
            assert np.sum(own, axis=0, initial=0).max() <= 1


@FAST
@given(seed=seeds, offset=st.tuples(*[st.floats(-1, 1)] * 3))
def test_moving_back_restores_the_points(seed, offset):
    clip = clip_with(seed)
    where = name(chosen(clip, seed))
    once = edited(clip, Move(**where, offset=offset))
    again = edited(clip, Move(**where, offset=offset), Move(**where, offset=tuple(-x for x in offset)))
    for before, moved, back in zip(segments_of(clip), once, again, strict=True):
        np.testing.assert_allclose(back.points, before.points, atol=1e-14)
        shift = offset if before.holds(where["frame"]) and name(before) == where else (0, 0, 0)
        np.testing.assert_allclose(moved.points - before.points, np.tile(shift, (before.frames, 1)), atol=1e-14)


@FAST
@given(seed=seeds, data=st.data())
def test_merging_what_was_split_restores_it(seed, data):
    clip = clip_with(seed)
    segment = chosen(clip, seed)
    assume(segment.frames > 1)
    at = data.draw(st.integers(segment.start + 1, segment.stop - 1))
    where = name(segment)
    halves = edited(clip, Split(**where, at=at))
    assert len(halves) == len(segments_of(clip)) + 1
    whole = edited(clip, Split(**where, at=at), Merge(segment.part, segment.start, person=segment.person))
    assert told(whole) == told(segments_of(clip))


@FAST
@given(seed=seeds)
def test_merging_goes_straight_over_the_gap(seed):
    clip = clip_with(seed)
    first, second = segments_of(clip)[:2]
    assume(second.start > first.stop)
    merged = edited(clip, Merge(**name(first)))[0]
    assert (merged.start, merged.stop) == (first.start, second.stop)
    gap = merged.points[first.frames - 1 : second.start - first.start + 1]
    np.testing.assert_allclose(np.diff(gap, n=2, axis=0), 0, atol=1e-12)
    np.testing.assert_array_equal(merged.points[: first.frames], first.points)
    np.testing.assert_array_equal(merged.points[second.start - first.start :], second.points)


@FAST
@given(seed=seeds)
def test_fixing_twice_is_fixing_once(seed):
    clip = clip_with(seed)
    where = name(chosen(clip, seed))
    once = edited(clip, Fix(**where))
    assert told(edited(clip, Fix(**where), Fix(**where))) == told(once)
    assert told(edited(clip, FixAll(), FixAll())) == told(edited(clip, FixAll()))
    assert all(segment.spread < 1e-12 for segment in edited(clip, FixAll()))
    fixed = next(s for s in once if name(s) == where)
    before = chosen(clip, seed)
    np.testing.assert_allclose(fixed.points[0], before.points.mean(axis=0))


def test_fixing_all_is_fixing_each():
    clip = clip_with(3)
    assert told(edited(clip, FixAll())) == told(edited(clip, *(Fix(**name(s)) for s in segments_of(clip))))
    assert told(edited(clip, SnapAll())) == told(edited(clip, *(Snap(**name(s)) for s in segments_of(clip))))


def test_fixing_to_a_given_point():
    clip = clip_with(3)
    where = name(chosen(clip, 5))
    (fixed,) = (s for s in edited(clip, Fix(**where, point=(0.1, 0.2, 0.3))) if name(s) == where)
    assert (fixed.points == [0.1, 0.2, 0.3]).all()


@FAST
@given(seed=seeds)
def test_snapping_twice_is_snapping_once_and_lands_on_the_surface(seed):
    clip = clip_with(seed)
    where = name(chosen(clip, seed))
    once, twice = edited(clip, Snap(**where)), edited(clip, Snap(**where), Snap(**where))
    surface = surface_of(clip.objects[0].geometry)
    for a, b in zip(once, twice, strict=True):
        np.testing.assert_allclose(a.points, b.points, atol=1e-9)
    (snapped,) = (s for s in once if name(s) == where)
    assert surface.distances(snapped.points).max() < 1e-9


@FAST
@given(seed=seeds)
def test_retiming_to_its_own_frames_changes_nothing(seed):
    clip = clip_with(seed)
    segment = chosen(clip, seed)
    same = edited(clip, Retime(**name(segment), start=segment.start, stop=segment.stop))
    assert told(same) == told(segments_of(clip))


@FAST
@given(seed=seeds, data=st.data())
def test_retiming_cuts_or_holds_the_nearest_point(seed, data):
    clip = built_in("carry_box")
    points = np.random.default_rng(seed).normal(size=(clip.frames, 3))
    active = np.zeros(clip.frames, dtype=bool)
    active[20:40] = True
    clip = replace(clip, contacts=(ContactTrack(0, 0, "left_hand", active, points),))
    start = data.draw(st.integers(0, clip.frames - 1))
    stop = data.draw(st.integers(start + 1, clip.frames))
    (segment,) = edited(clip, Retime("left_hand", 25, start, stop))
    assert (segment.start, segment.stop) == (start, stop)
    for frame in range(start, stop):
        np.testing.assert_array_equal(segment.points[frame - start], points[min(max(frame, 20), 39)])


@FAST
@given(seed=seeds)
def test_deleting_leaves_the_frames_untouched_by_the_part(seed):
    clip = clip_with(seed)
    segment = chosen(clip, seed)
    result = apply(clip, ContactEdits.of(clip).adding(Delete(**name(segment))))
    for track in result.contacts:
        if (track.person, track.part) == (segment.person, segment.part):
            assert not track.active[segment.start : segment.stop].any()
    assert len(segments_of(result)) == len(segments_of(clip)) - 1


@FAST
@given(seed=seeds)
def test_deleting_what_was_added_restores(seed):
    clip = clip_with(seed)
    clip = replace(clip, contacts=tuple(track for track in clip.contacts if track.part != "left_foot"))
    frame = seed % clip.frames
    add = Add("left_foot", frame, frame + 1, (0.1, 0, 0), person=seed % 2)
    (added,) = (s for s in edited(clip, add) if s.part == "left_foot")
    assert (added.start, added.stop, added.points.tolist()) == (frame, frame + 1, [[0.1, 0, 0]])
    assert told(edited(clip, add, Delete("left_foot", frame, person=seed % 2))) == told(segments_of(clip))


def test_halves_of_a_split_stay_apart_through_a_clip():
    clip = built_in("carry_box")
    clip = make("carry_box") if not segments_of(clip) else clip
    segment = segments_of(clip)[0]
    at = segment.start + 2
    result = apply(clip, ContactEdits.of(clip).adding(Split(**name(segment), at=at)))
    left = [track.segments for track in result.contacts if track.part == segment.part]
    assert left == [((segment.start, at),), ((at, segment.stop),)]


def test_the_first_of_overlapping_tracks_holds_as_it_does_for_the_robot():
    clip = built_in("carry_box")
    active = np.zeros(clip.frames, dtype=bool)
    active[10:20] = True
    points = np.zeros((clip.frames, 3))
    tracks = (
        ContactTrack(0, 0, "left_hand", active, points),
        ContactTrack(0, 0, "left_hand", np.ones_like(active), points + 1),
    )
    found = segments_of(replace(clip, contacts=tracks))
    assert [(s.start, s.stop, s.points[0, 0]) for s in found] == [(0, 10, 1), (10, 20, 0), (20, clip.frames, 1)]


# The clip carries its edits


def test_the_edited_clips_source_carries_the_edits():
    clip = clip_with(2)
    edits = ContactEdits.of(clip).adding(FixAll())
    result = apply(clip, edits)
    assert from_text(result.source.contact_edits, "source") == edits
    assert replace(result.source, contact_edits="") == clip.source
    for use in (ContactEdits.of, lambda edited: apply(edited, edits)):
        with pytest.raises(ClipError, match="edited already"):
            use(result)


# What is refused


def two_holds() -> Clip:
    """The left hand touches the box in frames 10 to 19 and 30 to 39."""
    clip = built_in("carry_box")
    active = np.zeros(clip.frames, dtype=bool)
    active[10:20] = active[30:40] = True
    return replace(clip, contacts=(ContactTrack(0, 0, "left_hand", active, np.zeros((clip.frames, 3))),))


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (Move("left_hand", 25, (0, 0, 0)), ("frame 25", "frames 10 to 19", "frames 30 to 39")),
        (Move("right_hand", 25, (0, 0, 0)), ("right_hand touches nothing in frame 25", "whole clip")),
        (Delete("left_hand", 15, person=1), ("no person 1", "person 0")),
        (Add("right_hand", 0, 1, (0, 0, 0), person=3), ("no person 3",)),
        (Split("left_hand", 15, 10), ("frames 10 to 19", "11 to 19")),
        (Split("left_hand", 15, 20), ("leaves nothing on one side",)),
        (Merge("left_hand", 35), ("after frames 30 to 39", "'box' again")),
        (Retime("left_hand", 15, 10, 31), ("frames 30 to 39", "frame 30 would be in both")),
        (Retime("left_hand", 15, 10, 62), ("frames 0 to 60", "frames 10 to 61")),
        (Retime("left_hand", 15, 10, 10**9), ("frames 0 to 60",)),
        (Add("left_hand", 5, 12, (0, 0, 0)), ("frames 10 to 19", "frames 10 to 11 would be in both")),
        (Add("left_hand", 60, 10**9, (0, 0, 0)), ("frames 0 to 60",)),
        (Add("left_hand", 0, 5, (0, 0, 0), "table"), ("no object 'table'", "Objects of the clip: box")),
    ],
)
def test_what_cannot_be_done_is_told_with_number_and_frames(edit, words):
    clip = two_holds()
    assert clip.frames == 61
    edits = ContactEdits.of(clip).adding(FixAll()).adding(edit)
    with pytest.raises(ClipError, match=r"contact edit 2 \(") as caught:
        apply(clip, edits)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_many_segments_are_not_all_listed():
    clip = built_in("carry_box")
    active = np.arange(clip.frames) % 2 == 0
    clip = replace(clip, contacts=(ContactTrack(0, 0, "left_hand", active, np.zeros((clip.frames, 3))),))
    with pytest.raises(ClipError, match=r"frame 28, .*frame 30, .*and 25 more\.$"):
        edited(clip, Delete("left_hand", 29))


def test_an_object_must_be_named_where_there_are_several():
    clip = two_holds()
    clip = replace(clip, objects=(clip.objects[0], replace(clip.objects[0], name="lid")))
    with pytest.raises(ClipError, match=r"which object .* box, lid"):
        edited(clip, Add("right_hand", 0, 5, (0, 0, 0)))
    assert edited(clip, Add("right_hand", 0, 5, (0, 0, 0), "lid"))[-1].object == 1


def test_merging_over_something_else_is_refused():
    clip = two_holds()
    clip = replace(clip, objects=(clip.objects[0], replace(clip.objects[0], name="lid")))
    with pytest.raises(ClipError, match=r"'lid' in frames 22 to 24"):
        edited(clip, Add("left_hand", 22, 25, (0, 0, 0), "lid"), Merge("left_hand", 15))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda clip: make("carry_box", seconds=3.0), "frames: 61 there, 91 here"),
        (lambda clip: replace(clip, fps=60.0), "frames a second: 30.0 there, 60.0 here"),
        (lambda clip: replace(clip, objects=(replace(clip.objects[0], name="lid"),)), "objects: box there, lid here"),
        (lambda clip: replace(clip, people=clip.people * 2), "people: 1 there, 2 here"),
        (lambda clip: replace(clip, contacts=()), "other contacts in the recording"),
    ],
)
def test_edits_of_another_clip_are_refused(change, word):
    clip = two_holds()
    edits = ContactEdits.of(clip)
    with pytest.raises(ClipError, match=word):
        apply(change(clip), edits)
    with pytest.raises(ClipError, match="made for another clip"):
        apply(change(clip), edits.adding(FixAll()))


def test_a_renamed_clip_with_other_points_is_the_same_clip():
    clip = two_holds()
    edits = ContactEdits.of(clip).adding(FixAll())
    (track,) = clip.contacts
    apply(replace(clip, name="other", contacts=(replace(track, contact_points=track.contact_points + 1.0),)), edits)


@pytest.mark.parametrize(
    ("make_edit", "word"),
    [
        (lambda: Move("head", 0, (0, 0, 0)), "left_hand, right_hand"),
        (lambda: Move("left_hand", -1, (0, 0, 0)), "frame is -1"),
        (lambda: Move("left_hand", 0, (0, 0, float("nan"))), "three numbers in metres"),
        (lambda: Move("left_hand", 0, (0, 0, 1e3)), "none beyond 100"),
        (lambda: Move("left_hand", 0, (0, 0, 0), person=-1), "person is -1"),
        (lambda: Retime("left_hand", 0, 5, 5), "no frame is left"),
        (lambda: Add("left_hand", 5, 4, (0, 0, 0)), "no frame is left"),
    ],
)
def test_edits_that_mean_nothing_cannot_be_made(make_edit, word):
    with pytest.raises(ArgumentError, match=word):
        make_edit()


def test_whole_numbers_are_coordinates():
    assert repr(Move("left_hand", 3, (1, 0, 0)).offset) == "(1.0, 0.0, 0.0)"


def test_there_may_be_nothing_to_take_back():
    with pytest.raises(ArgumentError, match="no contact edit"):
        ContactEdits.of(two_holds()).without_last()
