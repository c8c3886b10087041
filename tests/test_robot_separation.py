"""Two people's robots in one world that would go through each other, and what is told of those that do."""

from dataclasses import replace

import numpy as np
import pytest

from hoi_retarget.clip.clip import Clip
from hoi_retarget.evaluation import inter_robot_penetrations
from hoi_retarget.evaluation.thresholds import Level, verdict_of
from hoi_retarget.motion.motion_report import Event, Report
from hoi_retarget.retargeting.config import Config
from hoi_retarget.retargeting.retarget import retarget, retarget_people
from hoi_retarget.robots.link_depths import robot_depths
from hoi_retarget.studio.editor.edit_session import ContactEdits, solved
from posed_people import FRAMES, posed
from trajectories import MODELS

G1 = MODELS["unitree_g1"]
LANDMARK = Config(contact="landmark")


def beside(nearest: float) -> Clip:
    """Two people who stand beside each other; the second comes near [m] and goes again, over 5 s."""
    (person,) = posed("standing").people
    way = nearest + 1.0 - np.hanning(150) ** 2
    times = np.resize(np.r_[:FRAMES, FRAMES - 1 : 0 : -1], len(way))
    positions, quats = person.joint_positions[times], person.joint_quats[times]
    shifted = positions + way[:, None, None] * np.array([1.0, 0.0, 0.0])
    people = (replace(person, joint_positions=positions, joint_quats=quats),)
    people += (replace(person, name="other", joint_positions=shifted, joint_quats=quats),)
    return Clip("beside", 30.0, people, (), ())


NEAR, FAR = beside(0.78), beside(1.2)


@pytest.fixture(scope="module")
def alone():
    return tuple(retarget(NEAR, G1, person=person) for person in range(2))


@pytest.fixture(scope="module")
def apart():
    return retarget_people(NEAR, [G1])


def depths(motions) -> np.ndarray:
    """The largest depth in every frame [m]."""
    return robot_depths(*(G1.forward(motion.qpos) for motion in motions))[0].max(axis=0, initial=0.0)


@pytest.mark.slow
def test_robots_that_meet_are_kept_apart_and_both_give_way(alone, apart):
    before = depths(alone)
    assert before.max() > 0.01
    assert depths(apart).max() < 1e-3
    moved = [float(np.abs(now.qpos[:, :3] - was.qpos[:, :3]).max()) for now, was in zip(apart, alone, strict=True)]
    assert min(moved) > 0.2 * max(moved) > 0.0
    for now, was in zip(apart, alone, strict=True):
        assert now.converged and now.report.inter_robot_penetrations == ()
        assert now.report.figures["robot_penetration_max_m"] < 1e-3
        assert now.report.figures["body_jerk_max_mps3"] < 2.0 * was.report.figures["body_jerk_max_mps3"]
        assert now.report.figures["stance_sole_height_abs_m"] < 2e-3


@pytest.mark.slow
def test_frames_far_from_the_meeting_are_those_of_each_alone(alone, apart):
    still = [(now.qpos == was.qpos).all(axis=1) for now, was in zip(apart, alone, strict=True)]
    met = np.flatnonzero(depths(alone) > 1e-3)
    for same in still:
        assert same[: met[0] - 35].all() and same[met[-1] + 35 :].all() and not same[met].any()


def test_robots_that_never_meet_are_those_of_each_alone():
    together = retarget_people(FAR, [G1])
    for person, motion in enumerate(together):
        np.testing.assert_array_equal(motion.qpos, retarget(FAR, G1, person=person).qpos)
        assert motion.report.figures["robot_penetration_max_m"] == 0.0


def test_contact_at_landmarks_moves_nothing_and_tells_what_meets():
    motions = retarget_people(NEAR, [G1], LANDMARK)
    deep = depths(motions)
    for person, motion in enumerate(motions):
        np.testing.assert_array_equal(motion.qpos, retarget(NEAR, G1, LANDMARK, person=person).qpos)
        assert motion.report.figures["robot_penetration_max_m"] == deep.max() > 0.01
        told = motion.report.inter_robot_penetrations
        assert max(item.value for item in told) == deep.max()
        assert min(item.first_frame for item in told) == np.flatnonzero(deep > 5e-3)[0]
        assert [warning.code for warning in motion.warnings].count("inter_robot_penetration") == len(told)
        assert "in another robot" in str(verdict_of(motion, G1).reasons[0])
        assert verdict_of(motion, G1).level is Level.WARN


def test_what_is_told_is_read_again_and_says_who_and_when():
    item = Event("inter_robot_penetration", 3, 9, 0.0123, people=(0, 1), links=("left_wrist", "right_wrist"))
    assert (
        str(item)
        == "left_wrist of person 0 and right_wrist of person 1 are up to 12 mm inside each other, frames 3 to 9"
    )
    report = Report(inter_robot_penetrations=(item,))
    assert Report.from_json(report.as_json()) == report


def test_one_robot_has_no_other():
    motion = retarget(FAR, G1)
    assert motion.report.figures["robot_penetration_max_m"] is None
    assert inter_robot_penetrations([motion], [G1]) == ((), (None,))


@pytest.mark.slow
def test_the_editor_makes_the_same_motions(apart):
    for mine, other in zip(solved(NEAR, G1, Config(), ContactEdits.of(NEAR)).motions, apart, strict=True):
        np.testing.assert_array_equal(mine.qpos, other.qpos)
