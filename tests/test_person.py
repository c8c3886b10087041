"""Which feet stand."""

from dataclasses import replace

import numpy as np

from hoi_retarget.human.person import stance
from hoi_retarget.human.skeleton import JOINT_INDEX
from synthetic import make

CLIP = make("carry_box")
PERSON = CLIP.people[0]
LEFT_LEG = [JOINT_INDEX[name] for name in ("left_knee", "left_ankle", "left_foot")]


def raised(joints: list[int], height: float) -> np.ndarray:
    positions = PERSON.joint_positions.copy()
    positions[:, joints, 2] += height
    return positions


def test_feet_swing_and_stand():
    flags = stance(PERSON, CLIP.fps)
    assert 0.3 < flags.mean() < 0.98
    assert flags.any(axis=1).mean() > 0.95, "somebody who walks has a foot on the floor"


def test_a_foot_held_up_all_the_time_does_not_stand():
    person = replace(PERSON, joint_positions=raised(LEFT_LEG, 0.35))
    flags = stance(person, CLIP.fps)
    assert not flags[:, 0].any()
    np.testing.assert_array_equal(flags[:, 1], stance(PERSON, CLIP.fps)[:, 1])


def test_a_capture_that_rides_over_the_floor_stands_all_the_same():
    everything = list(range(len(JOINT_INDEX)))
    person = replace(PERSON, joint_positions=raised(everything, 0.04))
    assert (stance(person, CLIP.fps) >= stance(PERSON, CLIP.fps)).mean() > 0.99


def test_speed_counts_in_metres_a_second():
    slow = stance(PERSON, 0.1 * CLIP.fps)
    assert slow.sum() > stance(PERSON, CLIP.fps).sum()
