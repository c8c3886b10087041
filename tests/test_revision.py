"""A revised motion: what was asked for, where it was asked for, and as the whole clip solved again would be."""

from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import Add, ContactEdits, apply
from hoi_retarget.retargeting.config import Config, Horizon
from hoi_retarget.retargeting.local_resolve import Draft, changed_frames, draft, revise
from hoi_retarget.retargeting.pipeline import retarget
from hoi_retarget.retargeting.targets import make_targets
from hoi_retarget.synthetic import make
from trajectories import MODELS

MODEL = MODELS["unitree_g1"]
FPS = 20.0
SHIFT = np.array([0.0, 0.03, 0.05])


@pytest.fixture(scope="module")
def before() -> Draft:
    return draft(make("carry_box", fps=FPS, seconds=24.0), MODEL, Config(contact="landmark"))


def shifted(clip: Clip, track: int, segment: int = 0, offset: np.ndarray = SHIFT) -> Clip:
    contacts = list(clip.contacts)
    points = contacts[track].contact_points.copy()
    points[slice(*contacts[track].segments[segment])] += offset
    contacts[track] = replace(contacts[track], contact_points=points)
    return replace(clip, contacts=tuple(contacts))


def palm(motion, side: str) -> np.ndarray:
    return MODEL.forward(motion.qpos).site_position(f"{side}_palm")


def test_targets_with_another_clips_contacts_are_that_clips_targets(before):
    clip = shifted(before.clip, 0)
    config = Config(contact="landmark")
    ours = revise(before, clip, MODEL, config).targets
    theirs = make_targets(clip, MODEL, config.scaling, contact=config.contact)
    for name in vars(theirs):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)


def test_frames_far_from_the_change_stay_and_the_changed_ones_are_as_if_the_whole_were_solved_again(before):
    clip = shifted(before.clip, 0)
    start, stop = before.clip.contacts[0].segments[0]
    after = revise(before, clip, MODEL, Config(contact="landmark")).motion
    away = np.ones(after.frames, dtype=bool)
    away[max(0, start - 2 * int(FPS)) : stop + 2 * int(FPS)] = False
    assert away.any()
    np.testing.assert_array_equal(after.qpos[away], before.motion.qpos[away])
    np.testing.assert_array_equal(after.stages[0].qpos, before.motion.stages[0].qpos)
    whole = retarget(clip, MODEL, Config(contact="landmark"))
    side = before.clip.contacts[0].part.removesuffix("_hand")
    moved = np.linalg.norm(palm(after, side) - palm(before.motion, side), axis=1)[start + 5 : stop - 5]
    assert moved.min() > 0.02
    assert np.linalg.norm(palm(after, side) - palm(whole, side), axis=1).max() < 0.002
    assert after.report.figures["contact_gap_m"] == pytest.approx(whole.report.figures["contact_gap_m"], abs=2e-4)


def test_there_and_back_returns_to_the_first_motion(before):
    away = revise(before, shifted(before.clip, 1), MODEL, Config(contact="landmark"))
    back = revise(away, before.clip, MODEL, Config(contact="landmark"))
    np.testing.assert_allclose(back.motion.qpos, before.motion.qpos, atol=5e-3)
    np.testing.assert_array_equal(back.motion.contact_points, before.motion.contact_points)


def test_nothing_changed_solves_nothing(before):
    again = revise(before, before.clip, MODEL, Config(contact="landmark"))
    np.testing.assert_array_equal(again.motion.qpos, before.motion.qpos)
    assert not changed_frames(before.targets, again.targets).any()


@pytest.mark.slow
def test_a_change_longer_than_the_horizon_is_solved_in_windows(before):
    config = Config(contact="landmark", horizon=Horizon(60, 15, 3))
    clip = shifted(before.clip, 0)
    after = revise(draft(before.clip, MODEL, config), clip, MODEL, config).motion
    assert np.linalg.norm(palm(after, "left") - palm(retarget(clip, MODEL, config), "left"), axis=1).max() < 1e-6


@pytest.mark.parametrize("frames", [4, 13, 46])
def test_a_change_in_the_last_frame_of_a_clip_shorter_than_the_margin_is_solved_whole(frames):
    clip = make("carry_box", fps=30.0, seconds=(frames - 1) / 30.0)
    edits = ContactEdits.of(clip).adding(Add("left_hand", clip.frames - 1, clip.frames, (0.0, 0.2, 0.0)))
    edited = apply(clip, edits)
    after = revise(draft(clip, MODEL, Config(contact="landmark")), edited, MODEL, Config(contact="landmark")).motion
    whole = retarget(edited, MODEL, Config(contact="landmark")).report.figures["contact_gap_m"]
    assert after.report.figures["contact_gap_m"] == pytest.approx(whole, abs=2e-4)


def test_a_contact_taken_away_sets_the_hand_free(before):
    contacts = tuple(replace(track, active=np.zeros_like(track.active)) for track in before.clip.contacts)
    after = revise(before, replace(before.clip, contacts=contacts), MODEL, Config(contact="landmark")).motion
    assert not after.contact_flags.any()
    assert after.report.figures["contact_gap_m"] is None
