"""A revised motion: what was asked for, where it was asked for, and as the whole clip solved again would be."""

from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip
from hoi_retarget.clip.edits import Add, ContactEdits, apply
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting.config import Config, Horizon
from hoi_retarget.retargeting.local_resolve import changed_frames, resolve_locally
from hoi_retarget.retargeting.retarget import judge, retarget
from hoi_retarget.retargeting.site_pins import SitePin
from hoi_retarget.retargeting.solve import Solution, solve
from hoi_retarget.retargeting.targets import make_targets
from synthetic import make
from trajectories import MODELS

MODEL = MODELS["unitree_g1"]
FPS = 20.0
SHIFT = np.array([0.0, 0.03, 0.05])


@pytest.fixture(scope="module")
def before() -> Solution:
    return solve(make("carry_box", fps=FPS, seconds=24.0), MODEL, Config(contact="landmark"))


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
    ours = resolve_locally(before, clip, config).targets
    theirs = make_targets(clip, MODEL, config.scaling, contact=config.contact)
    for name in vars(theirs):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)


def test_frames_far_from_the_change_stay_and_the_changed_ones_are_as_if_the_whole_were_solved_again(before):
    clip = shifted(before.clip, 0)
    start, stop = before.clip.contacts[0].segments[0]
    after = judge(resolve_locally(before, clip, Config(contact="landmark")))
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
    away = resolve_locally(before, shifted(before.clip, 1), Config(contact="landmark"))
    back = resolve_locally(away, before.clip, Config(contact="landmark"))
    np.testing.assert_allclose(back.motion.qpos, before.motion.qpos, atol=5e-3)
    np.testing.assert_array_equal(back.motion.contact_points, before.motion.contact_points)


def test_nothing_changed_solves_nothing(before):
    again = resolve_locally(before, before.clip, Config(contact="landmark"))
    np.testing.assert_array_equal(again.motion.qpos, before.motion.qpos)
    assert not changed_frames(before.targets, again.targets).any()


WEIGHTED = slice(30, 50)
"""Frames in which contact and pin of the targets below weigh."""


def constructed():
    """Return targets with one link that touches, and one pin, for a while."""
    targets = make_targets(make("carry_box", fps=FPS, seconds=4.0), MODEL, Config().scaling)
    weights = np.zeros_like(targets.contact_weights)
    weights[WEIGHTED, 0] = 0.5
    rng = np.random.default_rng(0)
    quats = se3.exp(rng.normal(size=(targets.frames, 3)))
    pin = SitePin("pelvis", (40,), (40,), rng.normal(size=(targets.frames, 3)), weights[:, 0], quats, weights[:, 0])
    return replace(targets, contact_weights=weights, contact_rotation_weights=weights, pins=(pin,))


def other(array: np.ndarray, frame: int, link: int | None = None) -> np.ndarray:
    changed = array.copy()
    changed[(frame, link) if link is not None else frame] += 1
    return changed


@pytest.mark.parametrize("frame", [0, 29, 30, 40, 49, 50, -1])
def test_changed_frames_are_those_in_which_a_number_that_weighs_differs(frame):
    targets = constructed()
    (pin,) = targets.pins
    here = np.zeros(targets.frames, dtype=bool)
    here[frame] = True
    weighed = here & (targets.contact_weights[:, 0] > 0)
    lighter = other(targets.contact_weights, frame, 0)
    expected = {"contact_weights": (0, here), "contact_rotation_weights": (0, here), "foot_positions": (None, here)}
    expected |= {"carried_contact_points": (0, weighed), "carried_contact_object": (0, weighed)}
    expected |= {"foot_quats": (1, here), "object_pos": (None, ~(here | True))}
    assert not changed_frames(targets, constructed()).any()
    for name, (link, frames) in expected.items():
        after = replace(targets, **{name: other(getattr(targets, name), frame, link)})
        for pair in ((targets, after), (after, targets)):
            np.testing.assert_array_equal(changed_frames(*pair), frames, err_msg=name)
    # A contact that weighs on one side alone counts, too; so do the other frames with other weights.
    for one, two in ((lighter, targets.contact_weights), (targets.contact_weights, lighter)):
        before = replace(targets, contact_weights=one)
        after = replace(targets, contact_weights=two, carried_contact_points=targets.carried_contact_points + 1.0)
        np.testing.assert_array_equal(changed_frames(before, after), here | (targets.contact_weights[:, 0] > 0))
    for name, frames in (("positions", weighed), ("quats", weighed), ("weights", here), ("turn_weights", here)):
        after = replace(targets, pins=(replace(pin, **{name: other(getattr(pin, name), frame)}),))
        for pair in ((targets, after), (after, targets)):
            np.testing.assert_array_equal(changed_frames(*pair), frames, err_msg=name)


def test_a_pin_that_comes_or_goes_changes_the_frames_in_which_it_weighs():
    targets = constructed()
    none = replace(targets, pins=())
    faded = replace(targets, pins=(replace(targets.pins[0], positions=targets.pins[0].positions + 1.0),))
    for pair in ((targets, none), (none, targets), (targets, faded)):
        assert np.flatnonzero(changed_frames(*pair)).tolist() == list(range(*WEIGHTED.indices(targets.frames)))


def test_a_change_longer_than_the_horizon_is_the_whole_clip_solved_again():
    config, clip = Config(contact="landmark", horizon=Horizon(30, 8, 3)), make("carry_box", fps=10.0, seconds=6.0)
    after = resolve_locally(solve(clip, MODEL, config), shifted(clip, 0), config)
    np.testing.assert_array_equal(after.motion.qpos, solve(shifted(clip, 0), MODEL, config).motion.qpos)


@pytest.mark.slow
def test_a_change_longer_than_the_horizon_is_solved_in_windows(before):
    config = Config(contact="landmark", horizon=Horizon(60, 15, 3))
    clip = shifted(before.clip, 0)
    after = resolve_locally(solve(before.clip, MODEL, config), clip, config).motion
    assert np.linalg.norm(palm(after, "left") - palm(retarget(clip, MODEL, config), "left"), axis=1).max() < 1e-6


@pytest.mark.parametrize("frames", [4, 13, 46])
def test_a_change_in_the_last_frame_of_a_clip_shorter_than_the_margin_is_solved_whole(frames):
    clip = make("carry_box", fps=30.0, seconds=(frames - 1) / 30.0)
    edits = ContactEdits.of(clip).adding(Add("left_hand", clip.frames - 1, clip.frames, (0.0, 0.2, 0.0)))
    edited = apply(clip, edits)
    after = resolve_locally(solve(clip, MODEL, Config(contact="landmark")), edited, Config(contact="landmark"))
    after = judge(after)
    whole = retarget(edited, MODEL, Config(contact="landmark")).report.figures["contact_gap_m"]
    assert after.report.figures["contact_gap_m"] == pytest.approx(whole, abs=2e-4)


def test_a_contact_taken_away_sets_the_hand_free(before):
    contacts = tuple(replace(track, active=np.zeros_like(track.active)) for track in before.clip.contacts)
    after = judge(resolve_locally(before, replace(before.clip, contacts=contacts), Config(contact="landmark")))
    assert not after.contact_flags.any()
    assert after.report.figures["contact_gap_m"] is None
