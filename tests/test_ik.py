"""Flips of limbs: another branch is found where the first start ends in a wrong one, and what is left says why."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip
from hoi_retarget.human.skeleton import JOINT_INDEX
from hoi_retarget.motion.motion_report import Event
from hoi_retarget.numerics import se3
from hoi_retarget.retargeting import ik
from hoi_retarget.retargeting.config import Config, Scaling
from hoi_retarget.retargeting.ik import in_one_branch, solve_ik, standing
from hoi_retarget.retargeting.orientation_flips import (
    limb_joints,
    orientation_flips,
    rotation_errors_deg,
    short_flips,
    with_reasons,
)
from hoi_retarget.retargeting.solve import one_thread
from hoi_retarget.retargeting.targets import Targets, make_targets
from short_clips import cut
from synthetic import make
from trajectories import MODELS

MODEL = MODELS["unitree_g1"]
CONFIG = Config()
ROLL = MODEL.joint_names.index("left_wrist_roll_joint")


@functools.cache
def scene() -> Clip:
    return cut(make("carry_box"), 90)


def rolling(degrees: np.ndarray) -> Clip:
    """The scene, whose person's left hand is turned about the forearm."""
    (person,) = scene().people
    quats, wrist = person.joint_quats.copy(), JOINT_INDEX["left_wrist"]
    turns = se3.exp(np.radians(degrees)[:, None] * np.array([1.0, 0.0, 0.0]))
    quats[:, wrist] = se3.quat_multiply(quats[:, wrist], turns)
    return replace(scene(), people=(replace(person, joint_quats=quats),))


def solved(targets: Targets) -> np.ndarray:
    with one_thread():
        return solve_ik(MODEL, targets, CONFIG.ik, CONFIG.horizon)[0]


def flips_of(qpos: np.ndarray, targets: Targets) -> tuple[Event, ...]:
    return short_flips(rotation_errors_deg(MODEL.forward(qpos), targets), targets.fps)


def swaying(degrees: float) -> Targets:
    """Targets for a hand that sways twice about the direction that the wrist can reach least."""
    phase = np.linspace(0.0, 4 * np.pi, scene().frames)
    return make_targets(rolling(180.0 + degrees * np.sin(phase)), MODEL, Scaling())


@pytest.mark.parametrize("degrees", [60.0, pytest.param(90.0, marks=pytest.mark.slow)])
def test_a_hand_that_sways_beyond_the_wrists_range_stays_on_one_side(degrees):
    """Both ends of the range are as near: one start alone changes from the one to the other, through half a turn."""
    targets = swaying(degrees)
    assert flips_of(solved(targets), targets) == ()


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1, 20, 3))
def test_flips_do_not_depend_on_the_frame_at_which_a_clip_starts(first):
    """The coarse solve sees other frames then."""
    targets = swaying(60.0).window(first, scene().frames)
    assert flips_of(solved(targets), targets) == ()


@pytest.mark.slow
def test_a_planted_wrong_branch_is_found_and_left(monkeypatch):
    """The first start has the wrist at the wrong end of its range in a second of the clip."""
    targets = make_targets(rolling(np.full(scene().frames, 150.0)), MODEL, Scaling())
    good = solved(targets)

    def wrong(model, coarse):
        start = standing(model, coarse)
        start[3:5, 7 + ROLL] = -np.sign(good[45, 7 + ROLL]) * 1.9
        return start

    monkeypatch.setattr(ik, "standing", wrong)
    found = solved(targets)
    assert flips_of(found, targets) == ()
    assert np.abs(found[:, 7 + ROLL] - good[:, 7 + ROLL]).max() < 1.0


def test_one_branch_goes_on_over_a_flip_and_the_shorter_side_of_it():
    qpos = np.tile(MODEL.home_qpos, (60, 1))
    qpos[:20, 7 + ROLL], qpos[20:24, 7 + ROLL], qpos[24:, 7 + ROLL] = 1.5, 0.0, -1.5
    start = in_one_branch(MODEL, qpos, [Event("orientation_flip", 20, 23, 170.0, subject="left_wrist")])
    expected = qpos.copy()
    expected[:24, 7 + ROLL] = -1.5
    np.testing.assert_array_equal(start, expected)
    assert in_one_branch(MODEL, qpos, []) is None


def test_what_is_left_says_why():
    targets = make_targets(scene(), MODEL, Scaling())
    qpos = np.tile(MODEL.home_qpos, (scene().frames, 1))
    qpos[10:15, 7 + ROLL] = MODEL.upper[ROLL]
    left = Event("orientation_flip", 10, 14, 120.0, subject="left_wrist")
    (told,) = with_reasons([left], MODEL.forward(qpos), targets)
    assert str(told).endswith("frames 10 to 14: at the end of the range of left_wrist_roll_joint")
    (told,) = with_reasons([replace(left, first_frame=20, last_frame=22)], MODEL.forward(qpos), targets)
    assert told.reason == "no start of the inverse kinematics led past it"
    touching = targets.contact_flags.copy()
    touching[20:23, targets.contact_links.index("left_palm")] = True
    touched = replace(targets, contact_flags=touching)
    (told,) = with_reasons([replace(left, first_frame=20, last_frame=22)], MODEL.forward(qpos), touched)
    assert told.reason == "the contact of left_palm comes first"


def test_a_limb_ends_at_the_trunk():
    assert [MODEL.joint_names[joint] for joint in limb_joints(MODEL, "left_elbow")] == [
        f"left_{name}_joint" for name in ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
    ]
    assert len(limb_joints(MODEL, "torso")) == len(limb_joints(MODEL, "pelvis")) == 0
    assert orientation_flips({}) == ()
