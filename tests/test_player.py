"""The player's clock: it goes on evenly, whatever is done to it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoi_retarget.studio.browser.player import Clock

TIMES = st.floats(0.0, 1e4)
SPEEDS = st.sampled_from((0.1, 0.25, 0.5, 1.0, 2.0, 4.0))
CLOCKS = st.builds(Clock, frames=st.integers(1, 10_000), fps=st.sampled_from((20.0, 30.0, 60.0)), speed=SPEEDS)


@given(CLOCKS, TIMES, TIMES)
def test_a_frame_of_the_motion_is_shown_at_any_time(clock, start, later):
    assert 0 <= clock.play(start).frame(start + later) < clock.frames


@given(CLOCKS, TIMES, st.floats(0.0, 100.0))
def test_it_plays_at_the_rate_and_speed_asked_for(clock, start, seconds):
    shown = clock.play(start).frame(start + seconds)
    expected = seconds * clock.fps * clock.speed % clock.frames
    away = abs(shown - expected)
    assert min(away, clock.frames - away) <= 1.0 + 1e-6


@given(CLOCKS, TIMES, TIMES, TIMES)
def test_paused_it_stands_still_where_it_was(clock, start, seconds, later):
    playing = clock.play(start)
    paused = playing.pause(start + seconds)
    assert paused.frame(start + seconds + later) == playing.frame(start + seconds)


@given(CLOCKS, TIMES, st.integers(-20_000, 20_000))
def test_it_goes_to_a_frame_that_there_is(clock, now, frame):
    assert clock.seek(frame, now).frame(now) == min(max(frame, 0), clock.frames - 1)


@given(CLOCKS, TIMES, TIMES, SPEEDS)
def test_another_speed_does_not_make_it_jump(clock, start, seconds, speed):
    playing, now = clock.play(start), start + seconds
    assert playing.at_speed(speed, now).frame(now) == playing.frame(now)


@given(CLOCKS, st.floats(0.0, 100.0))
def test_the_next_frame_is_due_when_it_says(clock, start):
    playing = clock.seek(clock.frames // 2, start).play(start)
    wait = playing.seconds_to_next(start)
    assert 0 < wait <= 1.0 / (clock.fps * clock.speed) + 1e-9
    assert playing.frame(start + 0.5 * wait) == playing.frame(start)
    if clock.frames > 1:
        assert playing.frame(start + 1.001 * wait + 1e-6) == (playing.frame(start) + 1) % clock.frames


def test_standing_still_nothing_is_due_soon():
    assert Clock(10, 30.0).seconds_to_next(5.0) == pytest.approx(3600.0)
